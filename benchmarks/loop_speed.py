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
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent)]

import numba  # noqa: E402
import numpy as np  # noqa: E402

import build_fmus  # noqa: E402
from benchmarks.common import Contender, at_rest, measure, median  # noqa: E402
from controller_fmu.export.description import to_bytes  # noqa: E402
from orchestrator.benchmark import cases as case_list  # noqa: E402
from orchestrator.benchmark import protocol as protocols  # noqa: E402
from orchestrator.exact_time import seconds  # noqa: E402
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.port import Port  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop import scenario as scenarios  # noqa: E402
from orchestrator.loop import signals  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.loop.scenario import Scenario  # noqa: E402
from orchestrator.loop.trajectory import Status, Trajectory  # noqa: E402
from plant_fmu.flexible_manipulator.parameters import NOMINAL  # noqa: E402
from plant_fmu.native import interface  # noqa: E402

SAMPLE_TIME = 0.25e-3


@dataclass(frozen=True)
class Bench:
    """The FMUs, loaded, and the scenario all contenders run."""

    plant: Slave
    stub_plant: Slave
    controller: Slave
    scenario: Scenario


# ---- Contenders ----


def per_sample(begin: float, scenario: Scenario) -> float:
    """Time of the processor since ``begin`` [s] per sample [us]."""
    return (time.thread_time() - begin) / scenario.samples * 1e6


def master(plant: Slave, controller: Slave, scenario: Scenario) -> float:
    """The benchmark's own loop, all imperfections on."""
    begin = time.thread_time()
    trajectory = simulate(plant, controller, scenario)
    taken = per_sample(begin, scenario)
    assert trajectory.ending.status is Status.DONE, trajectory.ending.message
    return taken


def python_loop(bench: Bench, disturbances: list[list[float]]) -> float:
    """A plain Python loop over FMPy's setReal, doStep, getReal: the plant's inputs are torque and disturbances,
    nothing else stands between the two slaves."""
    with at_rest(bench.plant, bench.scenario, bench.controller) as ports:
        arm, pid = bench.plant._fmu, bench.controller._fmu  # FMPy's objects
        (inputs, observed), (measured, torque) = ((port.inputs.tolist(), port.outputs.tolist()) for port in ports)
        begin = time.thread_time()
        outputs = arm.getReal(observed)
        for k in range(bench.scenario.samples):
            t = k * SAMPLE_TIME
            pid.setReal(measured, outputs[:2])
            pid.doStep(t, SAMPLE_TIME)
            arm.setReal(inputs, pid.getReal(torque) + disturbances[k])
            arm.doStep(t, SAMPLE_TIME)
            outputs = arm.getReal(observed)
        return per_sample(begin, bench.scenario)


def c_loop(bench: Bench, run: Callable[..., int]) -> float:
    """A loop in C over the same FMI functions; nothing between the two slaves."""
    with at_rest(bench.stub_plant, bench.scenario, bench.controller) as ports:
        arm, pid = map(_c_slave, ports)
        begin = time.thread_time()
        status = run(arm.ctypes.data, pid.ctypes.data, SAMPLE_TIME, bench.scenario.samples)
        taken = per_sample(begin, bench.scenario)
    assert status == 0, status
    return taken


def bare_kernel(integrate: Callable[..., None], start: np.ndarray, inputs: np.ndarray) -> float:
    """The plant's integration alone, called from compiled code with the inputs of a real simulation."""
    memory = start.copy()
    begin = time.thread_time()
    integrate(memory, inputs, SAMPLE_TIME)
    return (time.thread_time() - begin) / len(inputs) * 1e6


# ---- What they need ----


def _c_slave(port: Port) -> np.ndarray:
    """``Slave`` of c_loop.c, whose members are all as wide as a pointer."""
    functions = (port.instance, port.set_values, port.do_step, port.get_values)
    return np.array([*functions, port.inputs.ctypes.data, port.outputs.ctypes.data, port.outputs.size], dtype=np.uintp)


def plant_inputs(scenario: Scenario, trajectory: Trajectory) -> np.ndarray:
    """What the plant was driven by in each sample of a simulation, shape (samples, 6)."""
    delayed = np.vstack([trajectory.u_m0, trajectory.torque[:-1]])
    chirp = scenarios.chirp_signal(scenario.chirp, scenario.again)
    pulse = scenarios.pulse_signal(scenario.pulse, scenario.again)
    acting = [(*signals.chirp(chirp, t), *signals.pulse(pulse, t)) for t in trajectory.time[:-1]]
    return np.hstack([delayed, acting])


