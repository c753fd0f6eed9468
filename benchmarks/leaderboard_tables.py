"""The tables of the leaderboard: what benchmarks/leaderboard.py writes into README, docs/ and controllers' pages."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.claims import Claim, Figures, best_known, claims, counting, known, name_of  # noqa: E402
from benchmarks.marked_tables import folded, with_table  # noqa: E402
from benchmarks.submissions import BASELINE, LEGEND, SUBMISSIONS, VERIFIED, held, submissions, verified_table  # noqa: E402
from orchestrator.views.units import SHOWN, amplitude, number  # noqa: E402

README, BOARD, SEARCHES = ROOT / "README.md", ROOT / "docs" / "leaderboard.md", ROOT / "docs" / "robustness.md"
"""Where the short table stands, the whole one, and that of the starts of the searches."""

PICTURE = ROOT / "docs" / "pictures" / "pareto.png"

PAGES = {
    "SteadyLQG": "controller_fmu/steady_c",
    "RobustLQG": "controller_fmu/robust_c",
    "RobustLinearLQG": "controller_fmu/robust_linear",
    "DitheredLQG": "controller_fmu/friction",
    "ManipulatorLQG": "controller_fmu/lqg",
    "TunedPID": "controller_fmu/pid_tuned",
    "DiagonalPID": "controller_fmu/pid",
}
"""The project's controllers by the name of their FMU, and where their page is."""


def animation(name: str) -> Path:
    """The picture of a controller's arm under the force, which benchmarks/animation.py makes."""
    return PICTURE.parent / f"disturbance-{name}.gif"


HEAD = "| controller | V | A1 A2 A3 | B1 Nm | B2 Nm | B3 Nm | B4 Nm | B5 mm | B6 s | B7 mm |\n" + 10 * "|---" + "|\n"
SEARCH_HEAD = "search budget | attacks by others |"
WORST_HEAD = (
    "| controller | V | V strict | V found | A1 A2 A3 | strict | found | B5 mm | B6 s | gain | delay ms | radius "
    f"| {SEARCH_HEAD}\n" + 14 * "|---" + "|\n"
)
MAKER = "benchmarks/leaderboard.py"
BOARD_HEAD = (
    f"| controller | V | V found (at least) | `paper` | `strict` | found | {SEARCH_HEAD}\n" + 8 * "|---" + "|\n"
)
MORE_HEAD = (
    "| controller | V strict | B5 mm | B6 s | gain | delay ms | radius | motion, repeat |\n" + 8 * "|---" + "|\n"
)
BRIEF_HEAD = f"| controller | V | V found (at least) | requirements | {SEARCH_HEAD}\n" + 6 * "|---" + "|\n"

CRITERIA = {"V": "", "B5": "m", "B6": "s", "B7": "m"}
"""The SI units of what a claim without arms can be about, beside margins."""

REACHES = ("cost", "stability")
"""Parts of the robustness radius: of V, and of A1-A3."""


def standing(figures: Figures) -> tuple[bool, float]:
    """What the order goes by: those first for which no system was found that breaks a requirement, then V found."""
    found = figures["robustness"]
    return not all(entry["passed"] for entry in found["requirements"].values()), found["cost"]


def row(figures: Figures, name: str) -> str:
    """A line of a table of criteria."""
    values = " | ".join(shown(entry) for entry in figures["criteria"].values())
    return f"| {name} | **{figures['cost']:.1f}** | {verdicts(figures['stability'])} | {values} |\n"


def worst_row(figures: Figures, name: str) -> str:
    """A line of the table of worst cases, of what is :func:`known`."""
    strict, found = figures["strict"], figures["robustness"]
    cells = (
        f"{figures['cost']:.1f}",
        f"{strict['cost']:.1f}",
        _worst_cost(found),
        *map(verdicts, (figures["stability"], strict["stability"], found["requirements"])),
        *_extremes(found),
        *_searched(figures),
    )
    return f"| {name} | {' | '.join(cells)} |\n"


def _extremes(found: Mapping[str, Any]) -> tuple[str, ...]:
    """The largest B5 and B6 found, margins of gain and delay, and the radius."""
    margins, radius = found["margins"], found["radius"]
    gains, delays = (
        " and ".join(_margin(margins[f"{kind}_{axis}"], factor) for axis in (1, 2))
        for kind, factor in (("gain", 1.0), ("delay", 1e3))
    )
    worst = (shown(found["worst_case"][key]) for key in ("B5", "B6"))
    return (*worst, gains, delays, " and ".join(_reach(radius, key) for key in REACHES))


