"""Model Exchange controllers that are more than sampled: relays, limiters, state events, wishes of their own.

All are the C controller with its law replaced: x[0] is q_m_ref[1], x[2] q_m[1], x[4] u_m[1], x[15] u_m0[1].
"""

from __future__ import annotations

import functools
from fractions import Fraction
from pathlib import Path
from xml.etree.ElementTree import SubElement

import fmpy
import numpy as np
import pytest
from closed_loops import T_S, quiet, simulate_all
from edited_sources import model_exchange, with_functions
from exporters.description_edits import edited
from pid_fmus import in_child

import build_fmus
from orchestrator.cosim.archive import open_archive
from orchestrator.cosim.controller import Setup, Steady
from orchestrator.cosim.probe import ERROR, LATE, SAMPLES, response
from orchestrator.cosim.trajectory import Status
from orchestrator.execution import isolation
from orchestrator.execution.job import Failed, Finished, Job

pytestmark = pytest.mark.skipif(build_fmus.find_compiler() is None, reason="no C compiler")
each_version = pytest.mark.parametrize("version", [2, 3])

STEADY = Steady((1.0, 2.0), (0.0, 0.0), (0.0, 0.0))
BETWEEN = 9.5
"""When the relay switches back by itself [samples]: in the middle of one."""

LAW = "bool component_event(Component *component) { double *x = component->memory->model; double t = \
component->memory->time; (void)t; %s return true; }"
NO_TIME_EVENT = {"component_next_event": "double component_next_event(const Component *component) { return 1e300; }"}
RELAY = f"x[4] = x[0] - x[2] > 0.5e-3 && t < {BETWEEN * 0.25e-3 - 1e-9} ? 1.0 : -1.0; x[5] = x[4];"
INDICATORS = f"{{ double *x = ((Component *)c)->memory->model; z[0] = x[0] - x[2] - 0.5e-3; \
z[1] = ((Component *)c)->memory->time - {BETWEEN * 0.25e-3}; return fmi%dOK; }}"


def glue(version: int, function: str, arguments: str, body: str) -> dict[str, str]:
    """The definition of a function of the glue."""
    component = "fmi2Component" if version == 2 else "fmi3Instance"
    head = f"fmi{version}Status fmi{version}{function}({component} c{arguments})"
    return {f"fmi{version}{function}": f"{head} {body}"}


@pytest.fixture(scope="module")
def pid(tmp_path_factory):
    """The unchanged controller of a version."""
    folder = tmp_path_factory.mktemp("model_exchange")
    return functools.cache(lambda version: model_exchange(version, folder / f"Law{version}.fmu"))


def relay(version: int, pid: Path, folder: Path) -> Path:
    """u_m = 1 where the position error of axis 1 is above 0.5 mrad, else -1, by events alone; -1 after BETWEEN."""
    real = f"fmi{version}{'Real' if version == 2 else 'Float64'}"
    functions = {
        "component_event": LAW % RELAY,
        **NO_TIME_EVENT,
        **glue(version, "GetEventIndicators", f", {real} z[], size_t n", INDICATORS % version),
    }
    if version == 2:
        return with_functions(pid, folder / "Relay.fmu", functions, numberOfEventIndicators="2")
    functions |= glue(3, "GetNumberOfEventIndicators", ", size_t *n", "{ *n = 2; return fmi3OK; }")

    def declare(root):
        for reference in ("4", "5"):
            SubElement(root.find("ModelStructure"), "EventIndicator", valueReference=reference)

    return edited(with_functions(pid, folder / "Draft.fmu", functions), folder / "Relay.fmu", declare)


def answer(plant, controller, task):
    return response(controller, Setup(), STEADY, T_S, LATE)


def answers(plant_file: Path, controller: Path) -> np.ndarray:
    """Torques while the measured angles fall by ERROR at sample LATE, shape (SAMPLES, 2)."""
    job = Job(open_archive(plant_file), open_archive(controller), (0,), answer, (60.0,))
    (outcome,) = isolation.run_isolated(job)
    assert isinstance(outcome, Finished), outcome
    return outcome.value


def by_fmpy(file: Path) -> list[float]:
    """u_m[1] at the end of each sample as FMPy's own Model Exchange simulation has it, for the same inputs."""
    step, folder = float(T_S), open_archive(file).folder
    jump = LATE * step
    rows = [(0.0, 1.0, 1.0), (jump, 1.0, 1.0), (jump, 1.0, 1.0 - ERROR), (SAMPLES * step, 1.0, 1.0 - ERROR)]
    signals = np.array(rows, dtype=[("time", float), ("q_m_ref[1]", float), ("q_m[1]", float)])
    result = fmpy.simulate_fmu(
        str(folder),
        fmi_type="ModelExchange",
        stop_time=SAMPLES * step,
        output_interval=step,
        input=signals,
        output=["u_m[1]"],
    )
    # Where an event gives several rows of a time, the last one is the value afterwards.
    last = {round(float(time) / step, 6): float(torque) for time, torque in result}
    middles = [k + 0.5 for k in range(SAMPLES)]
    times = sorted(last)
    return [last[max(time for time in times if time <= middle)] for middle in middles]


