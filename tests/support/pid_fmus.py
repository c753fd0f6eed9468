"""Drive controller FMUs in child processes, and the law to hold them against.

Python FMUs share the interpreter they are loaded into: no test process ever loads one itself.
"""

import ctypes
import gc
import multiprocessing
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.simulation import instantiate_fmu

import build_fmus

T_S = 0.25e-3
GAINS = {"K_p": (45.0, 15.0), "K_i": (30.0, 10.0), "K_d": (1.5, 0.5), "z_p": (0.95, 0.95)}
INPUTS = ("q_m_ref[1]", "q_m_ref[2]", "q_m[1]", "q_m[2]")
OUTPUTS = ("u_m[1]", "u_m[2]")


@dataclass(frozen=True)
class Signals:
    """References and measurements [rad], shape (samples, 2) each, and the torques to start from [N.m]."""

    q_m_ref: np.ndarray
    q_m: np.ndarray
    u_m0: tuple[float, float]

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """The inputs of every sample in the order of INPUTS."""
        return [tuple(row) for row in np.hstack([self.q_m_ref, self.q_m]).tolist()]


def random_signals(samples: int = 200, seed: int = 1) -> Signals:
    """Signals without any structure: if torques agree on these to the last bit, the laws are the same."""
    q_m_ref, q_m = np.random.default_rng(seed).normal(size=(2, samples, 2))
    return Signals(q_m_ref, q_m, (1.7, -0.3))


def law(signals: Signals, gains: Mapping[str, Sequence[float]] = GAINS, samples: int = 1) -> list[tuple[float, float]]:
    """Torques [N.m] of the recursion for eq. (13), written as plainly as can be; the derivative is the slope over so
    many ``samples``."""
    axes = []
    for i in range(2):
        K_p, K_i, K_d, z_p = (gains[name][i] for name in ("K_p", "K_i", "K_d", "z_p"))
        past, v, s = [0.0] * samples, 0.0, signals.u_m0[i]
        torques = []
        for reference, measured in zip(signals.q_m_ref[:, i].tolist(), signals.q_m[:, i].tolist(), strict=True):
            e = reference - measured
            v = z_p * v + (1.0 - z_p) * (e - past[-samples]) / (samples * T_S)
            s = s + K_i * T_S * e
            torques.append(K_p * e + K_d * v + s)
            past.append(e)
        axes.append(torques)
    return list(zip(*axes, strict=True))


def built(name: str, folder: Path) -> Path:
    """The FMU ``name`` of the project in ``folder``, built unless it is there."""
    path = folder / f"{name}.fmu"
    return path if path.exists() else build_fmus.build(name, folder)


@dataclass
class Slave:
    """An FMI 2.0 co-simulation instance whose variables go by name, and what it logged."""

    fmu: FMU2Slave
    references: dict[str, int]
    log: list[str]

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set variables by name."""
        self.fmu.setReal([self.references[name] for name in names], list(values))

    def get(self, names: Sequence[str] = OUTPUTS) -> tuple[float, ...]:
        """Get variables by name."""
        return tuple(self.fmu.getReal([self.references[name] for name in names]))

    def begin(self, q_m: Sequence[float] = (0.0, 0.0), u_m0: Sequence[float] = (0.0, 0.0)) -> None:
        """Enter initialization, with the arm at rest at ``q_m`` under ``u_m0``."""
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.set((*INPUTS, "u_m0[1]", "u_m0[2]"), (*q_m, *q_m, *u_m0))

    def initialize(self, *at: Sequence[float]) -> None:
        """Go through initialization."""
        self.begin(*at)
        self.fmu.exitInitializationMode()

    def run(self, rows: Sequence[Sequence[float]], first: int = 0) -> list[tuple[float, ...]]:
        """Do a step per row of inputs, the first of them number ``first``; return the torques after each."""
        torques = []
        for k, row in enumerate(rows, start=first):
            self.set(INPUTS, row)
            self.fmu.doStep(k * T_S, T_S)
            torques.append(self.get())
        return torques


def instance(path: Path, log: list[str] | None = None, guid: str = "", **options: Any) -> Any:
    """An instance of the FMU at ``path``, by FMPy's own class; messages go to ``log``."""
    description = read_model_description(str(path))
    description.guid = guid or description.guid

    forget_exception = ctypes.pythonapi.PyErr_Clear  # that of the slave, which is pending while pythonfmu logs

    def keep(*arguments: Any) -> None:
        forget_exception()
        if log is not None:
            log.append(arguments[-1] if isinstance(arguments[-1], str) else arguments[-1].decode())

    # A folder of its own, as a loaded library must not be overwritten; beside the FMU, where pytest cleans up.
    folder = extract(str(path), unzipdir=tempfile.mkdtemp(dir=path.parent))
    return instantiate_fmu(folder, description, debug_logging=True, logger=keep, **options)


