"""Worse cases than the leaderboard's searches have found: failures and margins, and V of lists of arms.

    python benchmarks/counterexamples.py                    RobustLQG: the claims about it that have a command of their
                                                            own, and the lists (two minutes)
    python benchmarks/counterexamples.py RobustLinearLQG    another controller
    python benchmarks/counterexamples.py --claims           the claims alone (half a minute)
    python benchmarks/counterexamples.py RobustLQG --parameters controller_fmu/robust_c/mended_weights.json
                                                            the lists with other parameters

The claims are those of docs/claims.json (benchmarks/claims.py). Each is simulated by its command, and with eight other
realizations of the noise.

Each list has one arm for each of B5, B6 and B7 at each pose of ``strict``, which had 22 of its 25 until version 4:

genetic        a genetic search with a simulator of its own attacked the RobustLQG of the time before release 1.0.0:
               V was 141.4, where our own search had found 134.1
continued      somebody who had not seen the work before attacked the RobustLQG of release 1.0.0, from the worst arms of
               our own search on, whose V was 99.2
steady         somebody attacked the SteadyLQG before its slow feedback, from the two lists above on, with a simulator
               of eight arms at once, and moved the begin of the chirp, too
weak           somebody attacked the fourth SteadyLQG, from "steady" on: forces in the direction that loads the joints
               least, after a chirp, for B6. Where "steady" has the larger value, it is that arm
ringing        the project attacked the next SteadyLQG, for which an arm that rings on was an event while there was a
               dither, from all arms above on, with a simulator of that kind
held           somebody attacked the same, from all arms above on, with many directions of the force after one chirp:
               friction holds the motors of its worst arms for B6 while they ring on
raised         somebody attacked the seventh SteadyLQG, from all arms above on
restarted      the same by another search, which looked for what moves late after the force: a dither that fades before
               its time and begins again
lasting        the project and two others attacked the present SteadyLQG: for B6 a force in the fade of the chirp's
               dither, which one of them found from random arms on
mended         somebody attacked the present RobustLQG, with the parameters of mended_weights.json, from all arms above
               on: for B6 forces that are no event for it
fanned         two others attacked RobustLQG for an hour each, without any arm and without knowledge of the search, but
               told what V and margins were known and what makes B6 large: for B6 fans of directions about that which
               loads the joints least. At each pose the worse arm of the two

The files are those of orchestrator/search/arms, which a search for everybody begins with, too.
"""

from __future__ import annotations

import argparse
import io
import shlex
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from statistics import mean
from typing import Any

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

import build_fmus  # noqa: E402
from benchmarks.claims import ROOT, claims  # noqa: E402
from benchmarks.lanes import InLanes  # noqa: E402
from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.protocol import Protocol  # noqa: E402
from orchestrator.benchmark.results import CaseResult, rules  # noqa: E402
from orchestrator.benchmark.scorecard import kind, outcome, score  # noqa: E402
from orchestrator.cli import simulate  # noqa: E402
from orchestrator.codec import from_json  # noqa: E402
from orchestrator.execution import store  # noqa: E402
from orchestrator.search.arms import lists, member  # noqa: E402
from orchestrator.search.member import case_of  # noqa: E402
from orchestrator.search.target import targets  # noqa: E402
from orchestrator.study import batch  # noqa: E402
from orchestrator.study.requests import Batch, BatchEntry  # noqa: E402

COMMAND = "flexible-manipulator simulate "
"""What the command of a claim begins with that is one case."""

SEEDS = range(1, 9)
"""Other realizations of the noise that a failure is repeated with."""

FORMER_POSES = 22
"""Of the poses of ``strict``, the first ones: those of version 3, by which some reported figures are means."""


