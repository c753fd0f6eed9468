"""The same PID through every kind of FMI and from every exporter: the same torques, and so the same scorecard.

What is expected does not come from another FMU: the law is replayed on the angles that each simulation's own
controller saw, and must give the torques it commanded.
"""

from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from exporters import RECIPES, REFUSED, Recipe, built
from exporters.casadi_pid import held
from fmpy.validation import validate_fmu
from numpy.testing import assert_allclose, assert_array_equal
from support.closed_loops import T_S, case, probed, quiet, simulate_all
from support.pid_fmus import Signals, law
from support.refusals import refusal

import build_fmus
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.behaviour import Convention
from orchestrator.loop.setup import Setup, controller_binding
from orchestrator.loop.signals import quantize
from orchestrator.loop.trajectory import Status

DEFAULT = "DiagonalPID"
"""Python, FMI 2.0 co-simulation: what the others are held against."""

OWN = {
    name: Recipe(name, lambda path: build_fmus.build(path.stem, path.parent), needs)
    for needs, names in (((), (DEFAULT,)), (("compiler",), ("DiagonalPID_C", *build_fmus.VARIANTS)))
    for name in names
}
EVERYONE = {**OWN, **RECIPES}

SOLVER_ERROR = 5e-4
"""How far CVode's torques may be from the exact ones [N.m]: a tenth of what the drive rounds away."""

PAPER_CASE = case(7, "compliant", "disturbance").scenario
SCENARIO = replace(
    PAPER_CASE,
    duration=Fraction(1, 2),
    chirp=replace(PAPER_CASE.chirp, start=0.05, stop=0.5),
    pulse=replace(PAPER_CASE.pulse, start=0.1, stop=0.2),
)
"""Half a second with everything on: noise, quantization, delay, chirp, force."""


@pytest.fixture(scope="module")
def build(exporter_folder):
    """The FMU of a recipe by name."""
    return lambda name: built({**EVERYONE, **REFUSED}[name], exporter_folder)


def replayed(recipe, trajectory):
    """The torques of the law for what the controller saw of each sample [N.m], shape (samples, 2)."""
    q_m = np.vectorize(partial(quantize, quantum=SCENARIO.sensor.quantum))(trajectory.measured[:-1])
    q_m_ref, u_m0 = np.tile(trajectory.q_m_ref, (len(q_m), 1)), trajectory.u_m0
    if recipe.name.startswith("float32"):
        q_m, q_m_ref, u_m0 = (np.float32(values).astype(float) for values in (q_m, q_m_ref, u_m0))
    if recipe.name == "casadi":
        return held(q_m_ref - q_m, u_m0)
    if recipe.convention is Convention.TWICE:
        q_m_ref, q_m = (np.vstack([signal[:1], signal]) for signal in (q_m_ref, q_m))
    return np.array(law(Signals(q_m_ref, q_m, tuple(u_m0))))[-len(trajectory.command) :]


@pytest.fixture(scope="module")
def default(plant_file, build):
    """The trajectory that the others are held against."""
    return simulate_all(plant_file, build(DEFAULT), [SCENARIO])[0]


@pytest.mark.parametrize("recipe", EVERYONE.values(), ids=EVERYONE)
def test_torques_are_the_laws_and_trajectories_the_same(recipe, plant_file, build, default):
    """Also of the exporter that samples during initialization: there reference and measurement are equal."""
    file = build(recipe.name)
    (found,) = simulate_all(plant_file, file, [SCENARIO])
    assert found.ending.status is Status.DONE and len(found.command) == 2000
    expected = replayed(recipe, found)
    assert np.ptp(expected, axis=0).min() > 0.5, "the loop should be in motion"
    scale = recipe.tolerance * np.abs(expected).max()
    assert_allclose(found.command, expected, rtol=0, atol=SOLVER_ERROR if recipe.name == "casadi" else scale)
    if recipe.tolerance:  # deg, mN.m and single precision stay on the trajectory until a quantizer decides otherwise
        assert validate_fmu(str(file)) == []
        assert np.abs(found.X - default.X).max() < 1e-5
    elif recipe.name != "casadi" and recipe.convention is not Convention.TWICE:
        for name in ("q_m", "X", "measured", "command", "torque"):
            assert_array_equal(getattr(found, name), getattr(default, name))
    timing = probed(plant_file, file, quiet(T_S))
    assert (timing.latency, timing.convention) == (0, recipe.convention.value)


WHY = {
    "refused_integer": ("connector-type", "q_m[1]"),
    "refused_two_candidates": ("connector-ambiguous", "q_m[1]"),
    "refused_missing_output": ("connector-missing", "u_m"),
    "refused_missing_second_output": ("connector-missing", "u_m"),
    "refused_wrong_unit": ("wrong-unit", "m"),
    "refused_three_axes": ("connector-size", "q_m[1], q_m[2], q_m[3]"),
    "refused_arrays_of_three": ("connector-size", "q_m"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_controllers(name, build):
    error = refusal(controller_binding, open_archive(build(name)), Setup())
    assert (error.what, error.value) == WHY[name]
