"""Linearize the plant at a pose: matrices as a file for MATLAB, Octave or NumPy, and the arm's modes."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from ..api.benchmark import Benchmark
from . import options, output
from .guard import EXIT_OK
from .values import Parser, number

EXAMPLES = """examples:
  python -m orchestrator.linearize --configuration 45 -60 --output model.mat     A, B, C, D with the loop's delay
  python -m orchestrator.linearize --system random_3 --continuous                its modes, not sampled
  python -m orchestrator.linearize --test delay_2 --friction sliding             with the delay of a test of A2

exit codes: 0 done, 2 bad input"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    bench = Benchmark(given.protocol, given.seed or 0, plant_parameters=dict(given.plant_parameters), plant=given.plant)
    q_a1, q_a2 = (math.radians(angle) for angle in given.configuration)
    model = bench.linearize(
        (q_a1, q_a2),
        given.system,
        test=given.test,
        sampled=not given.continuous,
        delay=not given.no_delay,
        friction=given.friction,
    )
    if given.output is not None and not given.dry_run:
        print(f"written to {model.save(given.output)}", file=sys.stderr)
    document = {name: getattr(model, name).tolist() for name in "ABCD"} | {
        "T_s": model.sample_time,
        "states": model.states,
        "inputs": model.inputs,
        "outputs": model.outputs,
        "at": model.at._asdict(),
        "modes": [mode._asdict() for mode in model.modes],
    }
    output.put(model, given, document)
    return EXIT_OK


def _parser() -> Parser:
    parser = Parser("linearize", "Linearize the plant at a pose, for the design of a controller.", EXAMPLES)
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
        "--system", default="compliant", metavar="NAME", help="compliant (default), nominal, random_1, ..."
    )
    which.add_argument(
        "--test", default="disturbance", metavar="NAME", help="whose gain and delay the loop has (default: disturbance)"
    )
    which.add_argument("--continuous", action="store_true", help="not sampled, and without delay")
    which.add_argument("--no-delay", action="store_true", help="sampled, but without the loop's delay")
    which.add_argument(
        "--friction",
        choices=("sticking", "sliding"),
        default="sticking",
        help="slope of the friction at zero speed (default), or the viscous part alone",
    )
    output.add_options(parser, "the matrices, states and modes")
    output.add_dry_run(parser, "the model")
    parser.add_argument("--output", type=Path, metavar="FILE", help="write the model to a .mat or .npz file")
    return parser