def main() -> None:
    """Simulate the arms."""
    parser = argparse.ArgumentParser(description="Worse cases than the leaderboard's searches have found.")
    parser.add_argument("name", nargs="?", default="RobustLQG", metavar="NAME", help="one of the project's controllers")
    parser.add_argument("--claims", action="store_true", help="only the claims, not the lists")
    parser.add_argument("--parameters", type=Path, metavar="FILE", help="only the lists, with these parameters")
    given = parser.parse_args()
    controller, bench = Controller.built_in(given.name), InLanes("strict")
    if given.parameters:
        on_lists(replace(controller, parameters=given.parameters), bench)
        return
    for command in dict.fromkeys(claim.command for claim in claims() if claim.controller == given.name):
        if command.startswith(COMMAND):
            named = [claim for claim in claims() if claim.command == command]
            figures = " and ".join(claim.figure for claim in named)
            file = named_in(command, ROOT / "build" / "fmus")
            result, *others = (repeated(command, file, seed) for seed in (None, *SEEDS))
            if result.test.startswith("disturbance"):
                values = [getattr(each.measurements, named[0].figure) for each in (result, *others)]
                print(
                    f"{figures}: {values[0]:.4g}; with {len(others)} other seeds {min(values):.4g} to {max(values):.4g}"
                )
                continue
            failing = sum(fails(each, bench.rules) for each in others)
            print(f"{figures}: {told(result, bench.rules)}; fails with {failing} of {len(others)} other seeds")
    if not given.claims:
        on_lists(controller, bench)


def named_in(command: str, folder: Path) -> Path:
    """The FMU that the command of a claim names, built: of a controller in Python that is its twin in C."""
    return build_fmus.build(Path(shlex.split(command)[2]).stem, folder)


def repeated(command: str, controller: Path, seed: int | None = None) -> CaseResult:
    """What the command of a claim gives with the FMU ``controller``, by the command line itself; with another ``seed``
    of the noise than it says."""
    words = [str(controller), *shlex.split(command.removeprefix(COMMAND))[1:]]
    if seed is not None:
        words += ["--seed", str(seed)]  # of two, the last one counts
    with (
        tempfile.TemporaryDirectory() as folder,
        redirect_stdout(io.StringIO()) as told,
        redirect_stderr(io.StringIO()),
    ):
        simulate.main([*words, "--json", "--output-dir", folder])
    return from_json(told.getvalue(), CaseResult)


def fails(result: CaseResult, protocol: Protocol) -> bool:
    """Whether a case of a stability test does not hold."""
    return outcome(result, protocol.stability) != "holds"


def told(result: CaseResult, protocol: Protocol) -> str:
    """How the case ended, in words."""
    figures = result.measurements
    cycle = f"{1e6 * (figures.limit_cycle or 0.0):.1f} µm at {figures.limit_cycle_frequency or 0.0:.1f} Hz"
    away = f"TCP error {1e3 * (figures.rest_error or 0.0):.3f} mm in the last second"
    return f"{result.test}: {kind(result, protocol.stability)}, {cycle}, {away}"


def on_lists(controller: Controller, bench: Benchmark) -> None:
    """V of each list of arms, and of all together."""
    by_words = {words: each for words, each in lists().items() if words != "failing"}
    arms = [arm for each in by_words.values() for found in each.values() for arm in found]
    strict, results = simulated(bench, controller, arms)
    own = iter(results)
    for words, each in by_words.items():
        by_criterion = {criterion: list(islice(own, len(found))) for criterion, found in each.items()}
        for criterion, found in each.items():
            value = mean(getattr(result.measurements, criterion) for result in by_criterion[criterion])
            attacked = mean(arm["value"] for arm in found)
            print(f"{words}: {criterion}: mean {value:.4g}, of the controller attacked {attacked:.4g}")
        cost = score(rules(bench.rules), [*strict, *chain(*by_criterion.values())]).cost
        print(f"{words}: V of these and the list: {cost:.2f}")
    every = [*strict, *results]
    former = [result for result in every if result.configuration.index < FORMER_POSES]
    print(f"V of all lists and the list of the protocol: {score(rules(bench.rules), every).cost:.2f}")
    print(f"the same on the {FORMER_POSES} poses of version 3: {score(rules(bench.rules), former).cost:.2f}")


def simulated(
    bench: Benchmark, controller: Controller, arms: Sequence[Mapping[str, Any]], listed: bool = True
) -> tuple[Sequence[CaseResult], Sequence[CaseResult]]:
    """Results of the list of cases of the protocol, unless it is not wanted, and of the ``arms``, in whole cases."""
    protocol = bench.rules
    _, pairing, _, cases = bench.prepared(controller)
    before = cases if listed else ()
    test = next(target.test for target in targets(protocol) if target.criterion)
    own = [case_of(member(arm, test, protocol), protocol, bench.nominal) for arm in arms]
    entry = BatchEntry(protocol, pairing, (*before, *own))
    with store.opened(None) as known:
        results = [run.result for run in batch.run(Batch((entry,)), bench.engine(here=True).execute, known)[0]]
    return results[: len(before)], results[len(before) :]


if __name__ == "__main__":
    main()
