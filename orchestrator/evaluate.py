"""Evaluate a controller FMU: run a protocol over all cores, print the scorecard, write the results.

python -m orchestrator.evaluate my_controller.fmu
"""

from __future__ import annotations

import argparse
import fnmatch
import functools
import hashlib
import json
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from datetime import datetime, timezone
from pathlib import Path

from . import commands
from .benchmark import protocol as protocols
from .benchmark.case import Case
from .benchmark.metrics import CaseResult
from .benchmark.protocol import Protocol
from .benchmark.scorecard import score
from .cosim.sampling import controller_sample_time
from .cosim.trajectory import Status
from .errors import InputError
from .execution import cluster, pool, store
from .execution.evaluation import Bench, available_cores, evaluate, rehearse
from .replay import record_shown
from .report import outputs, results
from .report.files import CASES, RESULTS, prepare_folder
from .report.progress import progress
from .report.selection import shown
from .report.terminal import show_document, terminal

EXAMPLES = """examples:
  python -m orchestrator.evaluate                              the paper's PID
  python -m orchestrator.evaluate my_controller.fmu            your controller
  python -m orchestrator.evaluate my_controller.fmu --quick    a look in seconds, not comparable
  python -m orchestrator.evaluate --set K_p[1]=60              the PID with another gain
  python -m orchestrator.evaluate --only 'c07.*'               one configuration
  python -m orchestrator.evaluate --only '*.slippery.delay_2'  one system and test
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = _parser().parse_args(arguments)
    outputs.check_options(options)
    protocol = protocols.load(options.protocol)
    plant_parameters = dict(options.plant_parameters)
    bench = commands.bench(options)
    sample_time = controller_sample_time(bench.controller, protocol.sample_time, options.sample_time)
    nominal = commands.nominal_parameters(bench.plant, plant_parameters)
    cases = protocols.cases(protocol, nominal, options.seed, sample_time.value)
    chosen = _chosen(cases, options.only)
    folder = options.output_dir or Path("runs") / _folder_name(bench, protocol, options)
    prepare_folder(folder)

    start, begin = datetime.now(timezone.utc), time.perf_counter()
    with store.opened(folder) as known:
        rehearsal = rehearse(chosen[0], bench)
        found = _run(protocol, chosen, bench, known, options, rehearsal.failure)
        evaluation = results.Evaluation(
            protocol=protocol,
            seed=options.seed,
            plant=bench.plant,
            controller=bench.controller,
            plant_parameters=plant_parameters,
            nominal=nominal,
            setup=bench.setup,
            sample_time=sample_time.value,
            controller_timing=rehearsal.timing,
            results=tuple(found),
            scorecard=score(protocol, found, len(cases)),
            timing=results.Timing(start, time.perf_counter() - begin, options.jobs),
        )
        _report(evaluation, bench, folder, options)
    judged = all(result.measurement is not None or result.status == "unstable" for result in found)
    return commands.EXIT_OK if judged else commands.EXIT_INCOMPLETE


def _report(evaluation: results.Evaluation, bench: Bench, folder: Path, options: argparse.Namespace) -> None:
    """Write and print the results, then what is made of them."""
    document = results.document(evaluation)
    if outputs.remove_outdated(folder, document):
        print(f"other results in {folder} are replaced (--output-dir keeps both)", file=sys.stderr)
    results.write(document, folder)
    if options.json:
        json.dump(document, sys.stdout, indent=1)
        print()
    else:
        show_document(document, terminal())
    if outputs.need_recordings(options):
        wanted = shown(evaluation.protocol, evaluation.nominal, options.seed, evaluation.results, evaluation.scorecard)
        record_shown(wanted, bench, options.jobs, folder)
    written = [RESULTS, CASES, *outputs.write_outputs(folder, options)]
    print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)


def _folder_name(bench: Bench, protocol: Protocol, options: argparse.Namespace) -> str:
    """A name for the results: of controller and protocol, and of whatever is not as usual."""
    name = f"{bench.controller.file.stem}-{protocol.name}" + (f"-seed{options.seed}" if options.seed else "")
    parameters, mapping = sorted(bench.setup.parameters.items()), sorted(bench.setup.mapping.items())
    unusual = [parameters, mapping, sorted(options.plant_parameters), options.only, options.sample_time]
    if any(unusual):
        name += "-" + hashlib.sha256(repr(unusual).encode()).hexdigest()[:6]
    return name


def _run(
    protocol: Protocol,
    cases: Sequence[Case],
    bench: Bench,
    known: store.Store,
    options: argparse.Namespace,
    at_once: CaseResult | None = None,
) -> list[CaseResult]:
    """Results of all ``cases`` in their order: those in the store, and the others, stored as they come.

    ``at_once`` is the rehearsal's failure.
    """
    keys = store.keys(protocol, cases, bench)
    if options.force:
        known.forget(list(keys.values()))
    conditions = store.conditions(bench)
    found = known.load(keys, conditions, failures=not options.keep_going)
    there = {result.case for result in found}
    waiting = [case for case in cases if case not in there]
    if found:
        again = "--force runs anew" + (", --keep-going what failed" if any(result.kind for result in found) else "")
        print(f"{len(found)} of {len(cases)} cases are there from an earlier run ({again})", file=sys.stderr)
    execute = (
        functools.partial(cluster.run, address=options.scheduler)
        if options.scheduler
        else functools.partial(pool.run, workers=options.jobs)
    )
    with (
        progress(protocol, len(cases)) as update,
        closing(evaluate(protocol, waiting, bench, execute, found, options.keep_going, at_once)) as stream,
    ):
        update(found)
        for result in stream:
            if result.status is not Status.SKIPPED and result.final:
                known.put(keys[result.case], result, conditions)
            found.append(result)
            update(found)
    order = {case: number for number, case in enumerate(cases)}
    return sorted(found, key=lambda result: order[result.case])


def _chosen(cases: Sequence[Case], patterns: Sequence[str]) -> tuple[Case, ...]:
    if not patterns:
        return tuple(cases)
    chosen = tuple(case for case in cases if any(fnmatch.fnmatchcase(case.id, pattern) for pattern in patterns))
    if not chosen:
        raise InputError(
            f"No case matches --only {' '.join(patterns)}. Cases are named like {cases[0].id} and {cases[-1].id}."
        )
    return chosen


def _workers(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of processes: at least 1 is needed")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m orchestrator.evaluate",
        description="Evaluate a controller FMU on the flexible-manipulator benchmark.",
        epilog=EXAMPLES + "\n" + commands.EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands.add_common(parser)
    parser.add_argument(
        "--quick",
        action="store_const",
        const="quick",
        dest="protocol",
        default=argparse.SUPPRESS,
        help="the same as --protocol quick",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="PATTERN",
        help="only cases whose name matches, with * and ?; may be given again",
    )
    parser.add_argument(
        "--jobs", type=_workers, default=available_cores(), metavar="N", help="processes (default: all cores)"
    )
    parser.add_argument(
        "--output-dir", type=Path, metavar="FOLDER", help="where to write (default: runs/CONTROLLER-PROTOCOL)"
    )
    parser.add_argument("--force", action="store_true", help="run anew what an earlier run has finished")
    parser.add_argument(
        "--keep-going",
        action="store_true",
        help="do not give up after three failures of one kind, and run again what failed in an earlier run",
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="run on a Dask cluster, such as tcp://host:8786")
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    outputs.add_options(parser)
    return parser


if __name__ == "__main__":
    raise SystemExit(commands.guarded(main))
