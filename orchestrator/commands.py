"""What the command modules share: options, and the way from an error to an exit code."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

from plant_fmu.flexible_manipulator.parameters import NOMINAL, check

from .benchmark import protocol
from .cosim.archive import Archive, open_archive
from .cosim.controller import Setup
from .cosim.scenario import seconds
from .errors import BenchmarkError, FmuError, InputError
from .execution.evaluation import Bench
from .execution.job import Limits
from .fmus import DEFAULT_CONTROLLER, PLANT, own_fmu
from .settings import read_mapping, read_parameters

MOST = 1e9
"""Of limits: seconds and megabytes that the system can still count."""

EXIT_OK, EXIT_INCOMPLETE, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 0, 1, 2, 130

EXIT_CODES = """exit codes: 0 all cases have a verdict, 1 some have none or the run could not go on (a full disk, a lost
cluster, a crash), 2 bad input, 130 interrupted"""


def guarded(command: Callable[[Sequence[str] | None], int], arguments: Sequence[str] | None = None) -> int:
    """Run a command; an error made on purpose becomes one clear message and an exit code.

    An FMU's own refusal (:class:`FmuError`) comes this far only before the first sample: it is bad input.
    """
    try:
        code = command(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # who reads has read enough, as in a pipe to head; nothing more can be said there
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_INCOMPLETE
    except BenchmarkError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT if isinstance(error, InputError | FmuError) else EXIT_INCOMPLETE
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


def add_common(parser: argparse.ArgumentParser) -> None:
    """Options that both the evaluation and the single simulation have."""
    add_controller(parser)
    parser.add_argument(
        "--protocol", default="paper", metavar="NAME", help=f"one of: {', '.join(protocol.names())} (default: paper)"
    )
    parser.add_argument(
        "--seed", type=_natural, default=0, metavar="N", help="base seed of random systems and noise (default: 0)"
    )
    parser.add_argument(
        "--plant-set",
        action="append",
        default=[],
        type=assignment,
        metavar="NAME=VALUE",
        dest="plant_parameters",
        help="a nominal parameter of the plant, such as k_high[2]=0.5e6; may be given again",
    )


def add_controller(parser: argparse.ArgumentParser) -> None:
    """Options that say which controller is run, how it is used, and under which conditions."""
    parser.add_argument(
        "controller",
        nargs="?",
        type=Path,
        metavar="CONTROLLER.fmu",
        help="the controller to test (default: the paper's PID)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=assignment,
        metavar="NAME=VALUE",
        dest="controller_parameters",
        help="a parameter of the controller, in the unit the FMU has for it; may be given again",
    )
    parser.add_argument(
        "--parameters",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        dest="parameter_files",
        help="parameters of the controller from a .toml or .ssv file; --set goes above it",
    )
    parser.add_argument(
        "--map",
        action="append",
        default=[],
        type=_connection,
        metavar="CONNECTOR=VARIABLE",
        dest="connections",
        help="which variable of the controller a connector is, such as q_m[1]=In1; may be given again",
    )
    parser.add_argument(
        "--mapping",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        dest="mapping_files",
        help="the same from a .toml or .ssm file",
    )
    parser.add_argument(
        "--sample-time",
        type=time,
        metavar="SECONDS",
        help="the controller's sample time (default: its own, else the benchmark's 0.00025)",
    )
    parser.add_argument(
        "--timeout",
        type=_positive,
        default=60.0,
        metavar="SECONDS",
        help="wall time a simulation of 26 s, or a look of the check, may take; shorter simulations get their share, "
        "all some seconds to start (default: 60)",
    )
    parser.add_argument(
        "--memory-limit",
        type=_positive,
        default=2048.0,
        metavar="MB",
        help="memory a simulation's process may use (default: 2048)",
    )
    parser.add_argument(
        "--sandbox", action="store_true", help="run FMUs without network and with read-only files (needs bubblewrap)"
    )


def setup(options: argparse.Namespace, controller: Archive) -> Setup:
    """How the controller is used, from files and options; options go above files."""
    files = [read_parameters(file, controller) for file in options.parameter_files]
    parameters = {name: value for values in files for name, value in values.items()}
    mapping = {name: value for file in options.mapping_files for name, value in read_mapping(file).items()}
    given = [name for name, _ in options.connections]
    for name in given:
        if given.count(name) > 1:
            raise InputError(f"--map gives {name} more than once. Map it to one variable.")
    parameters.update(options.controller_parameters)
    for name, value in parameters.items():
        if not math.isfinite(value):
            raise InputError(f"The value of the parameter {name}, {value}, is no finite number.")
    return Setup(parameters, {**mapping, **dict(options.connections)})


def time(text: str) -> Fraction:
    """A non-negative time in seconds, exact: ``0.00025`` or ``1/3000``."""
    try:
        value = seconds(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no time in seconds, such as 0.00025 or 1/3000") from None
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative")
    return value


def _connection(text: str) -> tuple[str, str]:
    connector, equals, variable = text.partition("=")
    if not (equals and connector.strip() and variable.strip()):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form CONNECTOR=VARIABLE, such as q_m[1]=In1")
    return connector.strip(), variable.strip()


def _natural(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 0 on")
    return int(text)


def assignment(text: str) -> tuple[str, float]:
    """``NAME=VALUE`` as a pair."""
    name, equals, value = text.partition("=")
    try:
        if not equals or not name:
            raise ValueError
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=NUMBER, such as K_p[1]=45") from None


def number(least: float = -math.inf, infinite: bool = False, most: float = math.inf) -> Callable[[str], float]:
    """The type of an option: a finite number (or ``infinite``, too) from ``least`` to ``most``."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isnan(value) or (math.isinf(value) and not infinite):
            raise argparse.ArgumentTypeError(f"{text!r} is no finite number")
        if value < least:
            raise argparse.ArgumentTypeError(f"{text} is below {least:g}")
        if value > most:
            raise argparse.ArgumentTypeError(f"{text} is above {most:g}")
        return value

    return parse


def _positive(text: str) -> float:
    value = number(0.0, most=MOST)(text)
    if value == 0.0:
        raise argparse.ArgumentTypeError("0 is no positive number")
    return value


def bench(options: argparse.Namespace) -> Bench:
    """The FMUs that the options name, and the conditions they run under."""
    plant, controller = open_fmus(options.controller)
    limits = Limits(memory=int(options.memory_limit * 1e6))
    return Bench(plant, controller, setup(options, controller), options.timeout, limits, options.sandbox)


def open_fmus(controller: Path | None) -> tuple[Archive, Archive]:
    """The plant and the controller (default: the paper's PID), checked and extracted."""
    plant = open_archive(own_fmu(PLANT))
    return plant, open_archive(controller if controller is not None else own_fmu(DEFAULT_CONTROLLER))


def nominal_parameters(plant: Archive, changes: dict[str, float]) -> dict[str, float]:
    """The plant's parameters by FMI name, ``changes`` applied; raises :class:`InputError` for an unknown name or
    a value that no manipulator has."""
    values = {
        variable.name: float(variable.start)
        for variable in plant.description.modelVariables
        if variable.causality == "parameter"
    }
    unknown = sorted(set(changes) - set(NOMINAL))
    if unknown:
        raise InputError(
            f"--plant-set: the plant has no nominal parameter {unknown[0]}. It has: {', '.join(NOMINAL)}. "
            "Its link angles are those of the configuration."
        )
    nominal = {**values, **changes}
    try:
        check(nominal)
    except ValueError as problem:
        raise InputError(f"--plant-set: {problem}.") from None
    return nominal
