"""The time rule of our FMUs: every master gets the outputs of the exact one, however it computes its times, and none
gets samples at another distance than the sample time."""

import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from hypothesis import given, settings
from hypothesis import strategies as st
from random_calls.fmus import FMUS
from support.pid_fmus import T_S, built, in_child, instance

from controller_fmu import starters
from controller_fmu.export import build_folder

IN_C = ("DiagonalPID_C", "DitheredLQG_C", "RobustLQG", "RobustLinearLQG", "SteadyLQG", "state_space", "mlp_tanh")
DIALECTS = ("DiagonalPID_C_fmi1", "DiagonalPID_C_fmi3_scalars")
OTHERS_IN_C = ("FlexibleManipulatorNative", "FlexibleManipulatorNative_fmi3", "Imperfections")
IN_PYTHON = ("DiagonalPID", "TunedPID", "ManipulatorLQG", "DitheredLQG")
KITS = {"python": (), "numpy": (), "onnx": ("onnxruntime",), "c": ("compiler",)}
"""The starter kits and the tools that they need."""

EXAMPLES = 12
STARTS = (0.0, 25.9, 1e4)
"""Start times [s]."""

NEARLY = 1e-6
"""So far beside the grid, in steps, a master's communication points may be."""


@dataclass(frozen=True)
class Master:
    """How a master computes its communication points, which of them are samples, and whether it tells the stop time."""

    start: float
    steps: tuple[tuple[float, float], ...]
    """Times and lengths [s]."""
    samples: tuple[bool, ...]
    tells_stop: bool

    @property
    def stop(self) -> float:
        """The stop time [s]."""
        return sum(self.steps[-1])


def _exact(start: float, count: int, h: float) -> list[tuple[float, float]]:
    return [(start + k * h, h) for k in range(count)]


def _summing(start: float, count: int, h: float) -> list[tuple[float, float]]:
    return [(t, h) for t in itertools.accumulate([h] * (count - 1), initial=start)]


def _differences(points: Sequence[float]) -> list[tuple[float, float]]:
    return [(t, end - t) for t, end in itertools.pairwise(points)]


def _clipping(start: float, stop: float, h: float) -> list[tuple[float, float]]:
    """Sums up, and makes the last step as short as it must be."""
    t, steps = start, []
    while t < stop:
        steps.append((t, min(h, stop - t)))
        t += steps[-1][1]
    return steps


@st.composite
def masters(draw: st.DrawFn, h: float, starts: Sequence[float]) -> Master:
    """A master of any kind with steps of nearly ``h`` [s]."""
    start, count = draw(st.sampled_from(starts)), draw(st.integers(2, 12))
    beside = [draw(st.floats(-NEARLY, NEARLY)) for _ in range(count + 1)]
    kind = draw(st.sampled_from(["exact", "summing", "differences", "clipping", "jittering", "inconsistent"]))
    points = [start + (k + (beside[k] if k else 0.0)) * h for k in range(count + 1)]
    steps = {
        "exact": lambda: _exact(start, count, h),
        "summing": lambda: _summing(start, count, h),
        "differences": lambda: _differences([start + k * h for k in range(count + 1)]),
        "clipping": lambda: _clipping(start, points[-1] - (0.0 if draw(st.booleans()) else 0.3 * h), h),
        "jittering": lambda: _differences(points),
        "inconsistent": lambda: [(t, h) for t in points[:-1]],
    }[kind]()
    samples = [step > NEARLY * h for _, step in steps]
    # Another step, of next to nothing, at the end; one that was clipped has brought time to the stop time exactly.
    if steps[-1][1] > 0.9 * h and draw(st.booleans()):
        steps.append((sum(steps[-1]), draw(st.sampled_from([2.7e-14, 1e-12, NEARLY * h]))))
        samples.append(False)
    return Master(start, tuple(steps), tuple(samples), draw(st.booleans()))


class Fmu:
    """An instance of any version of FMI, its inputs and outputs in the order of the description."""

    def __init__(self, path: Path) -> None:
        self.description = read_model_description(str(path))
        self.fmu: Any = instance(path)
        variables = self.description.modelVariables
        self.inputs, self.outputs = (
            [v.valueReference for v in variables if v.causality == causality and v.name != "time"]
            for causality in ("input", "output")
        )
        self.version = self.description.fmiVersion[0]

    def begin(self, start: float, stop: float | None) -> None:
        """Initialize, from the first state on."""
        if self.version == "1":
            self.fmu.initialize(start, stop)
            return
        if self.version == "2":
            self.fmu.setupExperiment(startTime=start, stopTime=stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start, stopTime=stop)
        self.fmu.exitInitializationMode()

    def step(self, t: float, h: float, values: Sequence[float]) -> list[float]:
        """The outputs after a step."""
        write, read = (
            (self.fmu.setFloat64, self.fmu.getFloat64) if self.version == "3" else (self.fmu.setReal, self.fmu.getReal)
        )
        write(self.inputs, list(values))
        self.fmu.doStep(t, h)
        return list(read(self.outputs))


@contextmanager
def opened(path: Path) -> Iterator[Fmu]:
    """An instance of the FMU, freed at the end."""
    fmu = Fmu(path)
    try:
        yield fmu
    finally:
        fmu.fmu.freeInstance()


