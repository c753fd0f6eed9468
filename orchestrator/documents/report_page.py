"""The page ``report.html`` of one run: its tabs, with their tables and plots."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from ..benchmark.results import CaseResult, ConfigurationScore, Rules
from ..benchmark.scorecard import kind, outcome
from ..benchmark.tally import tally
from ..loop.trajectory import Status
from ..views.plot import HUES, Axis, Band, Bars, Heat, Layer, Level, Plot, PosedArm, Scatter, Symbol, Window
from ..views.table import (
    Beside,
    Cell,
    Column,
    Commands,
    Facts,
    Headline,
    Link,
    Note,
    Page,
    Panel,
    Part,
    Table,
    VerdictCell,
)
from ..views.units import MICROMETRE, SECOND, amplitude, number
from . import case_plots, scorecard
from .case_plots import degrees
from .commands import recording_command, simulate_command
from .head import PlantRecord
from .recording import SYSTEMS, Recording, affordable, largest_error, shortened
from .results import Results, Run, contradictions
from .wording import reason_notes, remarks, without_cost

WITHOUT = Note("This run was made without trajectories.")


SPREAD_ROWS = 1500
"""Most rows of each of the many trajectories of Figures 11 and 12."""

SMALLEST = 1e-8
"""Limit cycles [m] that are smaller are drawn here."""

SYMBOLS: tuple[Symbol, ...] = ("circle", "square", "triangle", "diamond", "ring", "frame")
"""Of tests, one after the other."""

BESIDE = 0.14
"""Distance of two tests of a configuration."""


def page(run: Run) -> Page:
    """The report of a run."""
    results, rules = run.results, run.results.rules
    recordings = affordable([entry for entry in run.recordings if SYSTEMS not in entry.about.roles])
    # Reversed, so that of several recordings of a case links lead to the first.
    shown = {entry.about.id: index for index, entry in reversed(list(enumerate(recordings)))}
    failures = [case for case in results.cases if case.status is not Status.DONE]
    case: Part = WITHOUT
    motion: tuple[Part, ...] = (WITHOUT,)
    if recordings:
        commands = [recording_command(results.head, entry.about) for entry in recordings]
        case = case_plots.cases(recordings, rules, commands)
        motion = case_plots.motion(recordings, rules, links(results.plant), commands)
    panels = (
        Panel("summary", "Summary", _summary(run, shown)),
        Panel("workspace", "Workspace", workspace(results.plant, rules, {"": results.configurations})),
        Panel("case", "Time plots", (case,)),
        Panel("spread", "Uncertainty", _spread(run)),
        Panel("stability", "Stability", _stability(results, shown)),
        Panel("motion", "Motion", motion),
        Panel("failures", f"Unstable or unfinished ({len(failures)})", _failures(results, shown)),
    )
    title = f"{results.controller.file}: V = {number(results.cost)}"
    conclusion = scorecard.conclusion(results, shown, run.folder)
    return Page(title, scorecard.conditions(results), panels, conclusion)


def headline(results: Results) -> Headline:
    """V beside the paper's PID and the target, and what it comes to."""
    cost, target, paper = results.cost, results.rules.cost.target, results.rules.cost.paper
    sentence = f"No cost: {without_cost(results) or 'a case that counts has no value'}."
    if cost is not None:
        side, direction = "At or below" if cost <= target else "Above", "less" if cost < paper else "more"
        change = f"{abs(100 * (cost - paper) / paper):.0f} % {direction}"
        sentence = f"{side} the target of {target:g}, {change} than the paper reports for its PID."
    return Headline("Cost V", cost, (("target", target), ("paper's PID", paper)), sentence)


def _summary(run: Run, shown: Mapping[str, int]) -> tuple[Part, ...]:
    results = run.results
    wrong = [Note(f"Results and recordings differ. {line}.") for line in contradictions(run)]
    left: tuple[Part, ...] = (headline(results), shares(results))
    right: tuple[Part, ...] = (scorecard.requirements(results, shown), *reason_notes(scorecard.reasons(results)))
    return (
        *wrong,
        *(Note(remark) for remark in remarks(results)),
        Beside((left, right)),
        scorecard.criteria(results, shown),
        Facts("This run", tuple(scorecard.facts(results))),
    )


def shares(results: Results) -> Plot:
    """What V consists of: the share of every criterion beside its share on target."""
    scores = results.criteria
    valued = [(name, score.share) for name, score in scores.items() if score.share is not None]
    text = "No criterion has a value."
    if valued:
        name, share = max(valued, key=lambda entry: entry[1])
        text = (
            f"{name}, {scores[name].title.lower()}, has the largest share of V: {number(share)}, "
            f"{number(share / scores[name].weight)} times its share on target."
        )
    values = tuple(score.share for score in scores.values())
    targets = tuple(score.weight for score in scores.values())
    series = Bars("on target", targets, "soft"), Bars("this controller", values, labels=tuple(map(number, values)))
    names = tuple(f"{name} {score.title}" for name, score in scores.items())
    return Plot(
        "share-chart", "What V consists of", Axis(), Axis(names=names, inverse=True), series, text=text, height=32
    )


