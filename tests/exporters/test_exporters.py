"""Every exporter's two-axis PID against the law: the same torques, and the timing its recipe states."""

from __future__ import annotations

import random
from ctypes import c_double
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi3 import FMU3Model
from fmpy.validation import validate_fmu
from pid_fmus import T_S, Signals, in_child, instance_arguments, law

from . import RECIPES, REFUSED, Recipe, Timing
from .casadi_pid import held
from .drive import Errors, Pair, torques

U_M0 = (1.75, -0.25)
DISCRETE = [recipe for recipe in RECIPES.values() if recipe.timing is not Timing.CONTINUOUS]


@pytest.fixture(scope="session")
def folder(exporter_folder: Path) -> Path:
    return exporter_folder


def random_errors(samples: int = 50) -> Errors:
    """Errors within 1 rad that are whole numbers of 2^-20 rad: single precision holds them without rounding."""
    generator = random.Random(1)

    def error() -> float:
        return generator.randrange(-(2**20), 2**20) * 2.0**-20

    return Errors((error(), error()), tuple((error(), error()) for _ in range(samples)))


def expected(timing: Timing, errors: Errors) -> np.ndarray:
    """Torques [N.m] after initialization and after each step, shape (1 + steps, 2), by the law."""
    extra = {
        Timing.STEP_START: [],
        Timing.INITIALIZATION: [errors.initial],
        Timing.TWICE_FIRST: [errors.samples[0]],
    }[timing]
    sampled = np.array([*extra, *errors.samples])
    after = law(Signals(sampled, np.zeros_like(sampled), U_M0))
    initial = after[0] if timing is Timing.INITIALIZATION else U_M0
    return np.array([initial, *after[len(extra) :]])


def skip_if_missing(recipe: Recipe) -> None:
    reason = recipe.missing()
    if reason:
        pytest.skip(reason)


@pytest.mark.parametrize("recipe", DISCRETE, ids=lambda recipe: recipe.name)
def test_torques_and_timing(recipe, folder):
    skip_if_missing(recipe)
    errors = random_errors()
    measured = np.array(torques(recipe, folder, errors, U_M0))
    differences = {
        timing: np.abs(measured - expected(timing, errors))[1:].max()
        for timing in Timing
        if timing is not Timing.CONTINUOUS
    }
    assert min(differences, key=differences.__getitem__) is recipe.timing
    wanted = expected(recipe.timing, errors)
    np.testing.assert_allclose(measured, wanted, rtol=0.0, atol=recipe.tolerance * np.abs(wanted).max())


@pytest.mark.parametrize("recipe", REFUSED.values(), ids=lambda recipe: recipe.name)
def test_controllers_to_refuse_are_sound_fmus(recipe, folder):
    skip_if_missing(recipe)
    assert recipe.refused
    assert read_model_description(str(recipe.build(folder))).coSimulation is not None


@pytest.mark.parametrize("name", ["float32_arrays", "timing_initialization", "degrees_and_millinewton"])
def test_strict_validation_finds_nothing(name, folder):
    skip_if_missing(RECIPES[name])
    assert validate_fmu(str(RECIPES[name].build(folder))) == []


# ---- The continuous controller ----


def _integrate(path: Path, errors: Errors, u_m0: Pair) -> list[list[float]]:
    """Return u_m at the end of each step, by the classical Runge-Kutta method with four steps in each."""
    variables = {v.name: v.valueReference for v in read_model_description(str(path)).modelVariables}
    references = {name: [variables[f"{name}[{axis}]"] for axis in (1, 2)] for name in ("q_m_ref", "u_m", "u_m0")}
    model = FMU3Model(**instance_arguments(path))
    model.instantiate()
    model.enterInitializationMode(startTime=0.0)
    model.setFloat64(references["u_m0"], u_m0)
    model.exitInitializationMode()
    model.updateDiscreteStates()
    model.enterContinuousTimeMode()
    n = model.getNumberOfContinuousStates()
    buffer = (c_double * n)()

    def derivatives(state: np.ndarray) -> np.ndarray:
        model.setContinuousStates((c_double * n)(*state), n)
        model.getContinuousStateDerivatives(buffer, n)
        return np.array(buffer)

    state, h, seen = np.zeros(n), T_S / 4, []
    for error in errors.samples:
        model.setFloat64(references["q_m_ref"], error)
        for _ in range(4):
            k_1 = derivatives(state)
            k_2 = derivatives(state + h / 2 * k_1)
            k_3 = derivatives(state + h / 2 * k_2)
            k_4 = derivatives(state + h * k_3)
            state = state + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4)
        derivatives(state)
        seen.append(model.getFloat64(references["u_m"]))
    model.freeInstance()
    return seen


def test_continuous_controller(folder):
    recipe = RECIPES["casadi"]
    skip_if_missing(recipe)
    errors = random_errors()
    measured = in_child(_integrate, recipe.build(folder), errors, U_M0)
    np.testing.assert_allclose(measured, held(errors.samples, U_M0), rtol=1e-8, atol=1e-8)
