"""Options that several commands share, and what they mean to the library."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..api.benchmark import Benchmark
from ..benchmark import protocol
from ..codec import Scalar
from ..errors import InputError
from ..execution.cluster import WAIT
from ..fmi.controller_files import read_mapped_parameters, read_mapping, read_parameters
from ..fmi.library import LIBRARIES
from ..pairing.built_in import DEFAULT_CONTROLLER, DEFAULT_IN_C, FILE, PLANT, PLANT_IN_C
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed, available_cores
from ..text import printable
from .values import MAX_LIMIT, Parser, assignments, connection, natural, number, seeds, setting, time


def add_protocol(parser: Parser, several_seeds: bool = False, default: str = "paper") -> None:
    """Options that determine the cases; with ``several_seeds``, the command takes several seeds at once."""
    parser.add_argument(
        "--protocol",
        default=default,
        metavar="NAME",
        help=f"one of: {', '.join(protocol.names())}; or a protocol file (.toml) (default: {default})",
    )
    group = parser.add_mutually_exclusive_group()
    # A default of 0 would hide that 0 was given beside the other.
    group.add_argument("--seed", type=natural(), metavar="N", help="base seed of random systems and noise (default: 0)")
    if several_seeds:
        group.add_argument(
            "--seeds",
            type=seeds,
            metavar="LIST",
            help="evaluate with each of these, such as 0-9 or 0,3,5-7: mean and standard deviation",
        )
    parser.rare.add_argument(
        "--plant-set",
        action="extend",
        default=[],
        type=assignments,
        metavar="NAME=VALUE",
        dest="plant_parameters",
        help="a nominal parameter of the plant, such as k_high[2]=0.5e6, or several, separated by commas; may be given "
        "again",
    )
    parser.rare.add_argument(
        "--plant",
        default="auto",
        metavar="PLANT",
        help="python or native, the same manipulator in Python or in C, or an FMU of your own (default: native where "
        "there is a compiler that gives the same bits, else python)",
    )


def add_setting(parser: Parser) -> None:
    """``--set``, as ``controller_parameters``: pairs of a name and a value."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=setting,
        metavar="NAME=VALUE",
        dest="controller_parameters",
        help="a parameter of the controller, in the unit the FMU has for it, or a constant for an "
        "input that nothing drives; may be given again",
    )


def add_connection(parser: Parser) -> None:
    """``--map``, as ``connections``: pairs of a connector and a variable."""
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        type=connection,
        metavar="CONNECTOR=VARIABLE",
        dest="connections",
        help="which variable of the controller a connector is, such as q_m[1]=In1; may be given again",
    )


def add_controller(parser: Parser, which: str = "the controller to test (default: the paper's PID)") -> None:
    """Options for the controller (``which`` says what it is for), its parameters and connectors, and the limits of its
    processes."""
    parser.add_argument(
        "controller",
        nargs="?",
        type=Path,
        metavar="CONTROLLER.fmu",
        help=which,
    )
    add_setting(parser)
    parser.add_argument(
        "--parameters",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        dest="parameter_files",
        help="parameters of the controller from a .toml, .json, .ssv or .txt file; --set overrides it",
    )
    add_connection(parser)
    parser.rare.add_argument(
        "--mapping",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        dest="mapping_files",
        help="the same from a .toml or .ssm file; a .toml file may also have parameters",
    )
    parser.add_argument(
        "--sample-time",
        type=time,
        metavar="SECONDS",
        help="the controller's sample time (default: its own, else the benchmark's 0.00025)",
    )
    parser.rare.add_argument(
        "--library",
        choices=LIBRARIES,
        help="which library of the controller is loaded: its binary for this platform, one compiled of its sources, or "
        "its binary for Windows, under Wine (default: the first of these that can be)",
    )
    parser.rare.add_argument(
        "--timeout",
        type=number(most=MAX_LIMIT, above=0.0),
        default=Testbed.timeout,
        metavar="SECONDS",
        help="processor time limit of a simulation of 26 s, and of each step of the check; shorter simulations get a "
        "proportional limit, and all get some seconds to start; a simulation may wait, without computing, for twice "
        f"this time (default: {Testbed.timeout:g})",
    )
    parser.rare.add_argument(
        "--memory-limit",
        type=number(most=MAX_LIMIT, above=0.0),
        default=Testbed.memory_limit / 1e6,
        metavar="MB",
        help=f"memory that a simulation's process may use (default: {Testbed.memory_limit / 1e6:g})",
    )
    parser.add_argument(
        "--sandbox", action="store_true", help="run FMUs without network and with read-only files (needs bubblewrap)"
    )


