"""Model Exchange controllers that are more than sampled: relays, limiters, state events, wishes of their own.

All are the C controller with its law replaced: x[0] is q_m_ref[1], x[2] q_m[1], x[4] u_m[1], x[15] u_m0[1].
"""

import shutil
from fractions import Fraction
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import fmpy
import numpy as np
import pytest
from support.closed_loops import T_S, probed, quiet, simulate_all
from support.edited_fmus import with_functions
from support.pid_fmus import in_child
from support.stub_fmus import axes

import build_fmus
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.behaviour import ERROR, LATE, SAMPLES
from orchestrator.loop.trajectory import Status

pytestmark = pytest.mark.needs("compiler")

FALLING = axes(rest=(1, 2), jump_at=(LATE * T_S,) * 2, jump=(-ERROR,) * 2)
"""A plant at rest whose motor angles fall by ERROR at sample LATE."""
BETWEEN = 9.5
"""When the relay switches back by itself [samples]: in the middle of one."""

RELAY = f"x[4] = x[0] - x[2] > 0.5e-3 && t < {BETWEEN * 0.25e-3 - 1e-9} ? 1.0 : -1.0; x[5] = x[4];"
INDICATORS = f"{{ double *x = ((Component *)c)->memory->model; z[0] = x[0] - x[2] - 0.5e-3; \
z[1] = ((Component *)c)->memory->time - {BETWEEN * 0.25e-3}; return fmi%dOK; }}"


def event(body: str) -> dict[str, str]:
    """Functions for a law that is computed in events and has no time events of its own."""
    variables = "double *x = component->memory->model, t = component->memory->time; (void)t;"
    return {
        "component_event": f"bool component_event(Component *component) {{ {variables} {body} return true; }}",
        "component_next_event": "double component_next_event(const Component *component) { return 1e300; }",
    }


def glue(version: int, function: str, arguments: str, body: str) -> dict[str, str]:
    """The definition of a function of the glue."""
    component = "fmi2Component" if version == 2 else "fmi3Instance"
    head = f"fmi{version}Status fmi{version}{function}({component} c{arguments})"
    return {f"fmi{version}{function}": f"{head} {body}"}


@pytest.fixture(scope="module", params=[2, 3])
def version(request):
    """The version of FMI."""
    return request.param


@pytest.fixture(scope="module")
def pid(version, tmp_path_factory):
    """The unchanged controller, with scalar variables."""
    sources, dialect = build_fmus.HERE / "controller_fmu" / "pid_c", build_fmus.Dialect(version, "ModelExchange")
    target = tmp_path_factory.mktemp("model_exchange") / f"Law{version}.fmu"
    return build_fmus.c_fmu(sorted(sources.glob("*.[ch]")), sources / "modelDescription.xml", target, dialect)


def relay(version: int, pid: Path, target: Path, indicators: str = INDICATORS) -> Path:
    """u_m = 1 where the position error of axis 1 is above 0.5 mrad, else -1, by events alone; -1 after BETWEEN."""
    real = f"fmi{version}{'Real' if version == 2 else 'Float64'}"
    functions = event(RELAY) | glue(version, "GetEventIndicators", f", {real} z[], size_t n", indicators % version)
    if version == 3:
        functions |= glue(3, "GetNumberOfEventIndicators", ", size_t *n", "{ *n = 2; return fmi3OK; }")

    def declare(root: Element) -> None:
        if version == 2:
            root.set("numberOfEventIndicators", "2")
        for reference in ("4", "5") if version == 3 else ():
            SubElement(root.find("ModelStructure"), "EventIndicator", valueReference=reference)

    return with_functions(pid, target, functions, declare)


def answers(plant_file: Path, controller: Path) -> np.ndarray:
    """Torques while the measured angles fall by ERROR at sample LATE, shape (SAMPLES, 2)."""
    (trajectory,) = simulate_all(plant_file, controller, [quiet(SAMPLES * T_S, FALLING)])
    return trajectory.command


def by_fmpy(file: Path, folder: Path) -> list[float]:
    """u_m[1] at the end of each sample as FMPy's own Model Exchange simulation has it, for the same inputs; the FMU is
    extracted to ``folder``."""
    step, archive = float(T_S), open_archive(file)
    shutil.copytree(archive.folder, folder)
    # FMPy looks for it there, also if it was compiled here.
    shutil.copytree(
        archive.library_file.parent, folder / "binaries" / archive.library_file.parent.name, dirs_exist_ok=True
    )
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
    return [float(result["u_m[1]"][result["time"] <= (k + 0.5) * step][-1]) for k in range(SAMPLES)]


