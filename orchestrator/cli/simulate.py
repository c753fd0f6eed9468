"""Simulate ONE case of the benchmark, or variations of it, and write signals (NPZ, CSV, MAT), a page and a plot."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..api.benchmark import Benchmark
from ..api.simulation import Simulation, beside, overlay
from ..benchmark.case import Case
from ..benchmark.variation import MAX_BITS, MAX_DURATION, Variation
from ..documents import case_file, simulations
from ..documents.files import SIMULATION, prepare_folder, write_bytes, write_text
from ..documents.results import Results
from ..errors import InputError
from ..fmi.library import WINE
from ..loop.trajectory import Status
from ..pairing.controller import Controller
from ..text import file_name
from ..views.page import page_html
from . import options, output
from .guard import EXIT_CODES, EXIT_INCOMPLETE, EXIT_OK
from .output import free
from .values import Parser, natural, number, time

if TYPE_CHECKING:
    from ..documents.ssp import Order  # loads Numba

EXAMPLES = """examples:
  flexible-manipulator simulate --undisturbed --force 500 --t-1 1 --t-2 1.5 --duration 6    # like Figure 9
  flexible-manipulator simulate --undisturbed --chirp-amplitude 1 -1                        # like Figure 10
  flexible-manipulator simulate my_controller.fmu --case c07.compliant.gain_1               # a case of an evaluation
  flexible-manipulator simulate --from runs/my_controller-paper --case c07.compliant.gain_1 # the same, as it was run
  flexible-manipulator simulate --configuration 45 -60 --system random_3 --plant-set "psi[2]=1e-3"
  flexible-manipulator simulate --ideal --torque-limit 5 3                                  # saturation alone
  flexible-manipulator simulate my_controller.fmu --with other.fmu --with "--gain 2 1"      # one page for all three

Each --with adds a simulation: the words in quotes are options of this command, in addition to the others or in their
place. If they name a controller, its parameters, mapping and sample time are those in the quotes alone. A single word
that begins with a dash needs an equals sign: --with=--ideal.

The direction of the force is an angle in the x,z plane, from the x axis towards the z axis.
"""

CONFIGURATION, SYSTEM, TEST = (18.0, -50.0), "nominal", "disturbance"
"""Which case is simulated if no option says so; angles in degrees."""


NUMBER = number()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    given = _parser().parse_args(words)
    _refuse_idle(given)
    run = Results.load(given.run) if given.run is not None else None
    bench = options.benchmark(given) if run is None else _benchmark_of(run, given)
    chosen = {name: _chosen(bench, run, separate) for name, separate in _simulations(given).items()}
    (controller, case), *others = chosen.values()
    named = {name or controller.file_name: pair for name, pair in chosen.items()}
    options.announce(bench, controller)
    if given.dry_run:
        for _, chosen_case in chosen.values():
            print(f"1 case to simulate: {chosen_case.id}, {float(chosen_case.scenario.duration):g} s")
        return EXIT_OK
    if given.export_ssp is not None:
        order: Order = "in-sequence" if given.in_sequence else "parallel"
        print(f"written: {bench.export_ssp(controller, case, given.export_ssp, order)}", file=sys.stderr)
    simulations = {name: bench.simulate(*pair) for name, pair in named.items()}
    first, *_ = simulations.values()
    folder = given.output_dir or Path("runs") / (_folder_name(controller, bench, first) + ("-beside" if others else ""))
    if given.output_dir is None:
        folder = free(folder)
    prepare_folder(folder)
    command = f"{_parser().prog} {shlex.join(words)}".strip()
    written = [name for numbered in enumerate(simulations.values()) for name in _write(bench, *numbered, folder, given)]
    write_text(folder / SIMULATION, page_html(overlay(simulations, dict.fromkeys(simulations, command))))
    results = [simulation.result for simulation in simulations.values()]
    output.put(beside(simulations), given, results if others else results[0])
    output.tell_written(folder, [*written, SIMULATION])
    fine = all(simulation.ending.status in (Status.DONE, Status.UNSTABLE) for simulation in simulations.values())
    return EXIT_OK if fine else EXIT_INCOMPLETE


def _simulations(given: argparse.Namespace) -> dict[str, argparse.Namespace]:
    """What each simulation is given, by its name; that of the first one is empty."""
    by_name = {"": given}
    for words in given.beside:
        try:
            split = shlex.split(words)
        except ValueError as problem:
            raise InputError(f"--with {words}: {problem}.", "bad-words", "--with", words) from None
        separate = _parser().parse_args(split)
        # Parameters of the first controller mean nothing to another one.
        kept = vars(given) if separate.controller is None else {**vars(given), **_controllers_own(separate)}
        # A second time, now on top of the options of the first: only what the words name differs between the two.
        merged = _parser().parse_args(split, argparse.Namespace(**kept))
        merged.controller = separate.controller or given.controller
        if separate.beside or separate.run is not None:
            raise InputError("--with cannot hold --with or --from.", "contradiction", "--with", words)
        name = (
            words if separate.controller is None else words.replace(str(separate.controller), separate.controller.name)
        )
        if name in by_name:
            raise InputError(f"--with gives {name} more than once.", "repeated", "--with", words)
        by_name[name] = merged
    return by_name


def _controllers_own(given: argparse.Namespace) -> dict[str, Any]:
    """What another controller is given in the place of the first one's, before its own options are read."""
    lists = ("controller_parameters", "parameter_files", "connections", "mapping_files")
    return {**dict.fromkeys(("controller", "sample_time")), **{name: [] for name in lists}}


