"""Simulate ONE case of the benchmark, or a variation of it, and write its trajectory as CSV and plot.

python -m orchestrator.simulate my_controller.fmu --case c07.compliant.disturbance
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from . import commands
from .benchmark import protocol as protocols
from .benchmark.case import Case
from .benchmark.metrics import measure
from .benchmark.protocol import Protocol
from .cosim.sampling import controller_sample_time
from .cosim.trajectory import Status
from .errors import InputError
from .execution.evaluation import simulate_isolated
from .report import trajectory_files
from .report.files import prepare_folder
from .variation import add_options, vary

EXAMPLES = """examples:
  python -m orchestrator.simulate --undisturbed --force 500 --t-1 1 --t-2 1.5 --duration 6    like Figure 9
  python -m orchestrator.simulate --undisturbed --chirp-amplitude 1 -1                        like Figure 10
  python -m orchestrator.simulate my_controller.fmu --case c07.compliant.gain_1               a case of an evaluation
  python -m orchestrator.simulate --configuration 45 -60 --system random_3 --plant-set psi[2]=1e-3
  python -m orchestrator.simulate --ideal --torque-limit 5 3                                  saturation alone
"""

CONFIGURATION, SYSTEM, TEST = (18.0, -50.0), "nominal", "disturbance"
"""Which case is simulated where no option says so; angles in degrees."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = _parser().parse_args(arguments)
    protocol = protocols.load(options.protocol)
    bench = commands.bench(options)
    controller = bench.controller
    nominal = commands.nominal_parameters(bench.plant, dict(options.plant_parameters))
    case = _case(protocol, nominal, options)
    sample_time = controller_sample_time(controller, case.scenario.sample_time, options.sample_time)
    scenario = vary(replace(case.scenario, sample_time=sample_time.value), protocol, options)
    folder = options.output_dir or Path("runs") / f"{controller.file.stem}-{case.id}"
    prepare_folder(folder)

    trajectory = simulate_isolated(scenario, bench, trajectory_files.OBSERVED)
    units = {criterion.name: criterion.unit for criterion in protocol.criteria}
    pose = " / ".join(f"{math.degrees(angle):g}°" for angle in (case.configuration.q_a1, case.configuration.q_a2))
    title = f"{controller.name}, {case.system.name} system at {pose}, {case.test.name}"
    table = trajectory_files.columns(trajectory, scenario)
    trajectory_files.write_csv(table, folder / "trajectory.csv")
    if options.mat:
        trajectory_files.write_mat(table, folder / "trajectory.mat")
    trajectory_files.write_plot(trajectory, scenario, title, [folder / "trajectory.png"])

    ending = trajectory.ending
    print(title)
    print(f"{ending.status.value} at {ending.time:g} s" + (f": {ending.message}" if ending.message else ""))
    print(f"largest TCP error {trajectory.tcp_error.max() * 1e3:.4g} mm")
    if ending.status is Status.DONE and scenario == case.scenario:
        for name, value in measure(protocol, case, trajectory).criteria.items():
            print(f"{name} = {value:.6g} {units[name]}")
    written = ["trajectory.csv", "trajectory.png", *(["trajectory.mat"] if options.mat else [])]
    print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)
    return commands.EXIT_OK if ending.status in (Status.DONE, Status.UNSTABLE) else commands.EXIT_INCOMPLETE


def _case(protocol: Protocol, nominal: dict[str, float], options: argparse.Namespace) -> Case:
    """The case that the options name, before it is varied."""
    if options.case:
        beside = [f"--{name}" for name in ("configuration", "system", "test") if getattr(options, name) is not None]
        if beside:
            raise InputError(f"--case already says what {' and '.join(beside)} would. Give the one or the others.")
        match = re.fullmatch(r"c(\d+)\.(\w+)\.(\w+)", options.case)
        if not match or int(match[1]) >= len(protocol.grid):
            raise InputError(
                f"There is no case {options.case} in the protocol {protocol.name}. A case is named like "
                f"c{len(protocol.grid) - 1:02d}.compliant.disturbance: configuration, system, test."
            )
        configuration, system_name, test_name = protocol.grid[int(match[1])], match[2], match[3]
    else:
        system_name, test_name = options.system or SYSTEM, options.test or TEST
        q_a1, q_a2 = (math.radians(angle) for angle in options.configuration or CONFIGURATION)
        configuration = protocols.configuration(protocol, q_a1, q_a2)
    test = protocol.test(test_name)
    system = protocols.system(protocol, nominal, options.seed, configuration.index, system_name, test)
    return protocols.case(protocol, configuration, system, test, options.seed)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m orchestrator.simulate",
        description="Simulate one case of the benchmark, or a variation of it.",
        epilog=EXAMPLES + "\n" + commands.EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands.add_common(parser)
    which = parser.add_argument_group("which case")
    which.add_argument("--case", metavar="ID", help="a case of an evaluation, such as c07.compliant.gain_1")
    which.add_argument(
        "--configuration",
        nargs=2,
        type=commands.number(),
        metavar=("Q_A1", "Q_A2"),
        help="link angles in degrees (default: 18 -50, a pose of the grid)",
    )
    which.add_argument("--system", metavar="NAME", help="nominal (default), compliant, slippery, sticky, random_1, ...")
    which.add_argument("--test", metavar="NAME", help="a test of the protocol, such as gain_1 (default: disturbance)")
    add_options(parser)
    parser.add_argument("--output-dir", type=Path, metavar="FOLDER", help="where to write (default: runs/...)")
    parser.add_argument("--mat", action="store_true", help="write trajectory.mat too, for MATLAB")
    return parser


if __name__ == "__main__":
    raise SystemExit(commands.guarded(main))
