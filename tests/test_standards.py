"""The same PID through every kind of FMI and from every exporter: the same torques, the same scorecard.

What is expected does not come from another FMU: the law is replayed on the angles that each simulation's own
controller saw, and must give the torques it commanded.
"""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from closed_loops import case, simulate_all
from exporters import RECIPES, REFUSED, Recipe, Timing
from exporters.casadi_pid import held
from pid_fmus import Signals, law

import build_fmus
from orchestrator import commands, evaluate, simulate
from orchestrator.cosim.archive import open_archive
from orchestrator.cosim.controller import Setup, controller_binding
from orchestrator.cosim.signals import quantize
from orchestrator.cosim.trajectory import Status
from orchestrator.errors import InputError

DEFAULT = "DiagonalPID_C"
"""Plain C, FMI 2.0 co-simulation: what the others are held against."""

OWN = {
    name: Recipe(name, lambda path: build_fmus.build(path.stem, path.parent), needs_compiler=name != "DiagonalPID")
    for name in ("DiagonalPID", *build_fmus.VARIANTS)
}
EVERYONE = {**OWN, **RECIPES}

SOLVER_ERROR = 5e-4
"""How far CVode's torques may be from the exact ones [N.m]: a tenth of what the drive rounds away."""


def scenario():
    """Half a second with everything on: noise, quantization, delay, chirp, force."""
    paper = case(7, "compliant", "disturbance").scenario
    return replace(
        paper,
        duration=Fraction(1, 2),
        chirp=replace(paper.chirp, start=0.05, stop=0.5),
        pulse=replace(paper.pulse, start=0.1, stop=0.2),
    )


def errors(trajectory, single=False):
    """What the controller saw of each sample: q_m_ref and q_m [rad], shape (samples, 2) each."""
    quantum = scenario().sensor.quantum
    q_m = np.array([[quantize(angle, quantum) for angle in row] for row in trajectory.measured[:-1]])
    q_m_ref = np.broadcast_to(np.array(trajectory.q_m_ref), q_m.shape)
    if single:
        return q_m_ref.astype(np.float32).astype(float), q_m.astype(np.float32).astype(float)
    return q_m_ref, q_m


def replayed(recipe, trajectory):
    """The torques of the law for what the controller saw, by the convention of its timing [N.m]."""
    single = recipe.name.startswith("float32")
    q_m_ref, q_m = errors(trajectory, single)
    u_m0 = tuple(float(np.float32(u)) for u in trajectory.u_m0) if single else trajectory.u_m0
    if recipe.timing is Timing.CONTINUOUS:
        return np.array(held((q_m_ref - q_m).tolist(), u_m0))
    if recipe.timing is Timing.TWICE_FIRST:
        q_m_ref, q_m = (np.vstack([signal[:1], signal]) for signal in (q_m_ref, q_m))
    return np.array(law(Signals(q_m_ref, q_m, u_m0)))[-len(trajectory.command) :]


@pytest.fixture(scope="module")
def loop(plant_file, exporter_folder):
    """The trajectory of a recipe's FMU, simulated once."""
    known = {}

    def run(recipe):
        if recipe.missing():
            pytest.skip(recipe.missing())
        if recipe.name not in known:
            (known[recipe.name],) = simulate_all(plant_file, recipe.build(exporter_folder), [scenario()])
        return known[recipe.name]

    return run


@pytest.fixture(scope="module")
def default(exporter_folder):
    """The file of the FMU that the others are held against."""
    recipe = Recipe(DEFAULT, lambda path: build_fmus.build(DEFAULT, path.parent), needs_compiler=True)
    if recipe.missing():
        pytest.skip(recipe.missing())
    return recipe


# ---- Torques ----


@pytest.mark.parametrize("recipe", EVERYONE.values(), ids=EVERYONE)
def test_torques_are_the_laws(recipe, loop):
    trajectory = loop(recipe)
    assert trajectory.ending.status is Status.DONE and len(trajectory.command) == 2000
    expected = replayed(recipe, trajectory)
    assert np.ptp(expected, axis=0).min() > 0.5, "the loop should be in motion"
    if recipe.timing is Timing.CONTINUOUS:
        np.testing.assert_allclose(trajectory.command, expected, rtol=0, atol=SOLVER_ERROR)
    elif recipe.tolerance:
        atol = recipe.tolerance * np.abs(expected).max()
        np.testing.assert_allclose(trajectory.command, expected, rtol=0, atol=atol)
    else:
        np.testing.assert_array_equal(trajectory.command, expected)


SAME = [
    recipe
    for recipe in EVERYONE.values()
    if not recipe.tolerance and recipe.timing in (Timing.STEP_START, Timing.INITIALIZATION)
]