def shown(entry: Mapping[str, Any]) -> str:
    """A value with its ``unit`` as the tables show it."""
    return number(entry["value"] * SHOWN[entry["unit"]].factor)


def verdicts(requirements: Mapping[str, Mapping[str, Any]]) -> str:
    """Whether each of the requirements holds."""
    return held({name: entry["passed"] for name, entry in requirements.items()})


def _margin(margin: Mapping[str, Any], factor: float) -> str:
    value = margin["value"]
    return f"> {number(factor * margin['limit'])}" if value is None else number(value, factor, exact=True)


def _reach(radius: Mapping[str, Any], part: str) -> str:
    value = radius[part]
    if value is None:
        return f"> {radius['limit']:g}"
    return f"≤ {number(value)}" if part in radius["at_most"] else number(value)


def _searched(figures: Figures) -> tuple[str, str]:
    """What was tried: without it, a V found and "no failure found" say nothing (docs/rules.md)."""
    found = figures["robustness"]
    return f"{found['budget']:,} in {len(found['starts'])} starts{_of_version(figures)}", str(found["attacks"])


def _of_version(figures: Figures) -> str:
    """The version of the benchmark that a search is of, if it is not that of the other figures."""
    version: str = figures["robustness"]["benchmark"]
    return "" if version == figures["benchmark"] else f", {version.rpartition('-')[2]}"


def _worst_cost(found: Mapping[str, Any], mark: str = "**") -> str:
    """The largest V known; beside it that of the own search, where others found more."""
    own = "" if found["cost"] == found["own_cost"] else f" (own search: {found['own_cost']:.1f})"
    return f"{mark}{found['cost']:.1f}{mark}{own}"


def brief(kept: Sequence[Figures]) -> str:
    """The README's table, in the order of what was found."""
    return BRIEF_HEAD + "".join(
        f"| [{name_of(each)}]({PAGES[name_of(each)]}/README.md) | {each['cost']:.1f} "
        f"| {_worst_cost(each['robustness'], '')} | {_failing(each)} "
        f"| {' | '.join(_searched(each))} |\n"
        for each in sorted(kept, key=standing)
    )


def _failing(figures: Figures) -> str:
    """The requirements that some case fails: of ``paper``, of ``strict``, or found by a search."""
    judged = (figures["stability"], figures["strict"]["stability"], figures["robustness"]["requirements"])
    failing = sorted({name for each in judged for name, entry in each.items() if entry["passed"] is False})
    if not failing:
        return "no failure found"
    return f"{', '.join(failing)} fail{'s' if len(failing) == 1 else ''}"


def leaderboard(kept: Sequence[Figures]) -> str:
    """The tables of docs/leaderboard.md, in the order of what was found: the verdicts and V, and, folded away, the
    other figures. A name links to the controller's page, the last cells to its animation and to the commands that
    repeat its worst cases."""
    ordered = sorted(kept, key=standing)
    return BOARD_HEAD + "".join(map(_board_row, ordered)) + folded("Margins, radius, largest B5 and B6", more(ordered))


def _board_row(figures: Figures) -> str:
    """The verdicts and V of a controller, and how long was searched."""
    found = figures["robustness"]
    judged = (figures["stability"], figures["strict"]["stability"], found["requirements"])
    cells = (f"{figures['cost']:.1f}", _worst_cost(found), *map(verdicts, judged), *_searched(figures))
    return f"| {_linked(figures)} | {' | '.join(cells)} |\n"


def more(kept: Sequence[Figures]) -> str:
    """What else is known of each controller."""
    lines = []
    for each in kept:
        links = (f"[GIF](pictures/{animation(name_of(each)).name})", f"[commands]({_page(each)}#scorecard)")
        cells = (f"{each['strict']['cost']:.1f}", *_extremes(each["robustness"]), ", ".join(links))
        lines.append(f"| {_linked(each)} | {' | '.join(cells)} |\n")
    return MORE_HEAD + "".join(lines)


def _page(figures: Figures) -> str:
    return f"../{PAGES[name_of(figures)]}/README.md"