@contextmanager
def slave(path: Path) -> Iterator[Slave]:
    """Instantiate the FMI 2.0 co-simulation FMU ``path``."""
    variables, log = read_model_description(str(path)).modelVariables, list[str]()
    fmu = instance(path, log)
    try:
        yield Slave(fmu, {variable.name: variable.valueReference for variable in variables}, log)
    finally:
        fmu.freeInstance()


def live(
    path: Path, signals: Signals, at: Sequence[float], steps: Sequence[float], parameters: Sequence[tuple[str, float]]
) -> dict[str, Any]:
    """What a controller does, in a child: its torques at once and from states that are restored at half time, and how
    it refuses ``steps`` of a wrong length and wrong ``parameters``."""
    described = [v.name for v in read_model_description(str(path)).modelVariables if v.start is not None]
    rows, half, found = signals.rows, len(signals.rows) // 2, {"restored": [], "failed": []}

    def fails(function: Any, *arguments: Any) -> None:
        try:
            function(*arguments)
        except FMICallException as error:
            found["failed"].append(error.function)

    with slave(path) as one:
        found["started"] = one.get(described)
        one.begin(at, signals.u_m0)
        found["initial"] = one.get()
        one.fmu.exitInitializationMode()
        head = one.run(rows[:half])
        state = one.fmu.getFMUstate()
        kept = one.fmu.serializeFMUstate(state)
        found["runs"] = runs = [head + one.run(rows[half:], half)]
        for take in (lambda: state, lambda: one.fmu.deSerializeFMUstate(kept)):
            one.fmu.setFMUstate(take())
            found["restored"].append(one.get())
            runs.append(head + one.run(rows[half:], half))
        one.fmu.freeFMUstate(state)
        one.fmu.reset()
        one.initialize(at, signals.u_m0)
        runs.append(one.run(rows))
    with slave(path) as other:
        other.initialize(at)
        state = other.fmu.getFMUstate()
        for step in steps:
            other.fmu.setFMUstate(state)  # a call that fails leaves an FMU of FMI 2 in its error state
            fails(other.fmu.doStep, 0.0, step)
        other.fmu.freeFMUstate(state)
        found["unchanged"], log = other.get(), other.log
        other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(kept))
        runs.append(head + other.run(rows[half:], half))
    gc.disable()  # pythonfmu 0.7.0 releases an exception that its slave raises once too often, and a collection crashes
    for name, value in parameters:
        with slave(path) as third:
            fails(lambda one=third, name=name, value=value: (one.set([name], [value]), one.initialize(at)))
            log = log + third.log
    return {**found, "log": "\n".join(log)}


def fmpys_torques(paths: Sequence[Path], signals: Signals, **parameters: float | str) -> list[list[tuple[float, ...]]]:
    """For each FMU u_m at all multiples of T_S from 0 on, through FMPy's own simulation; to be run in a child."""
    found, times = [], [k * T_S for k in range(len(signals.rows))]
    for path in paths:
        outputs, start = list(OUTPUTS), dict(zip(("u_m0[1]", "u_m0[2]"), signals.u_m0, strict=True))
        dtype: list[Any] = [(name, float) for name in ("time", *INPUTS)]
        rows: list[Any] = [(t, *row) for t, row in zip(times, signals.rows, strict=True)]
        if any(variable.shape for variable in read_model_description(str(path)).modelVariables):
            outputs, start = ["u_m"], {"u_m0": list(signals.u_m0)}
            dtype = [("time", float), ("q_m_ref", float, (2,)), ("q_m", float, (2,))]
            rows = [(t, row[:2], row[2:]) for t, row in zip(times, signals.rows, strict=True)]
        result = fmpy.simulate_fmu(
            str(path),
            stop_time=len(rows) * T_S,
            output_interval=T_S,
            step_size=T_S,
            solver="Euler",
            record_events=False,
            input=np.array(rows, dtype=dtype),
            start_values={**start, **parameters},
            output=outputs,
        )
        columns = [np.asarray(result[name], dtype=float).reshape(len(result), -1) for name in outputs]
        found.append([tuple(row) for row in np.hstack(columns).tolist()])
    return found


def in_child(function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Return what ``function`` returns in a fresh process."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context) as pool:
        return pool.submit(function, *arguments, **named).result()