def test_a_relay_switches_with_its_input_and_between_samples(version, pid, probe_plant_file, tmp_path):
    file = relay(version, pid, tmp_path / "Relay.fmu")
    torques = answers(probe_plant_file, file)[:, 0].tolist()
    # At the end of sample 9 the torque is that after the event in its middle.
    assert torques == [-1.0] * LATE + [1.0] * 5 + [-1.0] * 3
    assert torques == in_child(by_fmpy, file, tmp_path / "relay")


STRICT = """static int in_events = 1;
bool component_set(Component *component, const unsigned references[], size_t n, const double values[], size_t n_values)
{
    if (!in_events) return component_refuse(component, "inputs are set in event mode only: they are discrete");
    for (size_t i = 0; i < n; i++) component->memory->model[references[i]] = values[i];
    return true;
}
void enter_mode(int events) { in_events = events; }"""


def test_inputs_are_written_in_event_mode(version, pid, probe_plant_file, tmp_path):
    """A controller that is not sampled at all: its torque follows the inputs by event iteration."""
    law = "for (int i = 0; i < 2; i++) x[4 + i] = x[15 + i] + 45.0 * (x[i] - x[2 + i]);"
    functions = {"component_set": STRICT, **event(law)}
    for mode, flag in (("EnterEventMode", 1), ("EnterContinuousTimeMode", 0)):
        body = f"{{ void enter_mode(int); enter_mode({flag}); return fmi{version}OK; }}"
        functions |= glue(version, mode, "", body)
    torques = answers(probe_plant_file, with_functions(pid, tmp_path / "Strict.fmu", functions))
    np.testing.assert_allclose(torques[:LATE], 0.0, atol=1e-15)
    np.testing.assert_allclose(torques[LATE:], 45.0 * ERROR, rtol=1e-9)


def wishing(version: int, pid: Path, target: Path, wishes: str) -> Path:
    """Counts its events in u_m; ``wishes`` are what completedIntegratorStep does."""
    boolean = f"fmi{version}Boolean"
    arguments = f", {boolean} no_set_state, {boolean} *enter_event_mode, {boolean} *terminate"
    body = f"{{ *enter_event_mode = *terminate = 0; {wishes} return fmi{version}OK; }}"
    functions = event("x[4] += 1.0;") | glue(version, "CompletedIntegratorStep", arguments, body)
    needed = {2: {"completedIntegratorStepNotNeeded": "false"}, 3: {"needsCompletedIntegratorStep": "true"}}[version]
    return with_functions(pid, target, functions, lambda root: root.find("ModelExchange").attrib.update(needed))


def test_an_event_wanted_after_a_step_happens(version, pid, probe_plant_file, tmp_path):
    one = answers(probe_plant_file, wishing(version, pid, tmp_path / "One.fmu", ""))
    two = answers(probe_plant_file, wishing(version, pid, tmp_path / "Two.fmu", "*enter_event_mode = 1;"))
    assert np.diff(one[:, 0]).tolist() == [1.0] * (SAMPLES - 1), "one event a sample"
    assert np.diff(two[:, 0]).tolist() == [2.0] * (SAMPLES - 1), "and one after each step"


def test_a_controller_may_end_the_simulation_after_a_step(version, pid, probe_plant_file, tmp_path):
    wish = "if (((Component *)c)->memory->time > 1e-3 + 1e-9) *terminate = 1;"
    controller = wishing(version, pid, tmp_path / "Ending.fmu", wish)
    (trajectory,) = simulate_all(probe_plant_file, controller, [quiet(Fraction(1, 100), {})])
    ending = trajectory.ending
    assert (ending.status, ending.time) == (Status.ERROR, 0.001)
    assert "Ending.fmu ended the simulation" in ending.message
    assert probed(probe_plant_file, controller, quiet(T_S, {})).latency is None, "nor can it be probed"


def test_a_next_event_that_is_always_now_is_an_error_and_no_hang(version, pid, probe_plant_file, tmp_path):
    now = "double component_next_event(const Component *component) { return component->memory->time; }"
    file = with_functions(pid, tmp_path / "Stalling.fmu", {"component_next_event": now})
    (trajectory,) = simulate_all(probe_plant_file, file, [quiet(Fraction(1, 100), {})])
    assert trajectory.ending.status is Status.ERROR
    assert "Stalling.fmu asks for event iterations without end" in trajectory.ending.message