@pytest.mark.parametrize("recipe", SAME, ids=lambda recipe: recipe.name)
def test_trajectories_are_equal_to_the_last_bit(recipe, loop, default):
    """Also of the exporter that samples during initialization: there reference and measurement are equal."""
    expected, found = loop(default), loop(recipe)
    for name in ("q_m", "X", "measured", "command", "torque"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_conversions_only_round(loop, default):
    """deg, mN.m and single precision stay on the trajectory until a quantizer decides otherwise."""
    reference = loop(default)
    for name in ("degrees_and_millinewton", "float32_arrays"):
        found = loop(RECIPES[name])
        assert np.abs(found.X - reference.X).max() < 1e-5


# ---- Scorecards, through the command ----


def scored(file, folder, *only):
    """cases.csv and the judgement in results.json."""
    arguments = [
        str(file),
        "--no-report",
        "--timeout",
        "600",
        "--output-dir",
        str(folder),
        *(word for pattern in only for word in ("--only", pattern)),
    ]
    assert commands.guarded(evaluate.main, arguments) == commands.EXIT_OK
    results = json.loads((folder / "results.json").read_text())
    kept = ("criteria", "stability", "cost", "cases", "loop_delay", "sample_time")
    return (folder / "cases.csv").read_text(), {key: results[key] for key in kept}


QUICK = ("c07.compliant.noise",)
FULL = ("c07.compliant.noise", "c07.compliant.disturbance", "c07.slippery.gain_1")


@pytest.fixture(scope="module")
def reference_scores(default, exporter_folder, tmp_path_factory):
    file = default.build(exporter_folder)
    return {only: scored(file, tmp_path_factory.mktemp("reference"), *only) for only in (QUICK, FULL)}


@pytest.mark.parametrize("name", ["DiagonalPID", *build_fmus.VARIANTS, "container_fmi3"])
def test_scorecards_are_equal(name, reference_scores, exporter_folder, tmp_path):
    recipe = EVERYONE[name]
    if recipe.missing():
        pytest.skip(recipe.missing())
    table, judged = scored(recipe.build(exporter_folder), tmp_path, *FULL)
    expected_table, expected = reference_scores[FULL]
    assert table == expected_table
    assert judged == expected
    assert judged["criteria"]["B7"]["value"] > 0 and judged["stability"]["A1"]["axes"]


CONVENTIONS = {
    Timing.STEP_START: "at the start of each step",
    Timing.INITIALIZATION: "once during initialization, then at the end",
    Timing.TWICE_FIRST: "twice in the first step",
    Timing.CONTINUOUS: "at the start of each step",
}
"""Words for a controller's timing in the results; a continuous one answers within the step as well."""


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_every_exporter_is_scored(recipe, reference_scores, exporter_folder, tmp_path):
    if recipe.missing():
        pytest.skip(recipe.missing())
    _, judged = scored(recipe.build(exporter_folder), tmp_path, *QUICK)
    _, expected = reference_scores[QUICK]
    assert CONVENTIONS[recipe.timing] in judged["loop_delay"]["convention"]
    assert judged["loop_delay"]["samples"] == 1.0 and judged["sample_time"]["as_in_benchmark"]
    if recipe in SAME and recipe.timing is Timing.STEP_START:
        assert judged == expected
    else:
        found = [judged["criteria"][name]["value"] for name in ("B1", "B2")]
        assert found == pytest.approx([expected["criteria"][name]["value"] for name in ("B1", "B2")], rel=0.2)


def test_continuous_controller_through_simulate(exporter_folder, tmp_path):
    recipe = RECIPES["casadi"]
    if recipe.missing():
        pytest.skip(recipe.missing())
    arguments = [str(recipe.build(exporter_folder)), "--duration", "0.25", "--output-dir", str(tmp_path)]
    assert commands.guarded(simulate.main, arguments) == commands.EXIT_OK
    header, *rows = (tmp_path / "trajectory.csv").read_text().splitlines()
    assert "u_m[1]" in header and len(rows) == 1001


# ---- What must be refused ----

TOLD = {
    "refused_integer": "q_m[1] is declared as Integer",
    "refused_two_candidates": "more than one candidate for q_m",
    "refused_missing_output": "has no output u_m[1], u_m[2]",
    "refused_missing_second_output": "has no output u_m[1], u_m[2]",
    "refused_wrong_unit": "the unit 'm', which is no rad",
    "refused_three_axes": "has 3 elements, but q_m needs 2",
    "refused_arrays_of_three": "has 3 elements, but q_m needs 2",
}


@pytest.mark.parametrize("recipe", REFUSED.values(), ids=REFUSED)
def test_refused_controllers(recipe, exporter_folder):
    if recipe.missing():
        pytest.skip(recipe.missing())
    with pytest.raises(InputError) as caught:
        controller_binding(open_archive(recipe.build(exporter_folder)), Setup())
    assert TOLD[recipe.name] in str(caught.value)
