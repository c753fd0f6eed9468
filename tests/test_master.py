"""The closed loop of real FMUs, and what the master makes of FMUs that go wrong."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from bug_reports.specimens import Specimen
from hostile.fmus import NONE, Fault, hostile_fmu
from support.closed_loops import PAPER, T_S, case, quiet, simulate_all
from support.refusals import refusal

from orchestrator import Benchmark, Controller
from orchestrator.errors import FmuError
from orchestrator.loop.scenario import Drive, Noise, Sensor
from orchestrator.loop.trajectory import Status

CORNERS = (0, 2, 15, 17)


def samples(trajectory):
    """All signals of a trajectory, to be compared to the last bit."""
    return [trajectory.q_m, trajectory.X, trajectory.measured, trajectory.command, trajectory.torque]


def test_with_all_imperfections_off_the_arm_stays_at_rest(plant_file, quick_pid_file):
    """Every system of the protocol and random ones, in the corners and in between: less than 1 nm in 2 s."""
    scenarios = [
        quiet("2", dict(case(index, name, "noise", seed=3).scenario.parameters), drive=Drive(delay=(T_S, T_S)))
        for index in (*CORNERS, 7)
        for name in (*PAPER.systems, "random_1", "random_2")
    ]
    trajectories = simulate_all(plant_file, quick_pid_file, scenarios)
    assert {trajectory.ending.status for trajectory in trajectories} == {Status.DONE}
    assert max(trajectory.tcp_error.max() for trajectory in trajectories) < 1e-9


def test_python_and_c_controller_give_identical_trajectories(plant_file, pid_file, pid_c_file):
    """With noise, disturbances, quantization, delay and gain: to the last bit, in Python and in C."""
    tests = (("random_1", "disturbance"), ("slippery", "gain_2"), ("sticky", "delay_1"))
    scenarios = [replace(case(5, *test, seed=1).scenario, duration=Fraction(11)) for test in tests]
    for one, other in zip(*(simulate_all(plant_file, file, scenarios) for file in (pid_file, pid_c_file)), strict=True):
        assert one.tcp_error.max() > 1e-4
        for first, second in zip(samples(one), samples(other), strict=True):
            np.testing.assert_array_equal(first, second)


def test_observed_outputs_are_recorded(plant_file, pid_file):
    scenario = replace(case(5, "random_1", "noise").scenario, duration=Fraction(1))
    (trajectory,) = simulate_all(plant_file, pid_file, [scenario], ("q_a[2]", "q_m[1]"))
    assert list(trajectory.extra) == ["q_a[2]", "q_m[1]"]
    np.testing.assert_array_equal(trajectory.extra["q_m[1]"], trajectory.q_m[:, 0])
    assert trajectory.extra["q_a[2]"][0] == dict(scenario.parameters)["q_a_start[2]"]


@pytest.mark.parametrize(
    ("plant", "parameters", "observe", "what", "value", "near"),
    [
        ({"k_hihg[1]": 1.0}, {}, (), "no-parameter", "k_hihg[1]", "k_high[1]"),
        ({"u_m[1]": 1.0}, {}, (), "not-settable", "u_m[1]", "m[1]"),
        ({}, {"K_pp[1]": 1.0}, (), "no-parameter", "K_pp[1]", "K_p[1]"),
        ({}, {}, ("q_b[1]",), "no-output", "q_b[1]", "q_a[1]"),
    ],
)
def test_unknown_names_come_back_from_the_worker_with_the_nearest(
    plant_file, pid_file, plant, parameters, observe, what, value, near
):
    error = refusal(simulate_all, plant_file, pid_file, [quiet("0.01", plant)], observe, parameters)
    assert (error.what, error.value) == (what, value) and near in error.nearest


def test_a_parameter_the_plant_refuses_is_reported_in_the_plants_words(plant_file, pid_file):
    with pytest.raises(FmuError, match=r"psi\[2\] = 0 rad is outside its physical range") as caught:
        simulate_all(plant_file, pid_file, [quiet("0.01", {"psi[2]": 0.0})])
    assert "FlexibleManipulator.fmu" in str(caught.value)
    assert "xitInitializationMode" in caught.value.call


def consistent(trajectory, steps):
    """Whether all signals end after ``steps`` samples."""
    return [len(trajectory.time), *map(len, samples(trajectory))] == [steps + 1] * 4 + [steps] * 2


def test_a_diverging_loop_is_unstable_at_the_time_it_left(plant_file, pid_file):
    """A loop gain of the wrong sign drives the arm away; the tool was where the abort distance is, not beyond."""
    scenario = quiet("5", sensor=Sensor(noise=Noise(1e-4, (1,))), drive=Drive(gain=(-1.0, 1.0)), abort_distance=0.5)
    (trajectory,) = simulate_all(plant_file, pid_file, [scenario])
    ending = trajectory.ending
    assert ending.status is Status.UNSTABLE
    assert "more than 0.5 m from where it began" in ending.message
    error = trajectory.tcp_error
    assert error[-1] > 0.5 >= error[:-1].max()
    assert ending.time == trajectory.time[-1] < 5.0
    assert consistent(trajectory, round(ending.time * 4000))


def test_leaving_is_noticed_at_the_very_sample(probe_plant_file, feedthrough_file):
    scenario = quiet("0.01", {"far_from": 0.003}, abort_distance=1.0)
    (trajectory,) = simulate_all(probe_plant_file, feedthrough_file, [scenario])
    assert (trajectory.ending.status, trajectory.ending.time) == (Status.UNSTABLE, 0.003)


def test_a_torque_that_is_not_a_number_is_an_error_at_its_sample(plant_file, feedthrough_file):
    scenario = quiet("0.01")
    (trajectory,) = simulate_all(plant_file, feedthrough_file, [scenario], parameters={"nan_from": 0.004})
    assert (trajectory.ending.status, trajectory.ending.time) == (Status.ERROR, 0.004)
    assert "feedthrough.fmu asked for a torque that is not a number" in trajectory.ending.message
    assert consistent(trajectory, 16)
    assert np.all(np.isfinite(trajectory.torque))


@pytest.mark.parametrize(("K", "jump"), [(1e15, 1.0), (-1e200, 1.0), (1e308, 100.0)])
def test_an_absurd_torque_is_an_error(probe_plant_file, feedthrough_file, K, jump):
    """The last one is infinite."""
    scenario = quiet("0.01", {"jump_at[1]": 0.002, "jump[1]": jump, "rest[2]": 0.0})
    (trajectory,) = simulate_all(probe_plant_file, feedthrough_file, [scenario], parameters={"K": K})
    assert trajectory.ending.status is Status.ERROR
    assert "a torque that is not a number or beyond 1e+12 N.m" in trajectory.ending.message


@pytest.mark.parametrize("change", [{"broken": 1.0}, {"broken": 2.0}, {"far_from": 0.002, "jump[1]": 1e40}])
def test_a_plant_that_fails_is_not_the_controllers_fault(change, probe_plant_file, feedthrough_file):
    """Neither when its outputs are not numbers, nor when they are and no limited torque can have caused them."""
    scenario = quiet("0.01", {"jump_at[1]": 0.002, **change}, drive=Drive(limit=(35.0, 20.0)), abort_distance=1.0)
    (trajectory,) = simulate_all(probe_plant_file, feedthrough_file, [scenario], parameters={"K": 1.0})
    assert trajectory.ending.status is Status.ERROR
    assert trajectory.ending.message.startswith("probe_plant.fmu gave ")
    assert "feedthrough" not in trajectory.ending.message


@pytest.mark.parametrize(
    ("parameters", "plant", "words"),
    [
        ({"fail_from": 0.005}, {}, ("feedthrough.fmu: fmi2DoStep returned error", "out of ink at t = 0.005 s")),
        ({}, {"fail_from": 0.005}, ("probe_plant.fmu: fmi2DoStep returned error", "a gear broke at t = 0.005 s")),
    ],
)
def test_a_step_that_fails_is_reported_in_its_own_words(parameters, plant, words, probe_plant_file, feedthrough_file):
    files, scenarios = (probe_plant_file, feedthrough_file), [quiet("0.01", plant)]
    (trajectory,) = simulate_all(*files, scenarios, parameters=parameters)
    assert (trajectory.ending.status, trajectory.ending.time) == (Status.ERROR, 0.005)
    assert all(said in trajectory.ending.message for said in words)
    assert consistent(trajectory, 20)


def test_a_controller_that_does_not_want_to_end_costs_a_warning(probe_plant_file, tmp_path):
    files = [hostile_fmu(tmp_path, fault) for fault in (NONE, UNWILLING)]
    (calm,), (unwilling,) = (simulate_all(probe_plant_file, file, [quiet("0.01", {})]) for file in files)
    ending = unwilling.ending
    assert (ending.status, ending.time, ending.failed_call) == (Status.DONE, 0.01, "")
    assert ending.warnings == calm.ending.warnings + 1
    assert "after its end:" in ending.message and "terminate failed" in ending.message
    for one, two in zip(samples(calm), samples(unwilling), strict=True):
        np.testing.assert_array_equal(one, two)


UNWILLING = Fault("status:3", "terminate", 0.0)


@pytest.mark.slow
def test_a_simulation_of_a_million_samples_needs_no_more_stack(probe_plant_file, feedthrough_file):
    """Compiled code that takes stack in each sample ends a process after some hundred thousand."""
    (found,) = simulate_all(probe_plant_file, feedthrough_file, [quiet("250", {})])
    assert found.ending.status is Status.DONE and found.time.size == 1_000_001


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_torque_that_is_not_written_is_not_that_of_the_sample_before(version, tmp_path):
    """An FMU that reports success, and writes nothing, had an answer of before, or zeros."""
    file = Specimen("values not written", version=version).write(tmp_path / "silent.fmu")
    found = Benchmark("quick").simulate(Controller(file), "c00.compliant.noise")
    assert (found.result.status, found.result.time) == (Status.ERROR, pytest.approx(0.02, abs=6e-4))
    assert "not a number" in found.result.message