BETWEEN_CALLS = "static int calls, is_broken; void look(void) { if (is_broken) abort(); }"
"""After the status fatal no function may be called any more: these end the process then."""


def solved(version: int, pid: Path, target: Path, failure: str = "") -> Path:
    """u_m[1] is a continuous state, which has the position error for its derivative; ``failure`` is what becomes of
    that in the 30th call."""
    component, real = ("fmi2Component", "fmi2Real") if version == 2 else ("fmi3Instance", "fmi3Float64")
    derivatives = "GetDerivatives" if version == 2 else "GetContinuousStateDerivatives"
    own = "void look(void); look(); Component *component = c; double *x = component->memory->model; (void)x;"
    failing = f"if (++calls == 30) {{ {failure} }}"
    bodies = {
        "GetContinuousStates": f"{{ {own} values[0] = x[4]; return fmi{version}OK; }}",
        "SetContinuousStates": f"{{ {own} x[4] = values[0]; return fmi{version}OK; }}",
        "GetNominalsOfContinuousStates": f"{{ {own} values[0] = 1.0; return fmi{version}OK; }}",
        derivatives: f"{{ {own} {failing} values[0] = 1e3 * (x[0] - x[2] + x[4]); return fmi{version}OK; }}",
    }
    functions = event("")
    for name, body in bodies.items():
        constant = "const " if name.startswith("Set") else ""
        functions |= glue(version, name, f", {constant}{real} values[], size_t n", body)
    head = f"{BETWEEN_CALLS}\nfmi{version}Status fmi{version}GetContinuousStates({component}"
    first = f"fmi{version}GetContinuousStates"
    functions[first] = functions[first].replace(f"fmi{version}Status {first}({component}", head, 1)
    if version == 3:
        functions |= glue(3, "GetNumberOfContinuousStates", ", size_t *n", "{ *n = 1; return fmi3OK; }")

    def declare(root: Element) -> None:
        variables, structure = root.find("ModelVariables"), root.find("ModelStructure")
        if version == 3:
            SubElement(variables, "Float64", name="der_s", valueReference="990", derivative="4")
            SubElement(structure, "ContinuousStateDerivative", valueReference="990")
            return
        scalar = SubElement(variables, "ScalarVariable", name="der_s", valueReference="990")
        SubElement(scalar, "Real", derivative="5")
        SubElement(SubElement(structure, "Derivatives"), "Unknown", index=str(len(variables)))

    return with_functions(pid, target, functions, declare)


def test_a_solver_tries_a_smaller_step_after_discard(version, pid, probe_plant_file, tmp_path):
    healthy = answers(probe_plant_file, solved(version, pid, tmp_path / "Healthy.fmu"))
    refused = f"values[0] = 1e6; return fmi{version}Discard;"
    once = answers(probe_plant_file, solved(version, pid, tmp_path / "Once.fmu", refused))
    assert healthy[-1, 0] > 1e-6
    np.testing.assert_allclose(once, healthy, atol=1e-7)  # of the solver, whose tolerance is 1e-8


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        ("return fmi%dError;", "failed with status 3"),
        ("is_broken = 1; return fmi%dFatal;", "failed with status 4"),
        ("return fmi%dOK;", "gave no number"),
    ],
)
def test_derivatives_that_are_not_given_end_the_simulation(failure, words, version, pid, probe_plant_file, tmp_path):
    file = solved(version, pid, tmp_path / "Failing.fmu", failure.replace("%d", str(version)))
    (trajectory,) = simulate_all(probe_plant_file, file, [quiet(SAMPLES * T_S, FALLING)])
    assert trajectory.ending.status is Status.ERROR
    assert words in trajectory.ending.message


def test_an_event_indicator_that_is_no_number_ends_the_simulation(version, pid, probe_plant_file, tmp_path):
    undefined = INDICATORS.replace("return", "if (z[1] > 0.0) z[0] = 0.0 / 0.0; return")
    file = relay(version, pid, tmp_path / "Undefined.fmu", undefined)
    (trajectory,) = simulate_all(probe_plant_file, file, [quiet(SAMPLES * T_S, FALLING)])
    assert trajectory.ending.status is Status.ERROR and "getEventIndicators gave no number" in trajectory.ending.message