def _linked(figures: Figures) -> str:
    return f"[{name_of(figures)}]({_page(figures)})"


def starts(kept: Sequence[Figures]) -> str:
    """How far V of the own searches depends on the start, in the order of what is known."""
    lines = []
    for each in sorted(kept, key=standing):
        found = each["robustness"]
        smallest, largest = min(found["starts"]), max(found["starts"])
        costs = ", ".join(f"{cost:.1f}" for cost in found["starts"])
        lines.append(
            f"| `{name_of(each)}` | {found['budget']:,}{_of_version(each)} | {found['simulations']:,} "
            f"| {found['own_cost']:.1f} | {costs} | {100.0 * (largest - smallest) / largest:.1f} % "
            f"| {found['attacks']} | {found['cost']:.1f} |\n"
        )
    head = (
        "| controller | budget, whole cases | simulations | V of all starts | V of each start | spread "
        "| attacks by others | V found by anybody |\n"
    )
    return head + 8 * "|---" + "|\n" + "".join(lines)


def scorecard(kept: Sequence[Figures], others: Sequence[Claim], name: str) -> str:
    """The tables of a controller's own page: its figures, their shares of V, those on ``strict``, the baseline's; and
    the worst cases found, with the commands that repeat them; the spread over seeds."""
    own, baseline = (next(each for each in kept if name_of(each) == wanted) for wanted in (name, BASELINE))
    repeatable = known(own, [claim for claim in others if claim.command])["robustness"]
    worst = known(own, others)
    reported = [claim for claim in counting(own, others).values() if not claim.command]
    shares = " | ".join(number(entry["share"]) for entry in own["criteria"].values())
    version = _of_version(own).removeprefix(", v")
    told = (
        f"What was found, and the spread over seeds, are of version {version} of the benchmark.\n\n" if version else ""
    )
    compared = "" if name == BASELINE else row(baseline, BASELINE)
    return (
        f"{HEAD}{row(own, name)}| of V | | | {shares} |\n{row(own['strict'], f'{name}, `strict`')}{compared}\n"
        f"{LEGEND}\n\n"
        f"{WORST_HEAD}{worst_row(worst, name)}\n{told}{broken(repeatable, worst['robustness'])}"
        f"{_seeds(own)}\n{largest(repeatable)}{_reported(reported)}"
    )


def _reported(claimed: Sequence[Claim]) -> str:
    """What others reported without the arms."""
    if not claimed:
        return ""
    words = "; ".join(f"{_words(claim)} ({claim.by}, {claim.date})" for claim in claimed)
    return f"\nReported, and not repeated here, since the arms were not published: {words}.\n"


def _words(claim: Claim) -> str:
    """What a claim says of its figure."""
    assert claim.value is not None
    if claim.figure.startswith("delay"):
        return f"a failure at `{claim.figure}` of {number(claim.value, 1e3, exact=True)} ms"
    if claim.figure.startswith("gain"):
        return f"a failure at `{claim.figure}` of {number(claim.value, exact=True)}"
    unit = SHOWN[CRITERIA[claim.figure]]
    return f"{claim.figure} of {number(claim.value * unit.factor)} {unit.shown}".rstrip()


def _seeds(figures: Figures) -> str:
    """How V varies with the seed, and what a step costs."""
    seeds, step = figures.get("seeds"), figures.get("computing_time")
    if seeds is None or step is None:
        return ""
    cost = seeds["cost"]
    held = ", ".join(f"{name} for {entry['seeds']}" for name, entry in seeds["requirements"].items())
    return (
        f"\nOver {seeds['count']} seeds of `paper`, V is {number(cost['mean'])} ± {number(cost['deviation'])}, from "
        f"{number(cost['smallest'])} to {number(cost['largest'])}; there hold {held}. A step of the FMU takes "
        f"{number(step['median'], 1e6)} µs (median; {number(step['percentile_99'], 1e6)} µs for 99 of 100).\n"
    )


