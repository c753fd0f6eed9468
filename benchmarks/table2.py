"""Where the paper's row of Table 2 lies among the rows that our default PID gets over what the paper leaves open.

    python benchmarks/table2.py --write            a thousand rows: half an hour on two cores
    python benchmarks/table2.py --seeds 2          a look, which writes nothing
    python benchmarks/table2.py --picture          docs/pictures/table2.png from docs/table2.json alone

The paper does not list its 18 configurations, its three systems nor its draws, and prints k_high of axis 2 with a
stray sign. A row is an evaluation, as far as V needs it, with one choice of each. Everything else is the protocol
``paper``. A seed draws three random systems, of which "two random" are any two: three rows, which are not independent.
Simulations are shared by the rows that need them, and kept in runs/table2: an interrupted run goes on.

With --write it writes docs/table2.json, which docs/paper.md tells the story of, and its picture.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402

import build_fmus  # noqa: E402
from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.scorecard import score  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
DATA, PICTURE = ROOT / "docs" / "table2.json", ROOT / "docs" / "pictures" / "table2.png"
WORK = ROOT / "runs" / "table2"

NAMES = ("B1", "B2", "B3", "B4", "B5", "B6", "B7", "V")
FACTORS = {"B5": 1e3, "B7": 1e3}
"""From SI units to the table's."""

RANDOM = ("random_1", "random_2", "random_3")
SYSTEMS = {
    "compliant and two random": ("compliant",),
    "three random": (),
    "nominal and two random": ("nominal",),
    "sticky and two random": ("sticky",),
}
"""Three systems of a row: the predefined one, the rest from RANDOM."""
USUAL = "compliant and two random"

PROTOCOL = """
extends = "paper"
name = "table2"

[workspace]
q_a1_deg = {q_a1}
q_a2_deg = {q_a2}

[grid]
q_a1_points = {first}
q_a2_points = {second}
also_deg = {also}

[sets]
performance = {systems}

[[tests]]
name = "noise"
systems = "performance"
draws = true
duration = 2.0
disturbed = false
criteria = ["B1", "B2"]
"""

DRAWN = """
[[tests]]
name = "disturbance"
systems = "performance"
draws = true
duration = 26.0
criteria = ["B3", "B4", "B5", "B6", "B7"]
"""

LISTED = """
[[tests]]
name = "disturbance_{direction}"
systems = "performance"
direction_deg = {direction}.0
duration = 26.0
criteria = ["B3", "B4", "B5", "B6", "B7"]
"""

Q_A1, Q_A2 = (-90.0, 180.0), (-180.0, 80.0)
"""The workspace [deg]."""


class Choice(NamedTuple):
    """What the paper leaves open: grid, systems that are simulated, how the direction of the force is chosen, and
    k_high of axis 2 [N.m/rad]."""

    title: str
    grid: tuple[int, int]
    predefined: tuple[str, ...] = SYSTEMS[USUAL]
    centres: bool = False
    scattered: int = 0
    directions: tuple[int, ...] = ()
    k_high: float = 0.3e6

    def protocol(self, seed: int) -> str:
        """The protocol file; scattered poses are drawn by ``seed``."""
        (first, second), ends = self.grid, (Q_A1, Q_A2)
        if self.centres:
            halves = [(high - low) / (2 * points) for (low, high), points in zip(ends, self.grid, strict=True)]
            ends = tuple((low + half, high - half) for (low, high), half in zip(ends, halves, strict=True))
        stream = np.random.default_rng([seed, 18])
        also = [[stream.uniform(*Q_A1), stream.uniform(*Q_A2)] for _ in range(self.scattered)]
        text = PROTOCOL.format(
            q_a1=list(ends[0]),
            q_a2=list(ends[1]),
            first=first,
            second=second,
            also=also,
            systems=json.dumps((*self.predefined, *RANDOM)),
        )
        return text + ("".join(LISTED.format(direction=each) for each in self.directions) or DRAWN)


EVERY = tuple(name for predefined in SYSTEMS.values() for name in predefined)

CHOICES = (
    Choice("9 x 2", (9, 2), EVERY),
    Choice("6 x 3", (6, 3), EVERY),
    Choice("3 x 6", (3, 6), EVERY),
    Choice("2 x 9", (2, 9), EVERY),
    Choice("9 x 2, centres of cells", (9, 2), centres=True),
    Choice("6 x 3, centres of cells", (6, 3), centres=True),
    Choice("18 at random", (1, 1), scattered=17),
    Choice("9 x 2, worst of 4 directions", (9, 2), directions=(0, 90, 180, 270)),
    *(Choice(f"9 x 2, k_high[2] {value} MN.m/rad", (9, 2), k_high=1e6 * value) for value in (0.2, 0.4, 0.5)),
)


