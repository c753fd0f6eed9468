"""How much time the plant takes in C, in Python, and without FMI.

    python benchmarks/plant_speed.py
    python benchmarks/plant_speed.py --rounds 15 --seconds 26

Needs a C compiler. In every round each contender runs once, one after the other in one process; medians over the
rounds and ratios within a round are printed. All times are microseconds of the processor's time per step of 0.25 ms,
in the benchmark's ``disturbance`` case. "Alone" is a compiled loop that sets six inputs, steps, and reads four outputs
in each sample; "in the master" is the closed loop with the PID in C and all imperfections.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
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
            "kernel, without FMI": lambda: loop_speed.bare_kernel(integrate, at_rest, inputs),
            "native plant alone": lambda: alone(native, scenario, inputs),
            "Python plant alone": lambda: alone(python, scenario, inputs),
            "native plant in the master": lambda: loop_speed.master(native, controller, scenario),
            "Python plant in the master": lambda: loop_speed.master(python, controller, scenario),
        }
        results = loop_speed.measure(contenders, options.rounds)
    print("us per step (median, minimum), ratio to the kernel within a round (median)")
    for name in contenders:
        times = [times[name] for times in results]
        ratio = statistics.median(times[name] / times["kernel, without FMI"] for times in results)
        print(f"  {statistics.median(times):6.3f} {min(times):6.3f} {ratio:6.2f}  {name}")
    return 0


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pythonfmu's libraries must not be torn down with the interpreter
