"""How much time the master loop takes, beside a Python loop, the bare plant, and a loop in C.

    python benchmarks/loop_speed.py
    python benchmarks/loop_speed.py --rounds 15 --seconds 26

Needs a C compiler. In every round each contender runs once, one after the other in one process, and what is compared
are ratios and differences within a round; medians over the rounds are printed. A slow moment of the machine thus hits
all alike, and a slow machine changes little. The exit code is 1 where a target is missed.

All times are microseconds of the processor's time per controller sample (0.25 ms of simulated time), start and end of
a simulation included; others' use of the machine is not in them. "All imperfections" are those of the benchmark's
``disturbance`` case: noise with its generation, delay, quantization, saturation, chirp and force; "the same FMUs" means
instances of one loaded library.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import numba  # noqa: E402
import numpy as np  # noqa: E402
from fmpy.fmi2 import FMU2Slave  # noqa: E402

import build_fmus  # noqa: E402
from orchestrator.benchmark import cases as case_list  # noqa: E402
from orchestrator.benchmark import protocol as protocols  # noqa: E402
from orchestrator.exact_time import seconds  # noqa: E402
from orchestrator.fmi.archive import Archive, open_archive  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop import signals  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.loop.scenario import Scenario  # noqa: E402
from orchestrator.loop.trajectory import Status, Trajectory  # noqa: E402
from plant_fmu.flexible_manipulator.parameters import NOMINAL  # noqa: E402

SAMPLE_TIME = 0.25e-3

Contender = Callable[[], float]
"""Runs once and returns what a sample took [us]."""


@dataclass(frozen=True)
class Bench:
    """The FMUs, loaded, and the scenario all contenders run."""

    plant: Slave
    stub_plant: Slave
    controller: Slave
    c_loop: Callable[..., int]
    scenario: Scenario


# ---- Contenders ----


def master(plant: Slave, controller: Slave, scenario: Scenario) -> float:
    """The benchmark's own loop, all imperfections on."""
    begin = time.thread_time()
    trajectory = simulate(plant, controller, scenario)
    taken = _per_sample(begin, scenario)
    assert trajectory.ending.status is Status.DONE, trajectory.ending.message
    return taken


def python_loop(plant: Archive, controller: Archive, scenario: Scenario, disturbances: list[list[float]]) -> float:
    """A plain Python loop over FMPy's setReal, doStep, getReal: the plant's inputs are torque and disturbances,
    nothing else stands between the two slaves."""
    with _fmpy_pair(plant, controller, scenario) as (arm, pid):
        arm_references, pid_references = _references(plant), _references(controller)
        inputs = [reference for name in ("u_m", "u_d", "F") for reference in arm_references[name]]
        observed = arm_references["q_m"] + arm_references["X"]
        measured, torque = pid_references["q_m"], pid_references["u_m"]
        begin = time.thread_time()
        outputs = arm.getReal(observed)
        for k in range(scenario.samples):
            t = k * SAMPLE_TIME
            pid.setReal(measured, outputs[:2])
            pid.doStep(t, SAMPLE_TIME)
            arm.setReal(inputs, pid.getReal(torque) + disturbances[k])
            arm.doStep(t, SAMPLE_TIME)
            outputs = arm.getReal(observed)
        return _per_sample(begin, scenario)


def c_loop(bench: Bench, plant: Archive, controller: Archive) -> float:
    """A loop in C over the same FMI functions; nothing between the two slaves."""
    with _fmpy_pair(plant, controller, bench.scenario) as (arm, pid):
        arm_references, pid_references = _references(plant), _references(controller)
        arm_side = _c_slave(arm, arm_references["u_m"], arm_references["q_m"] + arm_references["X"])
        pid_side = _c_slave(pid, pid_references["q_m"], pid_references["u_m"])
        begin = time.thread_time()
        status = bench.c_loop(ctypes.byref(arm_side), ctypes.byref(pid_side), SAMPLE_TIME, bench.scenario.samples)
        taken = _per_sample(begin, bench.scenario)
    assert status == 0, status
    return taken


def bare_kernel(integrate: Callable[..., None], start: np.ndarray, inputs: np.ndarray) -> float:
    """The plant's integration alone, called from compiled code with the inputs of a real simulation."""
    memory = start.copy()
    begin = time.thread_time()
    integrate(memory, inputs, SAMPLE_TIME)
    return (time.thread_time() - begin) / len(inputs) * 1e6


# ---- What they need ----


def _per_sample(begin: float, scenario: Scenario) -> float:
    return (time.thread_time() - begin) / scenario.samples * 1e6


