"""V of a list of arms that an outsider's search has found: a lower bound of V that others can check.

    python benchmarks/counterexample.py                    RobustLQG, the 66 arms of counterexample.json

The arms are those of a genetic search with a simulator of its own, one for each of B5, B6 and B7 at each pose of
``strict``. The file has, by criterion, the pose [degrees], the deviations of the 22 parameters in half-widths of
Table 1, the direction of the force [rad], the sweep [Hz], the seed of the noise, and the value that the outsider's
simulator gave.
"""

from __future__ import annotations

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


def main() -> int:
    """Simulate the arms; the exit code is 1 if a value differs in a bit."""
    bench, arms = Benchmark("strict"), json.loads(ARMS.read_text(encoding="utf-8"))
    protocol = bench.rules
    _, pairing, _, listed = bench.prepared(Controller.built_in("RobustLQG"))
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
    own, same = iter(results[len(listed) :]), True
    for name, found in arms.items():
        values = [getattr(next(own).measurements, name) for _ in found]
        equal = values == [each["value"] for each in found]
        same = same and equal
        words = "the outsider's, to the last bit" if equal else "NOT the outsider's"
        print(f"{name}: mean {sum(values) / len(values):.6g}, {words}")
    print(f"V of these and the list: {score(rules(protocol), results).cost:.2f}")
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
