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

import ctypes
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import files
from importlib.util import find_spec
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

import numpy as np  # noqa: E402

import build_fmus  # noqa: E402
from benchmarks import loop_speed  # noqa: E402
from benchmarks.common import Contender, at_rest, drive, measure, median  # noqa: E402
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.port import WARNING  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.loop.scenario import Scenario  # noqa: E402

KERNEL, MASTER = "kernel, without FMI", "native plant in the master"
FMPY, ECOS = "native plant in a Python loop over FMPy", "native plant in ecos"
TARGETS = {KERNEL: 1.3, ECOS: 0.35, FMPY: 0.1}
"""Largest time of the master, in times of these."""


def alone(plant: Slave, scenario: Scenario, inputs: np.ndarray) -> float:
    """The plant's FMU, driven by the inputs of a real simulation."""
    with at_rest(plant, scenario) as (port, _):
        begin = time.thread_time()
        status = drive(port, inputs, loop_speed.SAMPLE_TIME)
        taken = loop_speed.per_sample(begin, scenario)
        assert status <= WARNING, status
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
    options = loop_speed.parsed(__doc__ or "", arguments)
    with tempfile.TemporaryDirectory(prefix="plant_speed_") as folder:
        bench = loop_speed.set_up(Path(folder), options.seconds)
        native = load(open_archive(build_fmus.build("FlexibleManipulatorNative", Path(folder))))
        python, controller, scenario = bench.plant, bench.controller, bench.scenario
        integrate, memory = loop_speed.kernel(python, scenario)
        inputs = loop_speed.plant_inputs(scenario, simulate(python, controller, scenario))
        contenders: dict[str, Contender] = {
            KERNEL: lambda: loop_speed.bare_kernel(integrate, memory, inputs),
            "native plant alone": lambda: alone(native, scenario, inputs),
            "Python plant alone": lambda: alone(python, scenario, inputs),
            MASTER: lambda: loop_speed.master(native, controller, scenario),
            "Python plant in the master": lambda: loop_speed.master(python, controller, scenario),
        }
        disturbances, foreign = inputs[:, 2:].tolist(), replace(bench, plant=native)
        contenders[FMPY] = lambda: loop_speed.python_loop(foreign, disturbances)
        if find_spec("ecospy"):
            contenders[ECOS] = lambda: ecos(native.archive.file, controller.archive.file, scenario)
        results = measure(contenders, options.rounds)
    print("us per step (median, minimum), ratio to the kernel within a round (median)")
    for name in contenders:
        taken = median(results, lambda times: times[name])  # noqa: B023
        ratio = median(results, lambda times: times[name] / times[KERNEL])  # noqa: B023
        print(f"  {taken:6.3f} {min(times[name] for times in results):6.3f} {ratio:6.2f}  {name}")
    met = True
    print("native plant in the master, as a ratio to (median within a round), target")
    for name, target in TARGETS.items():
        if name in contenders:
            ratio = median(results, lambda times: times[MASTER] / times[name])  # noqa: B023
            met = met and ratio <= target
            print(f"  {ratio:6.3f} <= {target:<5g} {'met' if ratio <= target else 'MISSED':6}  {name}")
    return 0 if met else 1


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pythonfmu's libraries must not be torn down with the interpreter