def _references(archive: Archive) -> dict[str, list[int]]:
    """Value references of both components of each connector."""
    references: dict[str, list[int]] = {}
    for variable in archive.description.modelVariables:
        references.setdefault(variable.name.partition("[")[0], []).append(variable.valueReference)
    return references


@contextmanager
def _fmpy_pair(plant: Archive, controller: Archive, scenario: Scenario) -> Iterator[tuple[FMU2Slave, FMU2Slave]]:
    """Both FMUs in FMPy, initialized at rest."""
    arm, pid = (_instance(archive) for archive in (plant, controller))
    known = {variable.name: variable.valueReference for variable in plant.description.modelVariables}
    given = {known[name]: value for name, value in scenario.parameters if name in known}
    arm.setReal(list(given), list(given.values()))
    _initialize(arm, {})
    arm_references, pid_references = _references(plant), _references(controller)
    rest = {name: arm.getReal(arm_references[name]) for name in ("q_m_ref", "u_m0")}
    seen = {"q_m_ref": rest["q_m_ref"], "q_m": rest["q_m_ref"], "u_m0": rest["u_m0"]}
    pairs = (pair for name, values in seen.items() for pair in zip(pid_references[name], values, strict=True))
    _initialize(pid, dict(pairs))
    yield arm, pid
    for fmu in (arm, pid):
        fmu.terminate()
        fmu.fmi2FreeInstance(fmu.component)  # freeInstance would unload the library that others use


def _instance(archive: Archive) -> FMU2Slave:
    fmu = FMU2Slave(
        guid=archive.description.guid,
        modelIdentifier=archive.description.coSimulation.modelIdentifier,
        unzipDirectory=str(archive.folder),
    )
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    return fmu


def _initialize(fmu: FMU2Slave, inputs: dict[int, float]) -> None:
    fmu.enterInitializationMode()
    if inputs:
        fmu.setReal(list(inputs), list(inputs.values()))
    fmu.exitInitializationMode()


class _CSlave(ctypes.Structure):
    """``Slave`` of c_loop.c."""

    _fields_ = [
        ("instance", ctypes.c_void_p),
        ("set", ctypes.c_void_p),
        ("step", ctypes.c_void_p),
        ("get", ctypes.c_void_p),
        ("inputs", ctypes.POINTER(ctypes.c_uint)),
        ("outputs", ctypes.POINTER(ctypes.c_uint)),
        ("n_outputs", ctypes.c_size_t),
    ]


def _c_slave(fmu: FMU2Slave, inputs: Sequence[int], outputs: Sequence[int]) -> _CSlave:
    functions = (ctypes.cast(fmu.dll[f"fmi2{name}"], ctypes.c_void_p) for name in ("SetReal", "DoStep", "GetReal"))
    return _CSlave(
        fmu.component,
        *functions,
        (ctypes.c_uint * len(inputs))(*inputs),
        (ctypes.c_uint * len(outputs))(*outputs),
        len(outputs),
    )


def _plant_inputs(scenario: Scenario, trajectory: Trajectory) -> np.ndarray:
    """What the plant was driven by in each sample of a simulation, shape (samples, 6)."""
    delayed = np.vstack([trajectory.u_m0, trajectory.torque[:-1]])
    chirp, pulse = signals.chirp_signal(scenario.chirp), signals.pulse_signal(scenario.pulse)
    disturbances = [(*signals.chirp(chirp, t), *signals.pulse(pulse, t)) for t in trajectory.time[:-1]]
    return np.hstack([delayed, disturbances])


def _kernel(plant: Archive, scenario: Scenario) -> tuple[Callable[..., None], np.ndarray]:
    """The plant's integration over many samples as a compiled function, and its memory at the start of ``scenario``.

    The modules are the FMU's own, from where it was extracted to: the machine code is that of the FMU.
    """
    sys.path.insert(0, str(plant.folder / "resources"))
    package = "flexible_manipulator"
    coefficients, equilibrium, integrator = (
        importlib.import_module(f"{package}.{name}") for name in ("coefficients", "equilibrium", "integrator")
    )

    @numba.njit
    def integrate(memory: np.ndarray, inputs: np.ndarray, step: float) -> None:
        for k in range(inputs.shape[0]):
            memory[:6] = inputs[k]
            integrator.advance(memory, step)

    values = {**NOMINAL, **dict(scenario.parameters)}
    q_a = (values["q_a_start[1]"], values["q_a_start[2]"])
    arm, joints = coefficients.arm(values), (coefficients.joint(values, 1), coefficients.joint(values, 2))
    memory = np.zeros(integrator.STATE + integrator.STATE_SIZE)
    q_m = equilibrium.solve(arm, joints, q_a).q_m
    memory[integrator.STATE :] = integrator.state_at_rest(q_a, q_m, arm, joints)
    return integrate, memory