def spread_plots(recorded: list[Recording], results: Results) -> tuple[Plot, Plot]:
    """Figures 11 and 12: many uncertain systems in one pose, due to the force and due to the chirp."""
    rules = results.rules
    longest = max(recorded, key=lambda entry: entry.about.time)
    begin, end = longest.about.window
    start, pose = longest.about.chirp[0], case_plots.pose_words(longest.about.q_a)
    forced, chirped = (begin, math.inf), (start, begin)
    told = case_plots.dispersion
    force = case_plots.errors(
        "spread-force",
        "TCP error due to the force",
        case_plots.spread_curves(recorded, lambda entry: largest_error(entry, *forced)),
        rules,
        Window("", (begin - 0.2, longest.about.time)),
        text=f"{len(recorded)} uncertain systems with their disturbances at {pose} (Figure 11): "
        f"{told(recorded, rules, 'B5', forced, 'the force')}.",
        bands=(Band(begin, end, "force"),),
        of=longest,
    )
    chirp = case_plots.errors(
        "spread-chirp",
        "TCP error due to the chirp",
        case_plots.spread_curves(recorded, lambda entry: largest_error(entry, *chirped)),
        rules,
        Window("", (0.0, begin - 0.5)),
        text="The same systems under the motor torque disturbance (Figure 12): "
        f"{told(recorded, rules, 'B7', chirped, 'it')}. Blue: the system assumed to be the worst; orange, where it is "
        "another one: the worst of all.",
        of=longest,
    )
    return force, chirp


def _spread(run: Run) -> tuple[Part, ...]:
    recorded = run.recorded(SYSTEMS)
    if not recorded:
        return (WITHOUT,)
    commands = ((entry.about.id, recording_command(run.results.head, entry.about)) for entry in recorded)
    curves = [shortened(entry, SPREAD_ROWS) for entry in recorded]
    return *spread_plots(curves, run.results), Commands("repeat one of these cases", tuple(commands))


def tested(results: Results) -> list[tuple[CaseResult, bool | None]]:
    """Every case with a requirement, and whether it passed (None: not judged)."""
    limits = results.rules.stability
    asked = (case for case in results.cases if results.rules.test(case.test).requirements)
    return [(case, tally([outcome(case, limits)], 1).passed) for case in asked]


def limit_cycles(results: Results) -> Plot:
    """The limit cycles of all tests with a requirement over the configurations, on a logarithmic scale."""
    cases, limit = tested(results), results.rules.stability.limit_cycle
    tests = list(dict.fromkeys(case.test for case, _ in cases))
    sized = [(case, size) for case, _ in cases if (size := case.measurements.limit_cycle) is not None]
    indices = [entry.index for entry in results.configurations]
    highest = max([limit, *(size for _, size in sized)])
    micro = MICROMETRE.factor
    x = Axis("Configuration", low=min(indices) - 0.5, high=max(indices) + 0.5)
    top = 10.0 ** math.ceil(math.log10(1.3 * highest * micro)) / micro
    y = Axis("Limit cycle", MICROMETRE, SMALLEST, top, logarithmic=True)
    series = tuple(_cycles(sized, test, place, len(tests)) for place, test in enumerate(tests))
    failed = sum(passed is False for _, passed in cases)
    words = number(limit, micro)
    text = (
        f"{len(cases)} tests over the configurations: {failed} failed: a lasting limit cycle of {words} µm or more, "
        "unstable, or ended by the controller."
    )
    if not_judged := sum(passed is None for _, passed in cases):
        text += f" {not_judged} not judged: skipped or lost."
    if unknown := len(cases) - len(sized):
        text += f" {unknown} have no amplitude and stand in the table only."
    return Plot("stability-chart", "", x, y, series, (Level(limit, f"{words} µm"),), text=text, height=380)


def _cycles(sized: list[tuple[CaseResult, float]], test: str, place: int, count: int) -> Scatter:
    """The limit cycles of one test, beside those of the others."""
    shown = [(case, size) for case, size in sized if case.test == test]
    x = [case.configuration.index + (place - (count - 1) / 2) * BESIDE for case, _ in shown]
    words = tuple(f"{case.id}: {amplitude(size)}" for case, size in shown)
    symbol = SYMBOLS[place % len(SYMBOLS)]
    return Scatter(test, x, [max(size, SMALLEST) for _, size in shown], HUES[place % 5], symbol, 9.0, words)


