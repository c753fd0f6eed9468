"""Evaluate a controller FMU: run a protocol over all cores, print the scorecard, write the results.

python -m orchestrator.evaluate my_controller.fmu
"""

from __future__ import annotations

import argparse
import fnmatch
import functools
import json
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from datetime import datetime, timezone
from pathlib import Path

from rich.console import Console

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
from .report import outputs
from .report import results as files
from .report.progress import progress
from .report.selection import shown
from .report.terminal import show

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
    protocol = protocols.load("quick" if options.quick else options.protocol)
    plant_parameters = dict(options.plant_parameters)
    bench = commands.bench(options)
    sample_time = controller_sample_time(bench.controller, protocol.sample_time, options.sample_time)
    nominal = commands.nominal_parameters(bench.plant, plant_parameters)
    cases = protocols.cases(protocol, nominal, options.seed, sample_time.value)
    chosen = _chosen(cases, options.only)
    folder = options.output_dir or Path("runs") / f"{bench.controller.file.stem}-{protocol.name}"
    files.prepare_folder(folder)

    start, begin = datetime.now(timezone.utc), time.perf_counter()
    with store.opened(folder) as results:
        timing = rehearse(chosen[0], bench)
        found = _run(protocol, chosen, bench, results, options)

    evaluation = files.Evaluation(
        protocol=protocol,
        seed=options.seed,
        plant=bench.plant,
        controller=bench.controller,
        plant_parameters=plant_parameters,
        nominal=nominal,
        setup=bench.setup,
        sample_time=sample_time.value,
        controller_timing=timing,
        results=tuple(found),
        scorecard=score(protocol, found, len(cases)),
        timing=files.Timing(start, time.perf_counter() - begin, options.jobs),
    )
    files.write(evaluation, folder)
    if options.json:
        json.dump(files.document(evaluation), sys.stdout, indent=1)
        print()
    else:
        show(evaluation, Console())
    if outputs.need_recordings(options):
        wanted = shown(protocol, nominal, options.seed, found, evaluation.scorecard)
        record_shown(wanted, bench, options.jobs, folder)
    written = ["results.json", "cases.csv", *outputs.write_outputs(folder, options)]
    print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)
    judged = all(result.measurement is not None or result.status == "unstable" for result in found)
    return commands.EXIT_OK if judged else commands.EXIT_INCOMPLETE


def _run(
    protocol: Protocol, cases: Sequence[Case], bench: Bench, results: store.Store, options: argparse.Namespace
) -> list[CaseResult]:
    """Results of all ``cases`` in their order: those in the store, and the others, stored as they come."""
    keys = store.keys(protocol, cases, bench)
    if options.force:
        results.forget(list(keys.values()))
    conditions = store.conditions(bench)
    found = results.load(keys, conditions)
    known = {result.case for result in found}
    waiting = [case for case in cases if case not in known]
    if found:
        print(f"{len(found)} of {len(cases)} cases are there from an earlier run (--force runs anew)", file=sys.stderr)
    execute = (
        functools.partial(cluster.run, address=options.scheduler)
        if options.scheduler
        else functools.partial(pool.run, workers=options.jobs)
    )
    with (
        progress(protocol, len(cases)) as update,
        closing(evaluate(protocol, waiting, bench, execute, found, options.keep_going)) as stream,
    ):
        update(found)
        for result in stream:
            if result.status is not Status.SKIPPED and result.final:
                results.put(keys[result.case], result, conditions)
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
    parser.add_argument("--quick", action="store_true", help="the same as --protocol quick")
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
    parser.add_argument("--keep-going", action="store_true", help="do not give up after three failures of one kind")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="run on a Dask cluster, such as tcp://host:8786")
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    outputs.add_options(parser)
    return parser


if __name__ == "__main__":
    raise SystemExit(commands.guarded(main))
