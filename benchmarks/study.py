"""The figures of docs/study.md: the controllers on draws that no tuning has seen, and the time that RobustLQG rations.

    python benchmarks/study.py                     300 draws of each controller from the box and from its corners, and
                                                   RobustLQG without a limit on the time of its dither and its third
                                                   feedback (30 minutes on two cores)
    python benchmarks/study.py RobustLQG           one controller; the figures of the others stay
    python benchmarks/study.py --corners           only the draws from the corners
    python benchmarks/study.py RobustLQG --probability
                                                   as many draws of it from the box as bound a probability of failure
                                                   of 0.1 % (20 minutes), and 12,000 corners for A2 (11 minutes)
    python benchmarks/study.py --table             write table and pictures anew from the figures that are kept

A draw is one arm, pose, direction of the force, sweep and noise, simulated in every test of the protocol
(``flexible-manipulator reliability``). Its seed is used here alone. The figures are kept in docs/study.json.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.claims import best_known, claims, counting, name_of  # noqa: E402
from benchmarks.lanes import InLanes  # noqa: E402
from benchmarks.leaderboard import FIGURES as LEADERBOARD  # noqa: E402
from benchmarks.leaderboard import built, searched_as  # noqa: E402
from benchmarks.leaderboard_tables import PAGES, shown, standing, verdicts  # noqa: E402
from benchmarks.marked_tables import with_table  # noqa: E402
from orchestrator import Reliability  # noqa: E402
from orchestrator.benchmark.reliability import Distribution, draws_needed  # noqa: E402
from orchestrator.benchmark.tail import tail  # noqa: E402

DATA, PAGE = ROOT / "docs" / "study.json", ROOT / "docs" / "study.md"
PARETO, EXCEEDED = (ROOT / "docs" / "pictures" / f"study-{name}.png" for name in ("pareto", "draws"))
RUNS = ROOT / "runs" / "study"
MAKER, FOUND_MAKER = "benchmarks/study.py", "benchmarks/study.py from the leaderboard"
TAIL_MAKER = "benchmarks/study.py by peaks over threshold"

SEED = 20261125
"""Of the draws: neither the protocols', the tunings' nor the searches'."""

DRAWS, PROBABILITY, CONFIDENCE = 300, 0.001, 0.99

MANY_CORNERS, RARE = 12_000, "A2"
"""Draws from the corners, and the requirement of RobustLQG that others found to fail in 3 of 12,032 of them."""

MISSING = "—"
"""What stands in a table for a figure that was not measured."""

RATIONED, UNLIMITED = "RobustLQG", {"peak_time": 1e6, "dither_time": 1e6}
"""The controller whose time is limited, and parameters [s] that do not limit it."""

TOLD = (RATIONED, "SteadyLQG")
"""The controllers of the leaderboard whose figures the page tells of one by one."""

CRITERIA = {"B5": 1e3, "B6": 1.0, "B7": 1e3}
"""The heaviest criteria, shown in mm, s and mm."""

Figures = Mapping[str, Any]


def drawn(name: str, draws: int, distribution: Distribution = "box", only: Sequence[str] = ()) -> dict[str, Any]:
    """What a sample of a controller comes to: its failures, and V and the heaviest criteria of the draws, if their
    tests are simulated."""
    cases, folder = cases_of(name), RUNS / "-".join((name, str(draws), distribution, *only))
    found = InLanes(seed=SEED).reliability(
        searched_as(name), draws=draws, distribution=distribution, only=only, confidence=CONFIDENCE, folder=folder
    )
    return {"benchmark": found.benchmark, "draws": draws, "cases": cases, **_kept(found)}


def cases_of(name: str) -> str:
    """The hash of the leaderboard's cases of a controller. It tells what a controller does, and stays where a change of
    its sources moves no bit.

    Raises :class:`SystemExit` if the controller is not the leaderboard's.
    """
    figures = next((each for each in searched() if name_of(each) == name), None)
    if figures is None or figures["guid"] != built(name).archive.description.guid:
        raise SystemExit(f"{name} is not the leaderboard's: see python benchmarks/leaderboard.py --same {name}")
    cases: str = figures["cases"]
    return cases


def _kept(found: Reliability) -> dict[str, Any]:
    requirements = {
        name: {"failures": len({each.draw for each in entry.failures}), "bound": entry.bound}
        for name, entry in found.requirements.items()
    }
    if not found.cost.judged:
        return {"requirements": requirements}
    medians = {name: found.criteria[name].median for name in CRITERIA}
    return {
        "requirements": requirements,
        "median": {"V": found.cost.median, **medians},
        "V": [float(f"{value:.5g}") for value in found.cost.values],
    }


