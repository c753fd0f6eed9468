"""Plots of a tuning: how the search went, which parameters matter, and what a lower V costs in stability."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence

from ..search.candidates import Range, Trial
from ..views.plot import Axis, Bars, Level, Line, Plot, Scatter
from ..views.units import number

WORST_SHOWN = 3.0
"""Times the best value: what is worse is drawn there, else it would press the others together."""

CLIPPED = f"What is worse than {WORST_SHOWN:g} times the best stands at the end of the axis."


def bounded(title: str, values: Iterable[float]) -> Axis:
    """An axis for positive values, whose end the worst of them may exceed."""
    listed = list(values)
    smallest, largest = min(listed), max(listed)
    low = float(f"{0.95 * smallest:.2g}")
    return Axis(title, low=low, high=float(math.ceil(min(1.05 * largest, WORST_SHOWN * smallest))))


def _on(axis: Axis, value: float) -> float:
    """Where a value stands on the axis."""
    return value if axis.high is None else min(value, axis.high)


def words(trial: Trial) -> str:
    """A candidate and its values, a line each."""
    objective = " and worse, cut short" if trial.cut_short else f", objective {number(trial.objective)}"
    values = (f"{name} = {number(value)}" for name, value in trial.values.items())
    return "\n".join(
        (f"trial {trial.number}: V = {number(trial.cost)}{objective}", *filter(None, [trial.message]), *values)
    )


Place = Callable[[Trial], tuple[float, float]]


def _kinds(trials: Iterable[Trial], best: Trial | None, place: Place) -> tuple[Scatter, ...]:
    """The candidates by what they came to; the best one stands out."""
    listed = list(trials)
    whole = [trial for trial in listed if not trial.cut_short]

    def points(name: str, some: Iterable[Trial]) -> tuple[str, list[float], list[float], tuple[str, ...]]:
        shown = list(some)
        x, y = ([place(trial)[axis] for trial in shown] for axis in (0, 1))
        return name, x, y, tuple(map(words, shown))

    cut = points("cut short", (trial for trial in listed if trial.cut_short))
    fail = points("A1–A3 fail", (trial for trial in whole if not trial.holds))
    hold = points("A1–A3 hold", (trial for trial in whole if trial.holds))
    winner = points("best", [] if best is None else [best])
    kinds = (
        Scatter(*cut[:3], "soft", "circle", 6.0, cut[3], faint=True),
        Scatter(*fail[:3], "bad", "triangle", words=fail[3]),
        Scatter(*hold[:3], "one", "circle", words=hold[3]),
        Scatter(*winner[:3], "good", "diamond", 18.0, winner[3]),
    )
    return tuple(kind for kind in kinds if len(kind.x))


def history(
    trials: Sequence[Trial], best: Trial | None, target: float, objective: str, added: Mapping[int, int]
) -> Plot:
    """The objective, trial by trial, with the best so far, and where cases were ``added``: how many, after how many
    trials."""
    axis = bounded("Objective", [target, *(trial.objective for trial in trials)])
    least, steps = math.inf, []
    for trial in trials:
        # Of what was cut short A1 to A3 were not tested: its objective is a lower bound alone.
        least = least if trial.cut_short else min(least, trial.objective)
        steps.append(_on(axis, least) if math.isfinite(least) else None)
    numbers = [float(trial.number) for trial in trials]
    line = Line("best so far", numbers, steps, "accent", width=2.0, step=True)
    points = _kinds(trials, best, lambda trial: (float(trial.number), _on(axis, trial.objective)))
    levels = [
        Level(float(after), f"+{count}", upright=True, colour="two", dash="dotted") for after, count in added.items()
    ]
    told = "No case was added."
    if added:
        places = ", ".join(f"after {after} trials" for after in added)
        told = (
            f"Dotted: where cases that failed in the whole protocol were added (+ their number), {places}; the best "
            "candidates were tried again with them, so that a point is what its candidate came to at last."
        )
    text = (
        f"The objective: V of the protocol {objective}, and more where A1 to A3 fail. Of candidates that were cut "
        f"short it is V alone. {told} {CLIPPED}"
    )
    return Plot(
        "history-chart",
        "The objective, trial by trial",
        Axis("Trial", low=0.0, high=float(len(trials))),
        axis,
        (line, *points),
        (Level(target, "target"), *levels),
        text=text,
        height=480,
    )


def importance(shares: Mapping[str, float]) -> Plot | None:
    """The share of each parameter in how the objective varies; None if there is none."""
    if not shares:
        return None
    rows = sorted(shares.items(), key=lambda row: -row[1])
    values = tuple(share for _, share in rows)
    return Plot(
        "importance-chart",
        "Which parameters matter",
        Axis("Share in how the objective varies"),
        Axis(names=tuple(name for name, _ in rows), inverse=True),
        (Bars("importance", values, labels=tuple(map(number, values))),),
        text="The share of each parameter in how the objective varies among the better candidates (PED-ANOVA).",
        height=32,
    )


def by_parameter(name: str, place: int, given: Range, trials: Sequence[Trial], best: Trial | None) -> Plot:
    """The objective over the values of one parameter, the one at this ``place``."""
    axis = bounded("Objective", (trial.objective for trial in trials))
    points = _kinds(trials, best, lambda trial: (trial.values[name], _on(axis, trial.objective)))
    x = Axis(name, low=given.low, high=given.high, logarithmic=given.log)
    text = f"The candidates by {name}, from one end of its range to the other. {CLIPPED}"
    return Plot(f"slice-{place}", "Where the good candidates lie", x, axis, points, text=text, height=400)


def trade(trials: Sequence[Trial], best: Trial | None, target: float) -> Plot | None:
    """V against the largest limit cycle relative to what A3 allows; None if no candidate has both."""
    complete = [(trial.cost, trial.cycle, trial) for trial in trials if trial.cost is not None and trial.cycle]
    if not complete:
        return None
    axis = bounded("V in the objective", [target, *(cost for cost, _, _ in complete)])
    points = _kinds(
        (trial for _, _, trial in complete),
        best if best in [trial for _, _, trial in complete] else None,
        lambda trial: (_on(axis, trial.cost or 0.0), trial.cycle or 1.0),
    )
    front: list[tuple[float, float]] = []
    for cost, cycle, _ in sorted(complete, key=lambda row: row[:2]):
        if not front or cycle < front[-1][1]:
            front.append((cost, cycle))
    line = Line(
        "Pareto front", [_on(axis, V) for V, _ in front], [cycle for _, cycle in front], "accent", width=2.0, step=True
    )
    sizes = [math.log10(value) for value in (1.0, *(cycle for _, cycle, _ in complete))]
    y = Axis(
        "Largest limit cycle / what A3 allows",
        low=10.0 ** math.floor(min(sizes)),
        high=10.0 ** math.ceil(max(sizes)),
        logarithmic=True,
    )
    told = "" if best is None else f" The best: V = {number(best.cost)}, {number(best.cycle)} times what A3 allows."
    text = (
        f"V against the largest limit cycle relative to what A3 allows, of the {len(complete)} candidates that have "
        f"both. On the front, no other candidate is better in both.{told} Above 1, A3 holds where the oscillation dies "
        f"away. {CLIPPED}"
    )
    levels = Level(1.0, "A3"), Level(target, "target", upright=True)
    title = "What a lower V costs in stability"
    return Plot("trade-chart", title, axis, y, (line, *points), levels, text=text, height=520)