def broken(found: Mapping[str, Any], known: Mapping[str, Any]) -> str:
    """What was ``found`` against the requirements, with the commands; if nothing was, what was tried, and the largest V
    that is ``known``."""
    failures: dict[str, tuple[Mapping[str, Any], list[str]]] = {}
    for name, entry in found["requirements"].items():
        if entry["passed"] is False:
            failures.setdefault(entry["command"], (entry, []))[1].append(name)
    if not failures:
        return (
            f"No system that breaks A1, A2 or A3 was found, by the own search in {found['simulations']:,} simulations "
            f"(a budget of {found['budget']:,} whole cases, in {len(found['starts'])} starts). Attacks by others: "
            f"{known['attacks']}. The largest V that anybody has found is {known['cost']:.1f}.\n"
        )
    return "\n".join(
        f"**{' and '.join(names)} fail{'s' if len(names) == 1 else ''}** for a system within Table 1: {entry['kind']}, "
        f"{amplitude(entry['limit_cycle'] or math.nan)} at {number(entry['frequency'] or math.nan)} Hz"
        f"{_at_rest(entry)}, with {entry['seeds_failed']} of {entry['seeds_tried']} realizations of the noise:\n\n"
        f"```sh\n{command}\n```\n"
        for command, (entry, names) in failures.items()
    )


def _at_rest(entry: Mapping[str, Any]) -> str:
    """How far away the TCP stays, where that is kept."""
    error = entry.get("rest_error")
    return "" if error is None else f" around a place {number(error, 1e3)} mm away"


def largest(found: Mapping[str, Any]) -> str:
    """The worst cases found, and those that the margins are of, with their commands."""
    lines = [
        f"# {name} {shown(entry)} {SHOWN[entry['unit']].shown}\n{entry['command']}"
        for name, entry in found["worst_case"].items()
    ]
    for name, entry in found["margins"].items():
        if entry["value"] is not None:
            kind, factor, unit = ("delay", 1e3, " ms") if name.startswith("delay") else ("gain", 1.0, " times")
            where = "axis " + name.removeprefix(f"{kind}_").replace("_down", ", downwards")
            lines.append(
                f"# {kind} margin of {where}: {number(entry['value'], factor, exact=True)}{unit}\n{entry['command']}"
            )
    return "The worst cases found, and what the margins were found with:\n\n```sh\n" + "\n".join(lines) + "\n```\n"


def draw(kept: Sequence[Figures], file: Path) -> None:
    """V on ``strict``, and the largest V known, against the factor on all tolerances at which a requirement fails: low
    and right is good."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panel = plt.subplots(figsize=(6.3, 3.6), layout="constrained")
    panel.axhline(100.0, color="0.6", lw=0.8, ls="--")
    panel.axvline(1.0, color="0.6", lw=0.8, ls="--")
    panel.annotate("target", (0.0, 100.0), xycoords=("axes fraction", "data"), fontsize=7, color="0.4", va="bottom")
    for each in best_known(kept):
        cost, radius = each["strict"]["cost"], each["robustness"]["radius"]
        reach = radius["limit"] if radius["stability"] is None else radius["stability"]
        point = ">" if radius["stability"] is None else "o"
        (mark,) = panel.plot(reach, cost, point, ms=8)
        panel.plot(2 * [reach], [cost, each["robustness"]["cost"]], "-", color=mark.get_color(), lw=1.2)
        panel.plot(reach, each["robustness"]["cost"], "_", color=mark.get_color(), ms=10)
        panel.annotate(
            f" {name_of(each)}", (reach, cost), fontsize=8, va="top", xytext=(4, -3), textcoords="offset points"
        )
    panel.set_xlabel("robustness radius: factor on Table 1 at which A1, A2 or A3 fails (arrow: not found)", fontsize=8)
    panel.set_ylabel("V on strict, up to V found", fontsize=8)
    panel.set_xlim(right=1.45)
    panel.set_ylim(bottom=0.0)
    figure.savefig(file, dpi=150)


def pages(kept: Sequence[Figures]) -> dict[Path, str]:
    """The files that hold a table, with what they should say, by the figures and the claims that are kept."""
    others, worst = claims(), best_known(kept)
    tables = {
        README: brief(worst),
        BOARD: leaderboard(worst),
        SEARCHES: starts(worst),
        VERIFIED: verified_table(submissions(SUBMISSIONS)),
    }
    names = {name_of(each) for each in kept}
    tables |= {
        ROOT / folder / "README.md": scorecard(kept, others, name)
        for name, folder in PAGES.items()
        if {name, BASELINE} <= names
    }
    return {file: with_table(file.read_text(encoding="utf-8"), table, MAKER) for file, table in tables.items()}