def without_limit() -> dict[str, Any]:
    """The list ``strict`` with RobustLQG as it is, and without a limit on the time of dither and third feedback."""
    found = {}
    for words, values in (("limited", {}), ("not limited", UNLIMITED)):
        controller = built(RATIONED).with_parameters(values)
        results = InLanes("strict").evaluate(controller, folder=RUNS / words, recordings=False).results
        found[words] = {
            "cost": results.cost,
            "requirements": {name: entry.passed for name, entry in results.stability.items()},
        }
    return found


def table(kept: Figures) -> str:
    """What the draws of each controller come to, in the order of the leaderboard."""
    head = (
        "| controller | draws | A1 A2 A3 fail | at most | corners | A1 A2 A3 fail | at most | V, median | largest "
        "| B5 mm | B6 s | B7 mm | V, corners |\n"
    )
    rows = [(dated(name, own := kept["draws"][name]), own, kept["corners"].get(name)) for name in ordered()]
    more = [
        (dated(f"{name}, more draws", own), own, kept["many_corners"].get(name)) for name, own in kept["many"].items()
    ]
    lines = []
    for name, own, corners in (*rows, *more):
        medians = (f"{own['median'][key] * factor:.3g}" for key, factor in CRITERIA.items())
        worst = f"{max(corners['V']):.1f}" if corners and "V" in corners else MISSING
        cells = (name, *_failing(own), *_failing(corners), f"{own['median']['V']:.1f}", f"{max(own['V']):.1f}")
        lines.append(f"| {' | '.join(map(str, (*cells, *medians, worst)))} |\n")
    return head + 13 * "|---" + "|\n" + "".join(lines)


def _failing(own: Figures | None) -> tuple[str, str, str]:
    """The number of draws, of those that fail each requirement, and the largest bound."""
    if own is None:
        return 3 * (MISSING,)
    entries = own["requirements"]
    failures = (str(entries[name]["failures"]) if name in entries else MISSING for name in ("A1", "A2", "A3"))
    bound = max(entry["bound"] for entry in entries.values())
    return str(own["draws"]), " ".join(failures), f"{100 * bound:.2g} %"


def dated(name: str, sample: Figures) -> str:
    """The name of a sample, with its version of the benchmark if that is not the leaderboard's."""
    version: str = sample["benchmark"]
    return name if version == searched()[0]["benchmark"] else f"{name}, {version.rpartition('-')[2]}"


def tail_table(kept: Figures) -> str:
    """What is estimated beyond the largest draw of the larger samples, and what is known of V."""
    target = 100.0
    known = {name_of(each): each["robustness"]["cost"] for each in leaderboard()}
    head = (
        f"| V of draws | draws | largest | peaks | threshold | {100.0 * PROBABILITY:g} % of the draws exceed "
        f"| P(V > {target:g}), at most | largest known |\n"
    )
    lines = []
    for name, own in kept["many"].items():
        found = tail(own["V"], target, PROBABILITY, CONFIDENCE)
        assert found is not None and found.level is not None and found.exceedance is not None
        level = found.level
        cells = (
            dated(name, own),
            own["draws"],
            f"{max(own['V']):.1f}",
            found.peaks,
            f"{found.threshold:.1f}",
            f"{level.estimate:.1f} ({level.low:.1f} to {level.high:.1f})",
            f"{found.exceedance.high:.1g}",
            f"{known[name]:.1f}",
        )
        lines.append(f"| {' | '.join(map(str, cells))} |\n")
    return head + 8 * "|---" + "|\n" + "".join(lines)


def found_table() -> str:
    """What the controllers of :data:`TOLD` have on ``paper``, on ``strict``, in the own search, and what is reported
    beyond that."""
    head = "| controller | cases | V | A1 A2 A3 | B5 mm | B6 s | B7 mm |\n" + 7 * "|---" + "|\n"
    figures = {name_of(each): each for each in searched()}
    return head + "".join(
        f"| `{name}` | {words} | {cost:.1f} | {verdicts(requirements)} "
        f"| {' | '.join(shown(criteria[key]) if key in criteria else MISSING for key in CRITERIA)} |\n"
        for name in TOLD
        for words, cost, criteria, requirements in _found_rows(figures[name])
    )


def _found_rows(own: Figures) -> Iterator[tuple[str, float, Figures, Figures]]:
    """Where from, V, criteria and requirements."""
    (worst,) = best_known([own])
    found, strict = own["robustness"], own["strict"]
    yield "sample of the protocol `paper`", own["cost"], own["criteria"], own["stability"]
    yield "list `strict`", strict["cost"], strict["criteria"], strict["stability"]
    yield f"own search, {found['simulations']:,} simulations", found["cost"], found["criteria"], found["requirements"]
    reported = counting(own, claims()).get("V")
    if reported is not None:
        means = {key: {"value": value, "unit": found["criteria"][key]["unit"]} for key, value in reported.means.items()}
        yield f"reported by {reported.by}", worst["robustness"]["cost"], means, worst["robustness"]["requirements"]