def _chosen(bench: Benchmark, run: Results | None, given: argparse.Namespace) -> tuple[Controller, Case]:
    """The controller and the case of a simulation."""
    controller = options.controller(given) if run is None else _controller_of(run, given)
    changes = variation(given)
    case = _case(bench, given)
    return controller, bench.varied(case, changes) if changes != Variation() else case


def _write(bench: Benchmark, number: int, simulation: Simulation, folder: Path, given: argparse.Namespace) -> list[str]:
    """Write what was asked for of the simulation with this ``number``; returns the names of the files."""
    end = f"-{number + 1}" if number else ""
    table = simulation.columns()
    writers = {
        f"trajectory{end}.npz": (True, simulations.write_npz),
        f"trajectory{end}.csv": (given.csv, simulations.write_csv),
        f"trajectory{end}.mat": (given.mat, simulations.write_mat),
    }
    written = [name for name, (asked, _) in writers.items() if asked]
    for name in written:
        writers[name][1](table, folder / name)
    if given.record:
        contents = simulation.case, simulation.controller, bench.nominal, simulation.trajectory, simulation.result
        record = Path(case_file.NAME).with_stem(Path(case_file.NAME).stem + end).name
        write_bytes(folder / record, case_file.packed(bench.rules, *contents))
        written.append(record)
    picture = f"trajectory{end}.png"
    simulations.write_plot(simulation.plot(), folder / picture)
    return [*written, picture]


def _folder_name(controller: Controller, bench: Benchmark, simulation: Simulation) -> str:
    protocol = f"-{bench.rules.name}" if bench.rules.name != "paper" else ""
    seed = f"-seed{bench.seed}" if bench.seed else ""
    varied = "-varied" if simulation.varied else ""
    pose = simulation.case.configuration
    # Off the grid, the name of the case is "free" for all poses.
    angles = f"-{math.degrees(pose.q_a1):g}_{math.degrees(pose.q_a2):g}" if pose.index < 0 else ""
    return file_name(f"{controller.name}{protocol}{seed}-{simulation.case.id}{angles}{varied}")


def again(folder: Path, id: str) -> Simulation:
    """The case ``id`` of the run in ``folder``, simulated as it was there; raises what :meth:`.Benchmark.simulate`
    raises, and :class:`InputError` if controller or plant have other contents today."""
    given = _parser().parse_args(["--from", str(folder), "--case", id])
    run = Results.load(folder)
    bench = _benchmark_of(run, given)
    return bench.simulate(_controller_of(run, given), _case(bench, given))


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
    # By contents: the path may hold another plant today.
    if bench.manipulator.model != run.plant.model:
        raise InputError(f"The plant of that run, {run.plant.file}, has other contents.", "other-plant", run.plant.file)
    return bench


def _controller_of(run: Results, given: argparse.Namespace) -> Controller:
    """The controller of an earlier run, as it was used there."""
    record = run.controller
    file = given.controller or (Path(record.path) if record.path else None)
    sample_time = None if run.sample_time.as_in_benchmark else run.sample_time.seconds
    # Which of the others is taken, this machine decides; Wine's mathematics are part of the numbers.
    library = given.library or (record.library if record.library == WINE else None)
    controller = Controller(file, record.parameters, record.mapping, given.sample_time or sample_time, library)
    # The same name with other contents would repeat another controller.
    if file is not None and controller.archive.sha256 != record.sha256:
        raise InputError(f"{file} is not the controller of that run: its contents differ.", "other-controller", file)
    return controller


