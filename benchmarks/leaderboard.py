"""The README's leaderboard, from evaluations of the project's own controllers.

    python benchmarks/leaderboard.py                evaluate all (some minutes), keep the figures, write the table
    python benchmarks/leaderboard.py DiagonalPID    evaluate one; the figures of the others stay
    python benchmarks/leaderboard.py --table        write the table anew from the figures that are kept

The figures are kept in docs/leaderboard.json, each with the controller's hash; nothing in the table is typed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from orchestrator.fmus import own_fmu

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "leaderboard.json"
README = ROOT / "README.md"
BEGIN, END = "<!-- leaderboard: made by benchmarks/leaderboard.py -->\n", "<!-- end of leaderboard -->\n"

CONTROLLERS = {
    "DitheredLQG": "controller_fmu/friction",
    "ManipulatorLQG": "controller_fmu/lqg",
    "TunedPID": "controller_fmu/pid_tuned",
    "DiagonalPID": "controller_fmu/pid",
}
"""The project's controllers by the name of their FMU, and where their page is."""

SHOWN = {"B1": 1.0, "B2": 1.0, "B3": 1.0, "B4": 1.0, "B5": 1e3, "B6": 1.0, "B7": 1e3}
"""Factors from SI to the units of the table."""


def evaluate(name: str, folder: Path) -> dict[str, Any]:
    """The figures of one controller on the protocol ``paper``."""
    command = [sys.executable, "-m", "orchestrator.evaluate", str(own_fmu(name)), "--output-dir", str(folder / name)]
    command.append("--no-report")
    subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    results = json.loads((folder / name / "results.json").read_text(encoding="utf-8"))
    return {
        "controller": name,
        "sha256": results["controller"]["sha256"],
        "benchmark": results["benchmark"],
        "protocol": results["protocol"],
        "seed": results["seed"],
        "cost": results["cost"],
        "criteria": {key: entry["value"] for key, entry in results["criteria"].items()},
        "stability": {key: entry["passed"] for key, entry in results["stability"].items()},
    }


def table(figures: list[dict[str, Any]]) -> str:
    """The leaderboard in Markdown, best first among those that hold A1 to A3, then the others."""
    ranked = sorted(figures, key=lambda row: (not all(row["stability"].values()), row["cost"]))
    lines = [
        "| controller | V | A1 A2 A3 | B1 Nm | B2 Nm | B3 Nm | B4 Nm | B5 mm | B6 s | B7 mm |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in ranked:
        verdicts = " ".join("holds" if passed else "fails" for passed in row["stability"].values())
        values = " | ".join(f"{row['criteria'][key] * factor:.3g}" for key, factor in SHOWN.items())
        name = f"[{row['controller']}]({CONTROLLERS[row['controller']]})"
        lines.append(f"| {name} | **{row['cost']:.1f}** | {verdicts} | {values} |")
    return "\n".join(lines) + "\n"


def with_table(readme: str, figures: list[dict[str, Any]]) -> str:
    """The README's text with the leaderboard put between its marks."""
    before, _, rest = readme.partition(BEGIN)
    _, _, after = rest.partition(END)
    return before + BEGIN + table(figures) + END + after


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Make the README's leaderboard.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"controllers to evaluate: {', '.join(CONTROLLERS)}")
    parser.add_argument("--table", action="store_true", help="only write the table from the figures that are kept")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs" / "leaderboard", help="folder of the evaluations")
    options = parser.parse_args()
    kept = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else []
    for name in () if options.table else options.names or CONTROLLERS:
        new = evaluate(name, options.runs)
        kept = [row for row in kept if row["controller"] != name] + [new]
        FIGURES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    README.write_text(with_table(README.read_text(encoding="utf-8"), kept), encoding="utf-8")


if __name__ == "__main__":
    main()
