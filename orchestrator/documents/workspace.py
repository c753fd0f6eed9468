"""The workspace as a map: V_k and b_i over the configurations, with the arm in the pose that is pointed at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..benchmark.results import ConfigurationScore, Rules
from ..views.plot import Axis, Heat, Layer, PosedArm
from ..views.table import Beside, Part
from .case_plots import degrees
from .head import PlantRecord

HEAT, ARM = "heat", "arm"
"""Ids of the map and of the arm beside it."""


def links(plant: PlantRecord) -> tuple[float, float]:
    """Lengths of the arm's links [m]."""
    return plant.nominal["l[1]"], plant.nominal["l[2]"]


def parts(plant: PlantRecord, rules: Rules, scores: Mapping[str, Sequence[ConfigurationScore]]) -> tuple[Part, ...]:
    """The map of the ``scores`` by whose they are, or of differences between those of several, and the arm."""
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
        tuple(None if place is None else _words(place) for place in grid),
        "over the link angles, q_a1 to the right, q_a2 upwards. Dots: the TCP of every configuration.",
        "is better" if len(scores) > 1 else "",
    )
    poses = tuple(None if place is None else (place.q_a1, place.q_a2) for place in grid)
    return (Beside(((heat,), (PosedArm(ARM, links(plant), HEAT, poses),)), equal=True),)


def _words(place: ConfigurationScore) -> str:
    return f"configuration {place.index}: q_a1 {degrees(place.q_a1)}, q_a2 {degrees(place.q_a2)}"


def _layers(
    rules: Rules, of: str, scores: Sequence[ConfigurationScore], grid: Sequence[ConfigurationScore | None]
) -> list[Layer]:
    """V_k and each b_i of one controller over the places of the ``grid``."""
    by_index = {score.index: score for score in scores}
    placed = [None if place is None else by_index.get(place.index) for place in grid]
    costs = tuple(None if score is None else score.cost for score in placed)
    layers = [Layer("V_k, the cost of a configuration", costs, "V_k", of, rules.cost.target)]
    for number, (name, spec) in enumerate(rules.criteria.items(), start=1):
        values = tuple(None if score is None else score.relative.get(name) for score in placed)
        layers.append(Layer(f"b{number}: {spec.title}, worst value / target", values, f"b{number}", of, 1.0))
    return layers
