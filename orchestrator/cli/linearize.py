"""Linearize the plant at a pose: matrices as a file, modes, and plots; with a controller, margins of the loop."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..api.benchmark import Benchmark
from ..api.linear import MATRICES, LinearLoop, LinearModel
from ..documents.robustness import Robustness
from ..errors import InputError
from . import options, output
from .guard import EXIT_OK
from .values import Parser, number

EXAMPLES = """examples:
  flexible-manipulator linearize --configuration 45 -60 --output model.mat     # A, B, C, D with the loop's delay
  flexible-manipulator linearize --system random_3 --continuous                # its modes, not sampled
  flexible-manipulator linearize --test delay_2 --friction sliding             # with the delay of a test of A2
  flexible-manipulator linearize --plots plots                                 # Bode diagram, step response, poles
  flexible-manipulator linearize my_controller.fmu --plots plots               # the loop: margins, sensitivity, Nichols
  flexible-manipulator linearize gains.mat --robustness runs/gains-strict-robustness
                                                                               # beside the margins that a search found

exit codes: 0 done, 2 bad input"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    _refuse_idle(given)
    bench = options.benchmark(given)
    if given.controller is None:
        return _plant(bench, given)
    return _loop(bench, given)


def _pose(given: argparse.Namespace) -> tuple[float, float]:
    q_a1, q_a2 = (math.radians(angle) for angle in given.configuration)
    return q_a1, q_a2


def _plant(bench: Benchmark, given: argparse.Namespace) -> int:
    """The model of the plant alone."""
    model = bench.linearize(
        _pose(given),
        given.system,
        test=given.test,
        sampled=not given.continuous,
        delay=not given.no_delay,
        friction=given.friction or "sticking",
    )
    if given.output is not None and not given.dry_run:
        print(f"written to {model.save(given.output)}", file=sys.stderr)
    _draw(model, given)
    output.put(model, given, _document(model))
    return EXIT_OK


def _loop(bench: Benchmark, given: argparse.Namespace) -> int:
    """The loop with a controller, and what a search found beside it."""
    search_margins = {} if given.robustness is None else Robustness.load(given.robustness).margins
    is_matrices = given.controller.suffix in MATRICES
    controller = given.controller if is_matrices else options.controller(given)
    loop = bench.linear_loop(
        controller, _pose(given), given.system, test=given.test, friction=given.friction or "sliding"
    )
    _draw(loop, given)
    document = {
        **_document(loop.model),
        "controller": {name: getattr(loop.controller, name).tolist() for name in "ABCD"},
        "mismatch": loop.mismatch,
        "stable": loop.stable,
        "margins": [margin._asdict() for margin in loop.margins] if loop.stable else None,
        "found": search_margins,
        "modes": [mode._asdict() for mode in loop.modes],
    }
    output.put(loop.beside(search_margins), given, document)
    return EXIT_OK


def _draw(shown: LinearModel | LinearLoop, given: argparse.Namespace) -> None:
    """Write the plots that were asked for."""
    if given.plots is not None and not given.dry_run:
        output.tell_written(given.plots, (f"{name}.png" for name in shown.save_plots(given.plots)))


def _document(model: LinearModel) -> dict[str, Any]:
    return {name: getattr(model, name).tolist() for name in "ABCD"} | {
        "T_s": model.sample_time,
        "states": model.states,
        "inputs": model.inputs,
        "outputs": model.outputs,
        "at": model.at._asdict(),
        "modes": [mode._asdict() for mode in model.modes],
    }


def _refuse_idle(given: argparse.Namespace) -> None:
    """Raise :class:`InputError` for options that would have no effect."""
    if given.controller is None and given.robustness is not None:
        raise InputError("--robustness is for the loop with a controller: give one, too.", "contradiction")
    asked = {
        "--set": given.controller_parameters,
        "--parameters": given.parameter_files,
        "--map": given.connections,
        "--mapping": given.mapping_files,
        "--sample-time": given.sample_time,
        "--library": given.library,
    }
    idle = [name for name, value in asked.items() if value]
    if idle and (given.controller is None or given.controller.suffix in MATRICES):
        raise InputError(f"{' and '.join(idle)} would change an FMU, and none is given.", "contradiction")
    if given.controller is None:
        return
    beside = [f"--{name.replace('_', '-')}" for name in ("continuous", "no_delay", "output") if getattr(given, name)]
    if beside:
        message = f"{' and '.join(beside)} {'are' if len(beside) > 1 else 'is'} for the plant alone: leave that out."
        raise InputError(message, "contradiction")


def _parser() -> Parser:
    parser = Parser("linearize", "Linearize the plant at a pose, or its loop with a controller.", EXAMPLES)
    options.add_controller(
        parser, "an FMU, linearized at rest, or the matrices of a .mat, .npz or .json file (default: the plant alone)"
    )
    options.add_protocol(parser)
    which = parser.add_argument_group("which model")
    which.add_argument(
        "--configuration",
        nargs=2,
        type=number(),
        default=(18.0, -50.0),
        metavar=("Q_A1", "Q_A2"),
        help="link angles in degrees (default: 18 -50, in the middle of the workspace)",
    )
    which.add_argument(
        "--system", default="nominal", metavar="NAME", help="nominal (default), compliant, random_1, ..."
    )
    which.add_argument(
        "--test", default="disturbance", metavar="NAME", help="whose gain and delay the loop has (default: disturbance)"
    )
    which.add_argument("--continuous", action="store_true", help="not sampled, and without delay")
    which.add_argument("--no-delay", action="store_true", help="sampled, but without the loop's delay")
    which.add_argument(
        "--friction",
        choices=("sticking", "sliding"),
        help="slope of the friction at zero speed (default for the plant alone), or the viscous part alone (default "
        "for a loop, whose margins it makes smaller)",
    )
    parser.add_argument("--plots", type=Path, metavar="FOLDER", help="draw Bode diagram, steps, poles; of a loop, more")
    parser.add_argument(
        "--robustness", type=Path, metavar="RUN", help="a search for the worst case, whose margins are shown beside"
    )
    output.add_options(parser, "the matrices, states and modes")
    output.add_dry_run(parser, "the model")
    parser.add_argument("--output", type=Path, metavar="FILE", help="write the model to a .mat or .npz file")
    return parser