@each_version
def test_a_relay_switches_with_its_input_and_between_samples(version, pid, probe_plant_file, tmp_path):
    file = relay(version, pid(version), tmp_path)
    torques = answers(probe_plant_file, file)[:, 0].tolist()
    # At the end of sample 9 the torque is that after the event in its middle.
    assert torques == [-1.0] * LATE + [1.0] * 5 + [-1.0] * 3
    assert torques == in_child(by_fmpy, file)


STRICT = """static int in_events = 1;
bool component_set(Component *component, const unsigned references[], size_t n, const double values[], size_t n_values)
{
    if (!in_events) return component_refuse(component, "inputs are set in event mode only: they are discrete");
    for (size_t i = 0; i < n; i++) component->memory->model[references[i]] = values[i];
    return true;
}
void enter_mode(int events) { in_events = events; }"""


@each_version
def test_inputs_are_written_in_event_mode(version, pid, probe_plant_file, tmp_path):
    """A controller that is not sampled at all: its torque follows the inputs by event iteration."""
    functions = {
        "component_set": STRICT,
        "component_event": LAW % "for (int i = 0; i < 2; i++) x[4 + i] = x[15 + i] + 45.0 * (x[i] - x[2 + i]);",
        **NO_TIME_EVENT,
    }
    for mode, flag in (("EnterEventMode", 1), ("EnterContinuousTimeMode", 0)):
        body = f"{{ void enter_mode(int); enter_mode({flag}); return fmi{version}OK; }}"
        functions |= glue(version, mode, "", body)
    torques = answers(probe_plant_file, with_functions(pid(version), tmp_path / "Strict.fmu", functions))
    np.testing.assert_allclose(torques[:LATE], 0.0, atol=1e-15)
    np.testing.assert_allclose(torques[LATE:], 45.0 * ERROR, rtol=1e-9)


def wishing(version: int, pid: Path, target: Path, wishes: str) -> Path:
    """Counts its events in u_m; ``wishes`` are what completedIntegratorStep does."""
    boolean = f"fmi{version}Boolean"
    arguments = f", {boolean} no_set_state, {boolean} *enter_event_mode, {boolean} *terminate"
    body = f"{{ *enter_event_mode = *terminate = 0; {wishes} return fmi{version}OK; }}"
    functions = {
        "component_event": LAW % "x[4] += 1.0;",
        **NO_TIME_EVENT,
        **glue(version, "CompletedIntegratorStep", arguments, body),
    }
    needed = {2: {"completedIntegratorStepNotNeeded": "false"}, 3: {"needsCompletedIntegratorStep": "true"}}
    return with_functions(pid, target, functions, **needed[version])


@each_version
def test_an_event_wanted_after_a_step_happens(version, pid, probe_plant_file, tmp_path):
    one = answers(probe_plant_file, wishing(version, pid(version), tmp_path / "One.fmu", ""))
    two = answers(probe_plant_file, wishing(version, pid(version), tmp_path / "Two.fmu", "*enter_event_mode = 1;"))
    assert np.diff(one[:, 0]).tolist() == [1.0] * (SAMPLES - 1), "one event a sample"
    assert np.diff(two[:, 0]).tolist() == [2.0] * (SAMPLES - 1), "and one after each step"


@each_version
def test_a_controller_may_end_the_simulation_after_a_step(version, pid, probe_plant_file, tmp_path):
    wish = "if (((Component *)c)->memory->time > 1e-3 + 1e-9) *terminate = 1;"
    controller = wishing(version, pid(version), tmp_path / "Ending.fmu", wish)
    (trajectory,) = simulate_all(probe_plant_file, controller, [quiet(Fraction(1, 100), {})])
    ending = trajectory.ending
    assert (ending.status, ending.time) == (Status.ERROR, 0.001)
    assert "Ending.fmu ended the simulation" in ending.message
    job = Job(open_archive(probe_plant_file), open_archive(controller), (0,), answer, (60.0,))
    (outcome,) = isolation.run_isolated(job)
    assert isinstance(outcome, Failed) and "Ending.fmu ended the simulation" in str(outcome.error)
