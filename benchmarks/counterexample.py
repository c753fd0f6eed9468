"""V of a list of arms that an outsider's search has found: a lower bound of V that others can check.

    python benchmarks/counterexample.py                    RobustLQG on the 66 arms of counterexample.json
    python benchmarks/counterexample.py RobustLinearLQG    another controller

The arms are those of a genetic search with a simulator of its own, one for each of B5, B6 and B7 at each pose of
``strict``. It attacked the RobustLQG of the time before release 1.0.0, whose values are in the file: V was 141.4, where
our own search had found 134.1. The file has, by criterion, the pose [degrees], the deviations of the 22 parameters in
half-widths of Table 1, the direction of the force [rad], the sweep [Hz], the seed of the noise, and that value.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.results import rules  # noqa: E402
from orchestrator.benchmark.scorecard import score  # noqa: E402
from orchestrator.execution import store  # noqa: E402
from orchestrator.search.member import Member, case_of, names  # noqa: E402
from orchestrator.search.target import targets  # noqa: E402
from orchestrator.study import batch  # noqa: E402
from orchestrator.study.engine import here  # noqa: E402
from orchestrator.study.requests import Batch, Entry  # noqa: E402

ARMS = Path(__file__).with_suffix(".json")


def main() -> None:
    """Simulate the arms."""
    parser = argparse.ArgumentParser(description="V of a list of arms that an outsider's search has found.")
    parser.add_argument("name", nargs="?", default="RobustLQG", metavar="NAME", help="one of the project's controllers")
    name = parser.parse_args().name
    bench, arms = Benchmark("strict"), json.loads(ARMS.read_text(encoding="utf-8"))
    protocol = bench.rules
    _, pairing, _, listed = bench.prepared(Controller.built_in(name))
    test = next(target.test for target in targets(protocol) if target.criterion)
    members = [
        Member(
            (each["q_a"][0], each["q_a"][1]),
            test,
            tuple(zip(names(protocol), each["deviations"], strict=True)),
            phi_F=each["phi_F"],
            sweep=(each["sweep"][0], each["sweep"][1]),
            seed=each["seed"],
        )
        for found in arms.values()
        for each in found
    ]
    cases = [case_of(member, protocol, bench.nominal) for member in members]
    entry = Entry(protocol, pairing, (*listed, *cases))
    with store.opened(None) as known:
        results = [run.result for run in batch.run(Batch((entry,)), here(bench), known)[0]]
    own = iter(results[len(listed) :])
    for criterion, found in arms.items():
        values = [getattr(next(own).measurements, criterion) for _ in found]
        before = sum(each["value"] for each in found) / len(found)
        print(f"{criterion}: mean {sum(values) / len(values):.4g}, before release 1.0.0 {before:.4g}")
    print(f"V of these and the list: {score(rules(protocol), results).cost:.2f}")


if __name__ == "__main__":
    main()
