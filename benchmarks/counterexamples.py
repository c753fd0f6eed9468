"""V of lists of arms that the searches of others have found: lower bounds of V that anybody can check.

    python benchmarks/counterexamples.py                    RobustLQG on the lists of counterexamples/
    python benchmarks/counterexamples.py RobustLinearLQG    another controller

Each list has one arm for each of B5, B6 and B7 at each pose of ``strict``:

genetic        a genetic search with a simulator of its own attacked the RobustLQG of the time before release 1.0.0:
               V was 141.4, where our own search had found 134.1
continued      somebody who had not seen the work before attacked the RobustLQG of release 1.0.0, from the worst arms of
               our own search on, whose V was 99.2

The files have, by criterion, the pose [degrees], the deviations of the 22 parameters in half-widths of Table 1, the
direction of the force [rad], the sweep [Hz], the seed of the noise, and the value of the controller attacked.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from statistics import mean
from typing import Any

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.protocol import Protocol  # noqa: E402
from orchestrator.benchmark.results import CaseResult, rules  # noqa: E402
from orchestrator.benchmark.scorecard import score  # noqa: E402
from orchestrator.execution import store  # noqa: E402
from orchestrator.search.member import Member, case_of, names  # noqa: E402
from orchestrator.search.target import targets  # noqa: E402
from orchestrator.study import batch  # noqa: E402
from orchestrator.study.engine import here  # noqa: E402
from orchestrator.study.requests import Batch, Entry  # noqa: E402

LISTS = Path(__file__).with_suffix("")


def main() -> None:
    """Simulate the arms."""
    parser = argparse.ArgumentParser(description="V of lists of arms that the searches of others have found.")
    parser.add_argument("name", nargs="?", default="RobustLQG", metavar="NAME", help="one of the project's controllers")
    controller, bench = Controller.built_in(parser.parse_args().name), Benchmark("strict")
    lists = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(LISTS.glob("*.json"))}
    arms = [arm for each in lists.values() for found in each.values() for arm in found]
    strict, results = simulated(bench, controller, arms)
    own = iter(results)
    for words, each in lists.items():
        by_criterion = {criterion: list(islice(own, len(found))) for criterion, found in each.items()}
        for criterion, found in each.items():
            value = mean(getattr(result.measurements, criterion) for result in by_criterion[criterion])
            attacked = mean(arm["value"] for arm in found)
            print(f"{words}: {criterion}: mean {value:.4g}, of the controller attacked {attacked:.4g}")
        cost = score(rules(bench.rules), [*strict, *chain(*by_criterion.values())]).cost
        print(f"{words}: V of these and the list: {cost:.2f}")


def simulated(
    bench: Benchmark, controller: Controller, arms: Sequence[Mapping[str, Any]], listed: bool = True
) -> tuple[Sequence[CaseResult], Sequence[CaseResult]]:
    """Results of the list of cases of the protocol, unless it is not wanted, and of the ``arms``, in whole cases."""
    protocol = bench.rules
    _, pairing, _, cases = bench.prepared(controller)
    before = cases if listed else ()
    test = next(target.test for target in targets(protocol) if target.criterion)
    own = [case_of(member(arm, test, protocol), protocol, bench.nominal) for arm in arms]
    entry = Entry(protocol, pairing, (*before, *own))
    with store.opened(None) as known:
        results = [run.result for run in batch.run(Batch((entry,)), here(bench), known)[0]]
    return results[: len(before)], results[len(before) :]


def member(arm: Mapping[str, Any], test: str, protocol: Protocol) -> Member:
    """An arm of a list."""
    return Member(
        (arm["q_a"][0], arm["q_a"][1]),
        test,
        tuple(zip(names(protocol), arm["deviations"], strict=True)),
        phi_F=arm["phi_F"],
        sweep=(arm["sweep"][0], arm["sweep"][1]),
        seed=arm["seed"],
    )


if __name__ == "__main__":
    main()
