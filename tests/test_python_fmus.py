"""What the FMUs in Python refuse, by the same rules as those in C, as far as pythonfmu lets them: it has no states."""

import math

import pytest
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from support.pid_fmus import T_S, built, in_child, slave

PLANT = "FlexibleManipulator"
NAMES = (PLANT, "DiagonalPID", "TunedPID", "ManipulatorLQG", "DitheredLQG")
BAD_STEPS = (math.nan, math.inf, -T_S)
TOO_LONG = 13.0


def _refusals(path, inputs, outputs, steps):
    """Messages of a step after each input was set to what is not finite, and of steps of these lengths; the outputs
    after these and before."""
    found, seen = [], []
    with slave(path) as one:
        one.fmu.setupExperiment(startTime=0.0)
        one.fmu.enterInitializationMode()
        one.fmu.exitInitializationMode()
        one.fmu.doStep(0.0, T_S)
        before = one.get(outputs)
        for name, value, step in [
            *((name, value, T_S) for name, value in inputs),
            *(("", 0.0, step) for step in steps),
        ]:
            one.log.clear()
            if name:
                one.set([name], [value])
            try:
                one.fmu.doStep(T_S, step)
            except FMICallException:
                found.append("\n".join(one.log))
            else:
                found.append("accepted")
            if name:
                one.set([name], [0.0])
            seen.append(one.get(outputs) == before)
        one.fmu.doStep(T_S, T_S)
    return found, seen


@pytest.mark.parametrize("name", NAMES)
def test_values_and_steps_are_refused_with_a_reason(name, fmu_folder):
    path = built(name, fmu_folder)
    variables = read_model_description(str(path)).modelVariables
    inputs = [(v.name, math.nan if i % 2 else math.inf) for i, v in enumerate(variables) if v.causality == "input"]
    outputs = [v.name for v in variables if v.causality == "output"]
    steps = (*BAD_STEPS, TOO_LONG)
    messages, unchanged = in_child(_refusals, path, inputs, outputs, steps)
    assert all(unchanged)
    for (input_name, value), message in zip(inputs, messages, strict=False):
        assert "refused" in message and "finite" in message
        assert f"{value:g}" in message and (input_name if name == PLANT else input_name.partition("[")[0]) in message
    for step, message in zip(steps, messages[len(inputs) :], strict=True):
        assert f"step of {step!r} s at t = {T_S!r} s refused" in message


def _parameters(path, systems):
    """What each system of parameters is refused with."""
    found = []
    for parameters in systems:
        with slave(path) as one:
            one.fmu.setupExperiment(startTime=0.0)
            one.set(list(parameters), list(parameters.values()))
            one.fmu.enterInitializationMode()
            try:
                one.fmu.exitInitializationMode()
            except FMICallException:
                found.append("\n".join(one.log))
            else:
                found.append("accepted")
    return found


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        (PLANT, {"alpha[1]": 1e6}, "alpha[1] = 1e+06 s/rad"),
        (PLANT, {"j_m[2]": 1e-9}, "j_m[2] = 1e-09 kg.m2"),
        ("DiagonalPID", {"K_p[1]": math.nan}, "K_p[1] = nan"),
        ("TunedPID", {"u_m0[2]": math.inf}, "u_m0[2] = inf"),
        ("ManipulatorLQG", {"u_m0[2]": math.nan}, "u_m0[2] = nan"),
        ("DitheredLQG", {"q_m_ref[1]": math.inf}, "q_m_ref[1] = inf"),
    ],
)
def test_parameters_are_refused_with_a_reason(name, parameters, words, fmu_folder):
    (message,) = in_child(_parameters, built(name, fmu_folder), [parameters])
    assert words in message