def rows(choice: Choice, seed: int) -> Iterator[tuple[str, list[float | None]]]:
    """The rows of a choice with one seed: for each of SYSTEMS that was simulated, those of all choices from RANDOM."""
    folder = WORK / "".join(letter if letter.isalnum() else "-" for letter in choice.title)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"seed-{seed}.toml"
    file.write_text(choice.protocol(seed), encoding="utf-8")
    benchmark = Benchmark(file, seed=seed, plant_parameters={"k_high[2]": choice.k_high})
    controller = Controller.built_in("DiagonalPID" + ("_C" if build_fmus.find_compiler() else ""))
    results = benchmark.evaluate(controller, folder=folder, recordings=False, keep_going=True).results
    for title, predefined in SYSTEMS.items():
        if not set(predefined) <= set(choice.predefined) or (title != USUAL and choice.predefined != EVERY):
            continue
        name = choice.title if title == USUAL else f"{choice.title}, {title}"
        for drawn in combinations(RANDOM, 3 - len(predefined)):
            card = score(results.rules, [case for case in results.cases if case.system in (*predefined, *drawn)])
            values = [card.criteria[each].value for each in NAMES[:-1]]
            yield name, [*(shown(*pair) for pair in zip(NAMES, values, strict=False)), shown("V", card.cost)]


def shown(name: str, value: float | None) -> float | None:
    """A value in the table's unit, with the digits that are worth keeping."""
    return None if value is None else float(f"{value * FACTORS.get(name, 1.0):.5g}")


def table(found: dict[str, list[list[float | None]]], paper: Sequence[float]) -> str:
    """Of every choice, mean and standard deviation, and the share of rows that lie below the paper's; in Markdown."""
    lines = ["| | rows | " + " | ".join(NAMES) + " |", "|---" * (len(NAMES) + 2) + "|"]
    lines.append("| paper | | " + " | ".join(f"{value:g}" for value in paper) + " |")
    for title, entries in found.items():
        cells = []
        for column, printed in zip(zip(*entries, strict=True), paper, strict=True):
            known = [value for value in column if value is not None]
            if len(known) < len(column):
                cells.append("-")
                continue
            spread = statistics.stdev(known) if len(known) > 1 else 0.0
            below = 100 * sum(value < printed for value in known) / len(known)
            cells.append(f"{statistics.fmean(known):.3g} ± {spread:.2g}, {below:.0f} %")
        lines.append(f"| {title} | {len(entries)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def draw(found: dict[str, list[list[float | None]]], paper: Sequence[float], file: Path) -> None:
    """Every row as a point, a panel for each criterion, the paper's value as a line."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    titles = list(found)[::-1]
    figure, panels = plt.subplots(2, 4, sharey=True, figsize=(11.0, 7.0), layout="constrained")
    for number, (name, panel) in enumerate(zip(NAMES, panels.flat, strict=True)):
        panel.axvline(paper[number], color="tab:red", lw=1.0)
        for place, title in enumerate(titles):
            values = [entry[number] for entry in found[title] if entry[number] is not None]
            scatter = np.linspace(-0.25, 0.25, len(values))
            panel.plot(values, place + scatter, ".", ms=2.5, color="tab:blue", alpha=0.6)
        unit = {"B5": "mm", "B6": "s", "B7": "mm", "V": ""}.get(name, "N.m")
        panel.set_title(f"{name} [{unit}]" if unit else name, fontsize=9)
        panel.set_yticks(range(len(titles)), titles, fontsize=7)
        panel.tick_params(axis="x", labelsize=7)
        panel.locator_params(axis="x", nbins=5)
        panel.grid(axis="y", lw=0.3)
    figure.suptitle(
        "Rows of Table 2 for the default PID over what the paper leaves open; the line is the paper's", fontsize=10
    )
    figure.savefig(file, dpi=110)


def main() -> int:
    """Evaluate all choices, write, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=17, metavar="N", help="draws of each choice (default: 17)")
    parser.add_argument("--write", action="store_true", help="write docs/table2.json and its picture")
    parser.add_argument("--picture", action="store_true", help="draw what is in docs/table2.json, and evaluate nothing")
    given = parser.parse_args()
    if given.picture:
        stored = json.loads(DATA.read_text(encoding="utf-8"))
        draw(stored["rows"], stored["paper"], PICTURE)
        return 0
    paper = [value for name, value in Benchmark().rules.reference.items() if name in NAMES]
    paper = [shown(name, value) or 0.0 for name, value in zip(NAMES, paper, strict=True)]
    found: dict[str, list[list[float | None]]] = {}
    for seed in range(given.seeds):
        for choice in CHOICES:
            for title, entry in rows(choice, seed):
                found.setdefault(title, []).append(entry)
            print(f"seed {seed}: {choice.title}", file=sys.stderr)
    command = f"python benchmarks/table2.py --seeds {given.seeds} --write"
    print(table(found, paper))
    print(f"\n{sum(map(len, found.values()))} rows")
    if not given.write:
        return 0
    contents = {"command": command, "columns": NAMES, "paper": paper, "rows": found}
    DATA.write_text(json.dumps(contents).replace("], [", "],\n[") + "\n", encoding="utf-8")
    draw(found, paper, PICTURE)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
