"""The command ``submit``: an FMU to a service, followed in the terminal."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..codec import to_json
from ..errors import BenchmarkError
from ..service.client import Answer, Client
from ..text import printable
from ..views.units import number
from .guard import EXIT_BAD_INPUT, EXIT_INCOMPLETE, EXIT_OK
from .options import add_connection, add_setting, refuse_repeated
from .values import Parser

EXAMPLES = """examples:
  flexible-manipulator submit my_controller.fmu --to http://127.0.0.1:8080
  flexible-manipulator submit my_controller.fmu --to https://bench.example.org    # with your key in BENCHMARK_KEY
  flexible-manipulator submit my_controller.fmu --to http://127.0.0.1:8080 --map "q_m[1]=In1" --map "q_m[2]=In2"
  flexible-manipulator submit my_controller.fmu --to http://127.0.0.1:8080 --no-wait --json

exit codes: 0 finished, or received with --no-wait; 1 failed, cancelled, or the service is away; 2 refused,
or bad input"""

KEY = "BENCHMARK_KEY"
"""Environment variable with one's key: what is on a command line, other users of the machine can read."""

SHOWN = {"checking": "check", "quick": "quick evaluation", "evaluating": "evaluation"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    refuse_repeated("--map", given.connections)
    refuse_repeated("--set", given.controller_parameters)
    client = Client(given.to, os.environ.get(KEY, ""))
    run = client.submit(given.controller)
    address = f"{client.url}/runs/{run['id']}"
    print(f"received: {address}", file=sys.stderr)
    if given.connections or given.controller_parameters:
        run = _bound(client, run, given)
    if given.no_wait:
        print(to_json(run) if given.json else address)
        return EXIT_OK
    run = client.follow(run["id"], _teller())
    print(to_json(run) if given.json else _words(run, address))
    return {"finished": EXIT_OK, "refused": EXIT_BAD_INPUT}.get(run["state"], EXIT_INCOMPLETE)


def _parser() -> Parser:
    parser = Parser("submit", "Submit a controller FMU to a service, and follow its evaluation.", EXAMPLES)
    parser.add_argument("controller", type=Path, metavar="CONTROLLER.fmu", help="the controller")
    parser.add_argument("--to", required=True, metavar="URL", help=f"the service; your key is taken from {KEY}")
    add_connection(parser)
    add_setting(parser)
    parser.add_argument("--no-wait", action="store_true", help="end when the FMU is received")
    parser.add_argument("--json", action="store_true", help="print the run as JSON")
    return parser


def _bound(client: Client, run: Answer, given: argparse.Namespace) -> Answer:
    """The run with its binding: the first look at the FMU may have refused it already, or not have begun."""
    try:
        bound = client.bind(
            run["id"], {"map": dict(given.connections), "parameters": dict(given.controller_parameters)}
        )
    except BenchmarkError:  # nobody would look after it
        with suppress(BenchmarkError):
            client.ask("DELETE", f"/api/runs/{run['id']}")
        raise
    if bound["id"] != run["id"]:
        client.ask("DELETE", f"/api/runs/{run['id']}")
    return bound


def _teller() -> Callable[[Answer], None]:
    """Prints what is new of a run, one line for each stage and each tenth of it."""
    said: set[Any] = set()

    def tell(run: Answer) -> None:
        for finding in run["findings"]:
            line = f"{finding['severity']}: {finding['subject']}: {finding['text']}"
            if finding["severity"] in ("warning", "error") and line not in said:
                said.add(line)
                print(printable(line), file=sys.stderr)
        stage = SHOWN.get(run["state"], run["state"])
        tenth = 10 * run["done"] // run["total"] if run["total"] else 0
        if (stage, run["waiting"], tenth) in said:
            return
        said.add((stage, run["waiting"], tenth))
        more = f": {run['done']} of {run['total']} cases" if run["total"] else ""
        more += f", V so far {number(run['cost_so_far'])}" if run["cost_so_far"] is not None else ""
        if run["waiting"]:
            more = f" waits, {run['ahead'] or 0} before it"
        print(f"{stage}{more}", file=sys.stderr)

    return tell


def _words(run: Answer, address: str) -> str:
    if run["state"] != "finished":
        return printable(f"{run['state']}: {run['reason'] or 'by its owner'}")
    met = {True: "A1 to A3 are met", False: "a requirement is not met"}.get(run["holds"], "requirements are not judged")
    remark = f" ({run['remark']})" if run["remark"] else ""
    return printable(f"V = {number(run['cost'])}{remark}, {met}\n{address}")