def add_jobs(parser: Parser) -> None:
    """The option for the number of processes."""
    parser.add_argument(
        "--jobs", type=natural(1), default=available_cores(), metavar="N", help="processes (default: all cores)"
    )


def add_cluster(parser: Parser) -> None:
    """Options for a run on a cluster."""
    parser.rare.add_argument("--scheduler", metavar="ADDRESS", help="run on a Dask cluster, such as tcp://host:8786")
    parser.rare.add_argument(
        "--wait",
        type=number(most=MAX_LIMIT, above=0.0),
        default=WAIT,
        metavar="SECONDS",
        help=f"how long to wait for a silent cluster, or one without workers (default: {WAIT:g})",
    )


def varied(given: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """The values of ``--vary`` by name; raises :class:`InputError` for a parameter that is given twice."""
    refuse_repeated("--vary", given)
    return dict(given)


def refuse_idle(given: argparse.Namespace) -> None:
    """Raise :class:`InputError` for an option that would have no effect."""
    # An option that does nothing would be believed to have done something.
    if getattr(given, "wait", WAIT) != WAIT and given.scheduler is None:
        raise InputError("--wait is for a cluster: give --scheduler, too.", "contradiction", "--wait")
    if given.dry_run and getattr(given, "no_report", False):
        raise InputError("--dry-run writes nothing: leave out --no-report.", "contradiction", "--no-report")
    if given.dry_run and any(getattr(given, name, False) for name in ("figures", "parquet", "mat")):
        raise InputError("--dry-run writes nothing: leave out --figures, --parquet and --mat.", "contradiction")
    if given.dry_run and given.form:
        message = f"--dry-run has no tables: leave out --{given.form}, or give --json."
        raise InputError(message, "contradiction", f"--{given.form}")


def refuse_repeated(option: str, given: Sequence[tuple[str, Any]]) -> None:
    """Raise :class:`InputError` for a name that is given twice."""
    names = [name for name, _ in given]
    # argparse keeps both, and a mapping the last: which one was meant, nobody knows.
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{option} gives {twice[0]} more than once.", "repeated", option, twice[0])


def benchmark(options: argparse.Namespace) -> Benchmark:
    """The benchmark that the options describe; options that a command does not have keep their defaults."""
    refuse_repeated("--plant-set", getattr(options, "plant_parameters", ()))
    return Benchmark(
        protocol=getattr(options, "protocol", "paper"),
        seed=getattr(options, "seed", None) or 0,
        workers=getattr(options, "jobs", None),
        plant_parameters=dict(getattr(options, "plant_parameters", ())),
        plant=getattr(options, "plant", "auto"),
        timeout=options.timeout,
        memory_limit=options.memory_limit * 1e6,
        sandbox=options.sandbox,
        scheduler=getattr(options, "scheduler", None),
        wait=getattr(options, "wait", WAIT),
    )


def controller(options: argparse.Namespace) -> Controller:
    """The controller that files and options describe; options override files."""
    refuse_repeated("--map", options.connections)
    refuse_repeated("--set", options.controller_parameters)
    plain = Controller(options.controller, sample_time=options.sample_time, library=options.library)
    parameters: dict[str, Scalar] = {}
    for file in options.mapping_files:
        parameters.update(read_mapped_parameters(file, plain.archive))
    for file in options.parameter_files:
        # The FMU is opened for its units: an SSV may give a value in another one.
        parameters.update(read_parameters(file, plain.archive))
    mapping = {name: value for file in options.mapping_files for name, value in read_mapping(file).items()}
    return Controller(
        options.controller,
        {**parameters, **dict(options.controller_parameters)},
        {**mapping, **dict(options.connections)},
        options.sample_time,
        options.library,
    )


BUILDS = {
    f"{DEFAULT_CONTROLLER}.fmu": "the paper's PID, in Python, compiled by Numba",
    f"{DEFAULT_IN_C}.fmu": "the paper's PID, in C",
    f"{PLANT}.fmu": "in Python, compiled by Numba",
    f"{PLANT_IN_C}.fmu": "in C",
}


def announce(bench: Benchmark, given: Controller) -> None:
    """Name on standard error the FMUs that are simulated, and how those of the benchmark were built."""
    plant = bench.manipulator
    names = (given.file_name, given.file is None), (plant.archive.name, plant.build != FILE)
    told = (f"{printable(name)} ({BUILDS[name]})" if is_own else printable(name) for name, is_own in names)
    print("controller {}, plant {}".format(*told), file=sys.stderr)