def kernel(plant: Slave, scenario: Scenario) -> tuple[Callable[..., None], np.ndarray]:
    """The plant's integration over many samples as a compiled function, and its memory at the start of ``scenario``.

    The modules are the FMU's own, from where it was extracted to: the machine code is that of the FMU.
    """
    sys.path.insert(0, str(plant.archive.folder / "resources"))
    coefficients, equilibrium, integrator = (
        importlib.import_module(f"flexible_manipulator.{name}")
        for name in ("coefficients", "equilibrium", "integrator")
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


def _stub_plant(folder: Path) -> Path:
    """An FMU with the variables of the manipulator in C that does next to nothing."""
    header, description = folder / "interface.h", folder / "modelDescription.xml"
    header.write_text(interface.header(), encoding="utf-8")
    description.write_bytes(to_bytes(interface.description(model_exchange=False)))
    return build_fmus.c_fmu([HERE / "stub_plant.c", header], description, folder / "StubPlant.fmu")


def set_up(folder: Path, duration: float) -> Bench:
    """Build and load what is needed, into ``folder``."""
    plant, controller = (build_fmus.build(name, folder) for name in ("FlexibleManipulator", "DiagonalPID_C"))
    slaves = [load(open_archive(file)) for file in (plant, _stub_plant(folder), controller)]
    paper = protocols.load("paper")
    test = paper.test("disturbance")
    system = case_list.system(paper, NOMINAL, 0, 4, "random_1", test)
    case = case_list.case(paper, case_list.grid(paper)[4], system, test, 0)
    return Bench(*slaves, replace(case.scenario, duration=seconds(duration)))


def parsed(description: str, arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options ``rounds`` and ``seconds``."""
    parser = argparse.ArgumentParser(description=description.split("\n\n")[0])
    parser.add_argument("--rounds", type=int, default=9, help="how often each contender runs (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=26.0, help="simulated time of a run (default: %(default)s)")
    return parser.parse_args(arguments)


# ---- Comparison ----

MASTER = "master, plant FMU + C PID, all imperfections"
PYTHON = "Python loop over FMPy, plant FMU + C PID, disturbances alone"
KERNEL = "plant kernel alone, compiled loop"
MASTER_STUB = "master, C plant stub + C PID, all imperfections"
C_STUB = "C loop, C plant stub + C PID, nothing else"


def report(results: list[dict[str, float]]) -> bool:
    """Print medians and the comparisons with their targets; returns whether all are met."""
    print("us per sample (median)")
    for name in results[0]:
        print(f"  {median(results, lambda times: times[name]):8.3f}  {name}")  # noqa: B023
    comparisons = (
        ("master / Python loop", "ratio", 1 / 4, lambda t: t[MASTER] / t[PYTHON]),
        ("(master - plant kernel) / Python loop", "ratio", 1 / 6, lambda t: (t[MASTER] - t[KERNEL]) / t[PYTHON]),
        ("master - C loop, stub plant", "us", 0.2, lambda t: t[MASTER_STUB] - t[C_STUB]),
        ("master / C loop, stub plant", "ratio", 3.0, lambda t: t[MASTER_STUB] / t[C_STUB]),
    )
    met = True
    print("comparison within a round (median), target")
    for name, unit, target, of in comparisons:
        value = median(results, of)
        met = met and value <= target
        print(f"  {value:8.3f} <= {target:.3f} {unit:5}  {'met' if value <= target else 'MISSED':6}  {name}")
    return met


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns 0 where all targets are met, else 1."""
    options = parsed(__doc__ or "", arguments)
    with tempfile.TemporaryDirectory(prefix="loop_speed_") as folder:
        bench, run = set_up(Path(folder), options.seconds), _compiled_c_loop(Path(folder))
        integrate, memory = kernel(bench.plant, bench.scenario)
        inputs = plant_inputs(bench.scenario, simulate(bench.plant, bench.controller, bench.scenario))
        disturbances = inputs[:, 2:].tolist()
        contenders: dict[str, Contender] = {
            MASTER: lambda: master(bench.plant, bench.controller, bench.scenario),
            PYTHON: lambda: python_loop(bench, disturbances),
            KERNEL: lambda: bare_kernel(integrate, memory, inputs),
            MASTER_STUB: lambda: master(bench.stub_plant, bench.controller, bench.scenario),
            C_STUB: lambda: c_loop(bench, run),
        }
        return 0 if report(measure(contenders, options.rounds)) else 1


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pythonfmu's libraries must not be torn down with the interpreter
