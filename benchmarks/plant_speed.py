"""How much time the plant takes in C, in Python, and without FMI; and the master beside others on the same FMUs.

    python benchmarks/plant_speed.py
    python benchmarks/plant_speed.py --rounds 15 --seconds 26

Needs a C compiler. In every round each contender runs once, one after the other in one process; medians over the
rounds and ratios within a round are printed. All times are microseconds of the processor's time per step of 0.25 ms,
in the benchmark's ``disturbance`` case. "Alone" is a compiled loop that sets six inputs, steps, and reads four outputs
in each sample; "in the master" is the closed loop with the PID in C and all imperfections. Other masters, ecos (pip
install ecospy tbb) and a Python loop over FMPy, do nothing on the connections, and only their steps are timed. The exit
code is 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib.metadata import files
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]

import loop_speed  # noqa: E402
import numba  # noqa: E402
import numpy as np  # noqa: E402

import build_fmus  # noqa: E402
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.connectors import PLANT, bind  # noqa: E402
from orchestrator.fmi.lookup import find_parameters  # noqa: E402
from orchestrator.fmi.port import WARNING, Port, exchange  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.loop.scenario import Scenario  # noqa: E402

KERNEL, MASTER = "kernel, without FMI", "native plant in the master"
FMPY, ECOS = "native plant in a Python loop over FMPy", "native plant in ecos"
TARGETS = {KERNEL: 1.3, ECOS: 0.35, FMPY: 0.1}
"""Largest time of the master, in times of these."""


@numba.njit
def _steps(port: Port, inputs: np.ndarray, step: float) -> int:
    worst = 0
    for k in range(inputs.shape[0]):
        port.input_values[:] = inputs[k]
        _, status = exchange(port, 6, k * step, step, True)
        worst = max(worst, status)
    return worst


def alone(plant: Slave, scenario: Scenario, inputs: np.ndarray) -> float:
    """The plant's FMU, driven by the inputs of a real simulation."""
    binding = bind(plant.archive.description, PLANT, "The plant")
    parameters = find_parameters(plant.archive.description, dict(scenario.parameters), "The plant")
    driven, read = (
        [variable for name in names for variable in binding[name].variables]
        for names in (("u_m", "u_d", "F"), ("q_m", "X"))
    )
    with plant.instantiated(len(inputs) * loop_speed.SAMPLE_TIME):
        plant.initialize(parameters, {})
        port = plant.port(driven, read)
        begin = time.thread_time()
        status = _steps(port, inputs, loop_speed.SAMPLE_TIME)
        taken = (time.thread_time() - begin) / len(inputs) * 1e6
        assert status <= WARNING, status
        plant.terminate()
    return taken


def ecos(plant: Path, controller: Path, scenario: Scenario) -> float:
    """The fixed-step algorithm of ecos, whose threads are counted."""
    library = next(file for file in files("tbb") or () if file.name == "libtbb.so.12")
    ctypes.CDLL(str(library.locate()), mode=ctypes.RTLD_GLOBAL)  # the dynamic linker would not find it in its package
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        structure.add_model("arm", plant)
        structure.add_model("pid", controller)
        for axis in ("[1]", "[2]"):
            structure.make_real_connection(f"arm::q_m{axis}", f"pid::q_m{axis}")
            structure.make_real_connection(f"pid::u_m{axis}", f"arm::u_m{axis}")
        structure.add_parameter_set("start", {f"arm::{name}": value for name, value in scenario.parameters})
        with EcosSimulation(structure=structure, step_size=loop_speed.SAMPLE_TIME) as simulation:
            simulation.init(parameter_set="start")
            begin = time.process_time()
            for _ in range(scenario.samples):
                simulation.step()
            taken = (time.process_time() - begin) / scenario.samples * 1e6
            simulation.terminate()
    return taken


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--rounds", type=int, default=9, help="how often each contender runs (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=26.0, help="simulated time of a run (default: %(default)s)")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="plant_speed_") as folder:
        bench = loop_speed.set_up(Path(folder), options.seconds)
        native = load(open_archive(build_fmus.build("FlexibleManipulatorNative", Path(folder))))
        python, controller, scenario = bench.plant, bench.controller, bench.scenario
        integrate, at_rest = loop_speed._kernel(python.archive, scenario)
        inputs = loop_speed._plant_inputs(scenario, simulate(python, controller, scenario))
        contenders: dict[str, loop_speed.Contender] = {
            KERNEL: lambda: loop_speed.bare_kernel(integrate, at_rest, inputs),
            "native plant alone": lambda: alone(native, scenario, inputs),
            "Python plant alone": lambda: alone(python, scenario, inputs),
            MASTER: lambda: loop_speed.master(native, controller, scenario),
            "Python plant in the master": lambda: loop_speed.master(python, controller, scenario),
        }
        disturbances = inputs[:, 2:].tolist()
        contenders[FMPY] = lambda: loop_speed.python_loop(native.archive, controller.archive, scenario, disturbances)
        if find_spec("ecospy"):
            contenders[ECOS] = lambda: ecos(native.archive.file, controller.archive.file, scenario)
        results = loop_speed.measure(contenders, options.rounds)
    print("us per step (median, minimum), ratio to the kernel within a round (median)")
    for name in contenders:
        times = [times[name] for times in results]
        ratio = statistics.median(times[name] / times[KERNEL] for times in results)
        print(f"  {statistics.median(times):6.3f} {min(times):6.3f} {ratio:6.2f}  {name}")
    met = True
    print("native plant in the master, as a ratio to (median within a round), target")
    for name, target in TARGETS.items():
        if name in contenders:
            ratio = statistics.median(times[MASTER] / times[name] for times in results)
            met = met and ratio <= target
            print(f"  {ratio:6.3f} <= {target:<5g} {'met' if ratio <= target else 'MISSED':6}  {name}")
    return 0 if met else 1


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pythonfmu's libraries must not be torn down with the interpreter
