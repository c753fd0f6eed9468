"""Simulate ONE case of the benchmark, or a variation of it, and write its signals (NPZ, CSV, MAT) and a plot."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..api.benchmark import Benchmark
from ..api.simulation import Simulation
from ..benchmark.case import Case
from ..benchmark.variation import Variation
from ..documents import case_file, trajectory_files
from ..documents.files import prepare_folder, write_bytes
from ..documents.results import Results
from ..errors import InputError
from ..fmi.archive import open_archive
from ..loop.trajectory import Status
from ..pairing.controller import Controller
from ..text import file_name
from . import options, output
from .guard import EXIT_CODES, EXIT_INCOMPLETE, EXIT_OK
from .output import free
from .values import Parser, number
from .variation import add_options, variation

EXAMPLES = """examples:
  python -m orchestrator.simulate --undisturbed --force 500 --t-1 1 --t-2 1.5 --duration 6    like Figure 9
  python -m orchestrator.simulate --undisturbed --chirp-amplitude 1 -1                        like Figure 10
  python -m orchestrator.simulate my_controller.fmu --case c07.compliant.gain_1               a case of an evaluation
  python -m orchestrator.simulate --from runs/my_controller-paper --case c07.compliant.gain_1 the same, as it was run
  python -m orchestrator.simulate --configuration 45 -60 --system random_3 --plant-set psi[2]=1e-3
  python -m orchestrator.simulate --ideal --torque-limit 5 3                                  saturation alone
"""

CONFIGURATION, SYSTEM, TEST = (18.0, -50.0), "nominal", "disturbance"
"""Which case is simulated if no option says so; angles in degrees."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    run = Results.load(given.run) if given.run is not None else None
    _refuse_idle(given)
    bench = options.benchmark(given) if run is None else _benchmark_of(run, given)
    controller = options.controller(given) if run is None else _controller_of(run, given)
    wanted = variation(given)
    case = _case(bench, given)
    case = bench.varied(case, wanted) if wanted != Variation() else case
    options.announce(bench, controller)
    if given.dry_run:
        print(f"1 case to simulate: {case.id}, {float(case.scenario.duration):g} s")
        return EXIT_OK
    if given.export_ssp is not None:
        print(f"written: {bench.export_ssp(controller, case, given.export_ssp)}", file=sys.stderr)
    simulation = bench.simulate(controller, case)
    folder = given.output_dir or Path("runs") / _folder_name(controller, bench, simulation)
    if given.output_dir is None:
        folder = free(folder)
    prepare_folder(folder)
    written = _write(bench, simulation, folder, given)
    output.put(simulation, given, simulation.result)
    output.tell_written(folder, written)
    return EXIT_OK if simulation.ending.status in (Status.DONE, Status.UNSTABLE) else EXIT_INCOMPLETE


def _write(bench: Benchmark, simulation: Simulation, folder: Path, given: argparse.Namespace) -> list[str]:
    """Write what was asked for; returns the names of the files."""
    table = simulation.columns()
    writers = {
        "trajectory.npz": (True, trajectory_files.write_npz),
        "trajectory.csv": (given.csv, trajectory_files.write_csv),
        "trajectory.mat": (given.mat, trajectory_files.write_mat),
    }
    written = [name for name, (wanted, _) in writers.items() if wanted]
    for name in written:
        writers[name][1](table, folder / name)
    if given.record:
        own = simulation.case, simulation.controller, bench.nominal, simulation.trajectory, simulation.result
        write_bytes(folder / case_file.NAME, case_file.packed(bench.rules, *own))
        written.append(case_file.NAME)
    trajectory_files.write_plot(simulation.plot(), folder / "trajectory.png")
    return [*written, "trajectory.png"]


def _folder_name(controller: Controller, bench: Benchmark, simulation: Simulation) -> str:
    protocol = f"-{bench.rules.name}" if bench.rules.name != "paper" else ""
    seed = f"-seed{bench.seed}" if bench.seed else ""
    varied = "-varied" if simulation.varied else ""
    pose = simulation.case.configuration
    angles = f"-{math.degrees(pose.q_a1):g}_{math.degrees(pose.q_a2):g}" if pose.index < 0 else ""
    return file_name(f"{controller.name}{protocol}{seed}-{simulation.case.id}{angles}{varied}")