def page(text: str, kept: Figures) -> str:
    """The page of the study, ``text``, with its tables as the figures are."""
    tables = {MAKER: table(kept), TAIL_MAKER: tail_table(kept), FOUND_MAKER: found_table()}
    for maker, made in tables.items():
        text = with_table(text, made, maker)
    return text


def ordered() -> list[str]:
    """The controllers in the order of the leaderboard."""
    return [name_of(each) for each in sorted(leaderboard(), key=standing)]


def leaderboard() -> list[Figures]:
    """What is known of the controllers of the leaderboard."""
    return best_known(searched())


def searched() -> list[dict[str, Any]]:
    """The figures of the leaderboard, by the own searches alone."""
    found: list[dict[str, Any]] = json.loads(LEADERBOARD.read_text(encoding="utf-8"))
    return found


def sample(kept: Figures, name: str) -> Mapping[str, Any]:
    """The largest sample of a controller."""
    largest: Mapping[str, Any] = kept["many"].get(name, kept["draws"][name])
    return largest


def draw(kept: Figures) -> None:
    """V found against the probability of a failure and the radius; and how many draws exceed a V."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    figure, (by_bound, by_radius) = plt.subplots(1, 2, figsize=(6.3, 3.4), sharey=True, layout="constrained")
    for each in sorted(leaderboard(), key=standing):
        name, found = name_of(each), each["robustness"]
        bounds = [entry["bound"] for entry in sample(kept, name)["requirements"].values()]
        radius = found["radius"]["stability"]
        (mark,) = by_bound.plot(100.0 * max(bounds), found["cost"], "o", ms=6, label=name)
        reach = found["radius"]["limit"] if radius is None else radius
        by_radius.plot(reach, found["cost"], "o" if radius is not None else ">", ms=6, color=mark.get_color())
    for panel in (by_bound, by_radius):
        panel.axhline(100.0, color="0.6", lw=0.8, ls="--")
    by_radius.axvline(1.0, color="0.6", lw=0.8, ls="--")
    by_bound.set_xlim(left=0.0)
    by_bound.set_xlabel("probability that a draw fails [%],\nupper bound at 99 % confidence", fontsize=8)
    by_radius.set_xlabel("factor on Table 1 at which A1, A2 or A3\nfails (arrow: not found)", fontsize=8)
    by_bound.set_ylabel("V found", fontsize=8)
    by_bound.set_ylim(bottom=0.0)
    figure.legend(loc="outside upper center", ncols=3, fontsize=8)
    figure.savefig(PARETO, dpi=150)

    figure, panel = plt.subplots(figsize=(6.3, 3.4), layout="constrained")
    for name in ordered():
        own = sample(kept, name)
        values, label = np.sort(own["V"]), f"{name}, {own['draws']} draws"
        panel.step(values, 1.0 - np.arange(len(values)) / own["draws"], where="post", lw=1.2, label=label)
    panel.axvline(100.0, color="0.6", lw=0.8, ls="--")
    panel.set_yscale("log")
    panel.set_xlabel("V of a draw", fontsize=8)
    panel.set_ylabel("share of the draws that exceed it", fontsize=8)
    panel.legend(fontsize=8)
    figure.savefig(EXCEEDED, dpi=150)


def _keep(kept: Figures) -> None:
    DATA.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Make the figures of docs/study.md.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"controllers: {', '.join(PAGES)}")
    parser.add_argument("--draws", type=int, default=DRAWS, help=f"of each controller (default: {DRAWS})")
    parser.add_argument("--corners", action="store_true", help="only the draws from the corners")
    parser.add_argument("--probability", action="store_true", help=f"only the larger samples (default: {TOLD[-1]})")
    parser.add_argument("--table", action="store_true", help="only from the figures that are kept")
    options = parser.parse_args()
    os.chdir(ROOT)
    kept = json.loads(DATA.read_text(encoding="utf-8"))
    if options.probability:
        for name in options.names or TOLD[-1:]:
            if not options.corners:
                kept["many"][name] = drawn(name, draws_needed(PROBABILITY, CONFIDENCE))
                _keep(kept)
            kept["many_corners"][name] = drawn(name, MANY_CORNERS, "corners", (RARE,))
    elif not options.table:
        for name in options.names or PAGES:
            if not options.corners:
                kept["draws"][name] = drawn(name, options.draws)
            kept["corners"][name] = drawn(name, options.draws, "corners")
            _keep(kept)
        if RATIONED in (options.names or PAGES) and not options.corners:
            kept["time"] = without_limit()
    _keep(kept)
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8"), kept), encoding="utf-8")
    draw(kept)


if __name__ == "__main__":
    main()