def _compiled_c_loop(folder: Path) -> Callable[..., int]:
    compiler = build_fmus.find_compiler()
    if compiler is None:
        raise SystemExit("No C compiler found; install one (cc, gcc, clang) or set CC.")
    library = folder / "c_loop.so"
    subprocess.run([*compiler, "-O2", "-fPIC", "-shared", "-o", str(library), str(HERE / "c_loop.c")], check=True)
    function = ctypes.CDLL(str(library)).c_loop
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_long]
    return function


def set_up(folder: Path, duration: float) -> Bench:
    """Build and load what is needed, into ``folder``."""
    stub = HERE / "stub_plant"
    files = [
        build_fmus.build("FlexibleManipulator", folder),
        build_fmus.c_fmu([stub / "model.c"], stub / "modelDescription.xml", folder / "StubPlant.fmu"),
        build_fmus.build("DiagonalPID_C", folder),
    ]
    plant, stub_plant, controller = (load(open_archive(file)) for file in files)
    paper = protocols.load("paper")
    test = paper.test("disturbance")
    system = case_list.system(paper, NOMINAL, 0, 4, "random_1", test)
    case = case_list.case(paper, case_list.grid(paper)[4], system, test, 0)
    scenario = replace(case.scenario, duration=seconds(duration))
    return Bench(plant, stub_plant, controller, _compiled_c_loop(folder), scenario)


# ---- Comparison ----


def measure(contenders: dict[str, Contender], rounds: int) -> list[dict[str, float]]:
    """Times [us] of every contender in every round; a first round that fills caches is not counted."""
    results = []
    names = list(contenders)
    for number in range(rounds + 1):
        turn = number % len(names)
        times = {name: contenders[name]() for name in names[turn:] + names[:turn]}
        if number > 0:
            results.append(times)
        print(f"\rround {number} of {rounds}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return results


def report(results: list[dict[str, float]]) -> bool:
    """Print medians and the comparisons with their targets; returns whether all are met."""
    print("us per sample (median)")
    for name in results[0]:
        print(f"  {statistics.median(times[name] for times in results):8.3f}  {name}")
    comparisons = (
        ("master / Python loop", "ratio", 1 / 4, lambda t: t[MASTER] / t[PYTHON]),
        ("(master - plant kernel) / Python loop", "ratio", 1 / 6, lambda t: (t[MASTER] - t[KERNEL]) / t[PYTHON]),
        ("master - C loop, stub plant", "us", 0.2, lambda t: t[MASTER_STUB] - t[C_STUB]),
    )
    met = True
    print("comparison within a round (median), target")
    for name, unit, target, of in comparisons:
        value = statistics.median(of(times) for times in results)
        met = met and value <= target
        verdict = "met" if value <= target else "MISSED"
        print(f"  {value:8.3f} <= {target:.3f} {unit:5}  {verdict:6}  {name}")
    return met


MASTER = "master, plant FMU + C PID, all imperfections"
PYTHON = "Python loop over FMPy, plant FMU + C PID, disturbances alone"
KERNEL = "plant kernel alone, compiled loop"
MASTER_STUB = "master, C plant stub + C PID, all imperfections"
C_STUB = "C loop, C plant stub + C PID, nothing else"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns 0 where all targets are met, else 1."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--rounds", type=int, default=9, help="how often each contender runs (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=26.0, help="simulated time of a run (default: %(default)s)")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="loop_speed_") as folder:
        bench = set_up(Path(folder), options.seconds)
        plant, stub, controller = (slave.archive for slave in (bench.plant, bench.stub_plant, bench.controller))
        scenario = bench.scenario
        integrate, at_rest = _kernel(plant, scenario)
        inputs = _plant_inputs(scenario, simulate(bench.plant, bench.controller, scenario))
        disturbances = inputs[:, 2:].tolist()
        # The stub has no parameters but its pose.
        for_stub = replace(scenario, parameters=scenario.parameters[:2])
        contenders: dict[str, Contender] = {
            MASTER: lambda: master(bench.plant, bench.controller, scenario),
            PYTHON: lambda: python_loop(plant, controller, scenario, disturbances),
            KERNEL: lambda: bare_kernel(integrate, at_rest, inputs),
            MASTER_STUB: lambda: master(bench.stub_plant, bench.controller, for_stub),
            C_STUB: lambda: c_loop(bench, stub, controller),
        }
        met = report(measure(contenders, options.rounds))
    return 0 if met else 1


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pythonfmu's libraries must not be torn down with the interpreter