def _benchmark_of(run: Results, given: argparse.Namespace) -> Benchmark:
    """The benchmark of an earlier run, under the conditions given."""
    asked = options.benchmark(given)
    bench = replace(
        asked,
        protocol=run.head.protocol_file or run.protocol,
        seed=run.seed or 0,
        plant_parameters=run.plant.parameters,
        plant=asked.plant if asked.plant != "auto" else run.plant.path or run.plant.build,
    )
    if bench.manipulator.model != run.plant.model:
        raise InputError(f"The plant of that run, {run.plant.file}, has other contents.", "other-plant", run.plant.file)
    return bench


def _controller_of(run: Results, given: argparse.Namespace) -> Controller:
    """The controller of an earlier run, as it was used there."""
    record = run.controller
    file = given.controller or (Path(record.path) if record.path else None)
    own = None if run.sample_time.as_in_benchmark else run.sample_time.seconds
    controller = Controller(file, record.parameters, record.mapping, given.sample_time or own)
    if file is not None and open_archive(Path(file)).sha256 != record.sha256:
        raise InputError(f"{file} is not the controller of that run: its contents differ.", "other-controller", file)
    return controller


def _refuse_idle(given: argparse.Namespace) -> None:
    """Raise :class:`InputError` for what ``--from`` says already."""
    values = {
        "--protocol": given.protocol != "paper",
        "--seed": given.seed is not None,
        "--plant-set": given.plant_parameters,
        "--set": given.controller_parameters,
        "--parameters": given.parameter_files,
        "--map": given.connections,
        "--mapping": given.mapping_files,
    }
    beside = [name for name, value in values.items() if value]
    if given.run is not None and beside:
        message = f"--from already says what {' and '.join(beside)} would. Give the one or the others."
        raise InputError(message, "contradiction")


def _case(bench: Benchmark, given: argparse.Namespace) -> Case:
    """The case that the options name, before it is varied."""
    if given.case is None:
        q_a1, q_a2 = (math.radians(angle) for angle in given.configuration or CONFIGURATION)
        return bench.case_at((q_a1, q_a2), given.system or SYSTEM, given.test or TEST)
    beside = [f"--{name}" for name in ("configuration", "system", "test") if getattr(given, name) is not None]
    if beside:
        raise InputError(
            f"--case already says what {' and '.join(beside)} would. Give the one or the others.", "contradiction"
        )
    return bench.case(given.case)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        "simulate", "Simulate one case of the benchmark, or a variation of it.", EXAMPLES + "\n" + EXIT_CODES
    )
    options.add_controller(parser)
    options.add_protocol(parser)
    which = parser.add_argument_group("which case")
    which.add_argument("--case", metavar="ID", help="a case of an evaluation, such as c07.compliant.gain_1")
    which.add_argument(
        "--from",
        dest="run",
        type=Path,
        metavar="RUN",
        help="the run of that case: its controller, protocol, seed and values are taken",
    )
    which.add_argument(
        "--configuration",
        nargs=2,
        type=number(),
        metavar=("Q_A1", "Q_A2"),
        help="link angles in degrees (default: 18 -50, in the middle of the workspace)",
    )
    which.add_argument("--system", metavar="NAME", help="nominal (default), compliant, slippery, sticky, random_1, ...")
    which.add_argument("--test", metavar="NAME", help="a test of the protocol, such as gain_1 (default: disturbance)")
    add_options(parser)
    parser.add_argument("--output-dir", type=Path, metavar="FOLDER", help="where to write (default: a new one in runs)")
    parser.add_argument("--csv", action="store_true", help="write trajectory.csv too: 100,000 lines for a whole case")
    parser.add_argument(
        "--record", action="store_true", help="write case.npz too, which python -m orchestrator.recheck computes anew"
    )
    parser.add_argument("--mat", action="store_true", help="write trajectory.mat too, for MATLAB")
    shown = output.add_options(parser, "the result of the case", forms=False)
    output.add_dry_run(shown, "which case would be simulated")
    parser.add_argument(
        "--export-ssp", type=Path, metavar="FILE", help="write the closed loop as an SSP package too, for other tools"
    )
    return parser