def _stability(results: Results, shown: Mapping[str, int]) -> tuple[Part, ...]:
    """Every test with a requirement, the largest limit cycle first."""
    limits, places = results.rules.stability, scorecard.poses(results)
    columns = (
        Column("case"),
        Column("q_a1 / q_a2"),
        Column("system"),
        Column("test"),
        Column("status"),
        Column("limit cycle", MICROMETRE),
        Column("ratio"),
        Column("verdict"),
    )
    rows: list[tuple[Cell, ...]] = []
    for case, passed in sorted(tested(results), key=lambda row: _size(row[0].measurements.limit_cycle), reverse=True):
        link = Link(case.id, simulate_command(results.head, case.id), shown.get(case.id))
        words = kind(case, limits) if case.simulated else "failed"
        cycle = (case.measurements.limit_cycle, case.measurements.limit_cycle_ratio)
        place = places[case.configuration.index]
        rows.append(
            (
                link,
                place,
                case.system,
                case.test,
                case.status.value,
                *cycle,
                VerdictCell(passed, words if passed is not None else ""),
            )
        )
    caption = (
        "Every test with a requirement, with its limit cycle (half the largest distance between two places of the TCP "
        f"at the end) against {number(limits.limit_cycle * 1e6)} µm. The ratio is that to the amplitude in the seconds "
        "before: a motion that dies away is a ring-down, not a limit cycle. A test also fails where the TCP does not "
        "come to rest."
    )
    return (limit_cycles(results), Table("Stability tests", columns, tuple(rows), caption=caption))


def _size(limit_cycle: float | None) -> float:
    return math.inf if limit_cycle is None else limit_cycle  # none at all is the worst


def _failures(results: Results, shown: Mapping[str, int]) -> tuple[Part, ...]:
    failures = [case for case in results.cases if case.status is not Status.DONE]
    if not failures:
        return (Note(f"None: all {len(results.cases)} cases ran to their end and came to rest.", warning=False),)
    counts = Counter(case.status.value for case in failures)
    words = ", ".join(f"{count} {status}" for status, count in counts.items())
    rows: list[tuple[Cell, ...]] = []
    for case in failures:
        link = Link(case.id, simulate_command(results.head, case.id), shown.get(case.id))
        rows.append((link, VerdictCell(False if case.judged else None, case.status.value), case.time, case.message))
    columns = (Column("case"), Column("status"), Column("time", SECOND), Column("message"))
    note = f"{words}, of {len(results.cases)} cases. A case that was skipped or lost says nothing about the controller."
    return (Note(note, warning=False), Table("Unstable or unfinished cases", columns, tuple(rows)))


HEAT, ARM = "heat", "arm"
"""Ids of the map and of the arm beside it."""


def links(plant: PlantRecord) -> tuple[float, float]:
    """Lengths of the arm's links [m]."""
    return plant.nominal["l[1]"], plant.nominal["l[2]"]


def workspace(plant: PlantRecord, rules: Rules, scores: Mapping[str, Sequence[ConfigurationScore]]) -> tuple[Part, ...]:
    """The workspace as a map of V_k and b_i: the ``scores`` by whose they are, or differences between those of several;
    and the arm in the pose that is pointed at."""
    places = [*next(iter(scores.values()))]
    columns = sorted({place.q_a1 for place in places})
    rows = sorted({place.q_a2 for place in places}, reverse=True)
    grid = [next((p for p in places if (p.q_a1, p.q_a2) == (column, row)), None) for row in rows for column in columns]
    layers = tuple(layer for of, entries in scores.items() for layer in _layers(rules, of, entries, grid))
    heat = Heat(
        HEAT,
        "",
        Axis("q_a1", names=tuple(map(degrees, columns))),
        Axis("q_a2", names=tuple(map(degrees, rows))),
        layers,
        tuple(None if place is None else _pose(place) for place in grid),
        "over the link angles, q_a1 to the right, q_a2 upwards. Dots: the TCP of every configuration.",
        "is better" if len(scores) > 1 else "",
    )
    poses = tuple(None if place is None else (place.q_a1, place.q_a2) for place in grid)
    return (Beside(((heat,), (PosedArm(ARM, links(plant), HEAT, poses),)), equal=True),)


def _pose(place: ConfigurationScore) -> str:
    return f"configuration {place.index}: q_a1 {degrees(place.q_a1)}, q_a2 {degrees(place.q_a2)}"


def _layers(
    rules: Rules, of: str, scores: Sequence[ConfigurationScore], grid: Sequence[ConfigurationScore | None]
) -> list[Layer]:
    """V_k and each b_i of one controller over the places of the ``grid``."""
    by_index = {score.index: score for score in scores}
    placed = [None if place is None else by_index.get(place.index) for place in grid]
    costs = tuple(None if score is None else score.cost for score in placed)
    layers = [Layer("V_k, the cost of a configuration", costs, "V_k", of, rules.cost.target)]
    for place, (name, spec) in enumerate(rules.criteria.items(), start=1):
        values = tuple(None if score is None else score.relative.get(name) for score in placed)
        layers.append(Layer(f"b{place}: {spec.title}, worst value / target", values, f"b{place}", of, 1.0))
    return layers