def outputs(fmu: Fmu, master: Master, size: float) -> np.ndarray:
    """After each step of ``master``, with random inputs of this size, which a step that is no sample leaves alone."""
    rows = np.random.default_rng(7).uniform(-size, size, (len(master.steps), len(fmu.inputs)))
    fmu.fmu.reset()
    fmu.begin(master.start, master.stop if master.tells_stop else None)
    numbers = np.cumsum(master.samples) - 1
    return np.array([fmu.step(t, h, rows[k]) for (t, h), k in zip(master.steps, numbers, strict=True)])


def check_masters(
    path: Path, derandomize: bool, starts: Sequence[float] = STARTS, kind: str = "controller", h: float = T_S
) -> None:
    """The law for one FMU: a controller has equal outputs after every step, a plant nearly equal ones, since it
    integrates over the steps as they are, and after whole steps only."""
    size, close = (10.0, 1e-4) if kind == "plant" else (0.01, 0.0)
    with opened(path) as fmu:

        @settings(max_examples=EXAMPLES, deadline=None, derandomize=derandomize)
        @given(masters(h, starts))
        def holds(master: Master) -> None:
            count = sum(master.samples)
            exact = Master(master.start, tuple(_exact(master.start, count, h)), (True,) * count, False)
            found = outputs(fmu, master, size)
            expected = outputs(fmu, exact, size)[np.cumsum(master.samples) - 1]
            assert np.ptp(expected) > 0.0
            if kind != "controller":
                of_a_sample = zip(master.steps, master.samples, strict=True)
                whole = np.logical_and.accumulate([step > 0.9 * h or not sample for (_, step), sample in of_a_sample])
                found, expected = found[whole], expected[whole]
            assert np.abs(found - expected).max(initial=0.0) <= close * np.ptp(expected)

        holds()


def check_wrong_steps(path: Path, derandomize: bool) -> None:
    """A master whose steps have another length than the sample time is refused before a sample is a hundredth of it
    beside its place, whether or not it tells the stop time."""
    with opened(path) as fmu:

        @settings(max_examples=EXAMPLES, deadline=None, derandomize=derandomize)
        @given(
            st.one_of(st.floats(0.001, 0.998), st.floats(1.002, 5.0)),
            st.booleans(),
            st.sampled_from(STARTS),
        )
        def holds(part: float, tells_stop: bool, start: float) -> None:
            fmu.fmu.reset()
            fmu.begin(start, start + 1.0 if tells_stop else None)
            taken = 0
            with pytest.raises(FMICallException):
                for k in range(100):
                    fmu.step(start + k * part * T_S, part * T_S, [0.0] * len(fmu.inputs))
                    taken += 1
            assert taken <= 0.01 / min(part, abs(part - 1.0)) + 2.0

        holds()


def check_all(paths: Sequence[Path], derandomize: bool) -> None:
    """Both checks of each controller; in a child, where FMUs in Python may be loaded."""
    for path in paths:
        check_masters(path, derandomize)
        check_wrong_steps(path, derandomize)


def repeatable() -> bool:
    """Whether this run of the tests repeats the same examples, which a child does not know."""
    return settings().derandomize


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the FMUs of this module are built."""
    return tmp_path_factory.mktemp("time_rule")


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", [*IN_C, *DIALECTS])
def test_a_controller_in_c_has_the_same_torques_in_every_master(name: str, folder: Path) -> None:
    path = FMUS[name](folder)
    check_masters(path, repeatable())
    if name != "DiagonalPID_C_fmi1":  # FMPy crashes where an FMU of FMI 1.0 refuses a step
        check_wrong_steps(path, repeatable())


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", OTHERS_IN_C)
def test_plant_and_imperfections_go_on_in_every_master(name: str, folder: Path) -> None:
    if name == "Imperfections":  # its time begins at 0
        check_masters(FMUS[name](folder), repeatable(), starts=(0.0,), kind="imperfections")
    else:
        check_masters(FMUS[name](folder), repeatable(), kind="plant")


def test_fmus_in_python_have_the_same_outputs_in_every_master(fmu_folder: Path) -> None:
    in_child(check_all, [built(name, fmu_folder) for name in IN_PYTHON], repeatable())
    in_child(check_masters, built("FlexibleManipulator", fmu_folder), repeatable(), STARTS, "plant")


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=pytest.mark.needs(*tools)) for kind, tools in KITS.items()])
def test_a_starter_kit_has_the_same_torques_in_every_master(kind: str, folder: Path) -> None:
    in_child(check_all, [build_folder(starters.copy(kind, folder / f"my_{kind}"))], repeatable())


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", ["DiagonalPID_C", "FlexibleManipulatorNative"])
def test_a_sum_of_26_s_goes_through_to_the_end(name: str, folder: Path) -> None:
    """As long as a case, where the sum of the steps misses the stop time by 3e-11 s."""
    steps = _clipping(0.0, 26.0, T_S)
    assert len(steps) == 104_000 and steps[-1][1] != T_S
    with opened(FMUS[name](folder)) as fmu:
        fmu.fmu.reset()
        fmu.begin(0.0, None)
        zeros = [0.0] * len(fmu.inputs)
        for t, h in steps[:-1]:
            fmu.fmu.doStep(t, h)
        assert np.isfinite(fmu.step(*steps[-1], zeros)).all()