def _refuse_idle(given: argparse.Namespace) -> None:
    """Raise :class:`InputError` for what ``--from`` says already, and for what says something of no package."""
    if given.in_sequence and given.export_ssp is None:
        raise InputError("--in-sequence says how a tool runs the SSP package. Give --export-ssp too.", "contradiction")
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


def _parser() -> Parser:
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
    add_variation_options(parser)
    parser.add_argument(
        "--with",
        dest="beside",
        action="append",
        default=[],
        metavar="WORDS",
        help="another simulation on the same page: a controller, options of this command in quotes, or both; may be "
        "given again",
    )
    parser.add_argument("--output-dir", type=Path, metavar="FOLDER", help="where to write (default: a new one in runs)")
    parser.rare.add_argument(
        "--csv", action="store_true", help="write trajectory.csv too: 100,000 lines for a whole case"
    )
    parser.rare.add_argument(
        "--record", action="store_true", help="write case.npz too, which python -m orchestrator.recheck computes anew"
    )
    parser.rare.add_argument("--mat", action="store_true", help="write trajectory.mat too, for MATLAB")
    shown = output.add_options(parser, "the result of the case", forms=False)
    output.add_dry_run(shown, "which case would be simulated")
    parser.rare.add_argument(
        "--export-ssp", type=Path, metavar="FILE", help="write the closed loop as an SSP package too, for other tools"
    )
    parser.rare.add_argument(
        "--in-sequence", action="store_true", help="for --export-ssp: the tool exchanges in sequence (OMSimulator)"
    )
    return parser


def add_variation_options(parser: Parser) -> None:
    """Add the options; :func:`variation` reads them. Each is a field of :class:`Variation`."""
    group = parser.add_rare_group("disturbances and imperfections", "SI units; 0 switches off unless said otherwise")

    def pair(name: str, text: str, kind: Any = NUMBER, metavar: tuple[str, str] = ("AXIS1", "AXIS2")) -> None:
        group.add_argument(name, nargs=2, type=kind, metavar=metavar, help=text)

    def single(name: str, text: str, kind: Any = NUMBER) -> None:
        group.add_argument(name, type=kind, metavar="VALUE", help=text)

    group.add_argument("--undisturbed", action="store_true", help="no chirp and no force but those given")
    group.add_argument("--ideal", action="store_true", help="no noise, quantization, saturation, delay but those given")
    single("--duration", f"length of the simulation [s], up to {MAX_DURATION}", time)
    single("--noise-power", "P_n of the measurement noise", number(0.0))
    single("--angle-bits", "steps of a motor revolution, as a power of two", natural(most=MAX_BITS))
    single("--torque-bits", "steps of the torque range, as a power of two", natural(most=MAX_BITS))
    pair("--torque-limit", "saturation [N.m] (inf: none)", number(0.0, infinite=True))
    pair("--delay", "transport delay from controller to motor, T_d included [s]", time)
    pair("--sensor-delay", "transport delay of the measurement [s]", time)
    single("--dropout", "probability that the torques of a sample are lost and the former held", number(0.0, most=1.0))
    single("--jitter", "largest random time by which angles are measured before their sample [s]", time)
    pair("--gain", "loop gain about the initial torque (1: none)")
    pair("--chirp-amplitude", "amplitude of the motor torque disturbance [N.m]")
    pair("--chirp-frequencies", "its frequencies [Hz]", number(0.0), ("START", "END"))
    single("--t-3", "start of the chirp [s]")
    single("--t-4", "end of the chirp [s]")
    single("--force", "tool force [N]")
    direction = group.add_mutually_exclusive_group()
    direction.add_argument("--phi-F", type=NUMBER, metavar="RADIANS", help="its direction [rad]")
    direction.add_argument(
        "--force-direction",
        dest="phi_F",
        type=lambda word: math.radians(NUMBER(word)),
        metavar="DEGREES",
        help="the same in degrees",
    )
    single("--t-1", "start of the force [s]")
    single("--t-2", "end of the force [s]")


def variation(given: argparse.Namespace) -> Variation:
    """The variation that the options describe."""
    values: dict[str, Any] = {field.name: getattr(given, field.name) for field in fields(Variation)}
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
    return Variation(**values)
