"""What a check finds in good and bad controllers."""

import json
import re

import pytest
from exporters import RECIPES, REFUSED, built
from hostile.fmus import Fault, hostile_fmu
from support.edited_fmus import of_another_guid, with_functions
from support.python_controllers import python_controller

from orchestrator import Benchmark, Controller
from orchestrator.cli import checks
from orchestrator.cli.guard import guarded, remedy
from orchestrator.fmi import log

LEVELS = ("ok", "note", "warning", "error")


def check(file, worst, benchmark=None, **use):
    """The findings on a controller by subject, the worst of which is ``worst``, but for what a busy machine adds: on
    one a step took longer than the sample time."""
    found = (benchmark or Benchmark("quick")).check(Controller(file, **use))
    lasting = [finding for finding in found if finding.subject != "cost" or "beyond" in finding.text]
    assert max((finding.severity.value for finding in lasting), key=LEVELS.index) == worst, found
    for finding in found:
        assert finding.remedy or finding.severity.value in ("ok", "note") or finding.what
    return {finding.subject: finding for finding in reversed(found)}  # the first one of a subject


def test_the_default_controller(pid_c_file):
    found = check(pid_c_file, "note")
    texts = {subject: finding.text for subject, finding in found.items()}
    assert texts["standard"] == "FMI 2.0 co-simulation, exported by controller_fmu.export"
    assert "linux64" in texts["platforms"] and texts["description"] == "valid"
    assert texts["q_m"] == "q_m[1] [rad] = 0, q_m[2] [rad] = 0 (exact)"
    assert texts["u_m"] == "u_m[1] [N.m], u_m[2] [N.m] (exact)"
    assert found["q_a_ref"].severity == "note" and "optional" in texts["q_a_ref"]
    assert texts["T_s"] == "T_s [s] = 0.00025; set to the sample time"
    assert texts["sample time"] == "0.25 ms (DefaultExperiment)"
    assert texts["latency"] == "0 samples from a measurement to the torque"
    assert texts["timing"] == "samples at the start of each step"
    assert texts["initial output"] == "u_m0 at rest"
    assert re.fullmatch(r"([\d.]+ µs median, [\d.]+ µs 99 %, [\d.]+ µs largest|below .* clock) per step", texts["cost"])
    subjects = ("determinism", "reset", "instances", "termination")
    assert {found[subject].severity for subject in subjects} == {"ok"}


@pytest.mark.parametrize(
    ("name", "subject", "words"),
    [
        ("pythonfmu3_arrays", "q_m", "q_m[2] [?] = 0, 0 (exact)"),
        ("names_nested", "q_m", "Controller.q_m[1] [rad] = 0, Controller.q_m[2] [rad] = 0 (by spelling)"),
        ("degrees_and_millinewton", "u_m", "[mN.m]"),
        ("casadi", "description", "is not a legal variable name"),
    ],
)
def test_exporters_have_but_notes(name, subject, words, exporter_folder):
    found = check(built(RECIPES[name], exporter_folder), "note")
    assert words in found[subject].text and found["latency"].severity == "ok"
    assert name != "casadi" or found["standard"].text == "FMI 3.0 Model Exchange, exported by CasADi"


def test_how_the_controller_is_used_is_among_the_findings(exporter_folder):
    swapped = {f"{name}[{i}]": f"{name}_{3 - i}" for name in ("q_m", "q_m_ref", "u_m", "u_m0") for i in (1, 2)}
    file = built(RECIPES["names_underscore"], exporter_folder)
    found = check(file, "note", parameters={"K_p_1": 40.0}, mapping=swapped, sample_time="0.00025")
    assert found["q_m"].text == "q_m_2 [rad] = 0, q_m_1 [rad] = 0 (mapped)"
    assert found["parameters"].text == "K_p_1 = 40"
    assert found["sample time"].text == "0.25 ms (given)"


UNIT_DELAY = (
    "late = self.own['u_m0[1]'], self.own['u_m0[2]']; late = getattr(self, 'late', late); self.law(); "
    "self.late = self.own['u_m[1]'], self.own['u_m[2]']; self.own['u_m[1]'], self.own['u_m[2]'] = late"
)
START_UP = "self.seen = getattr(self, 'seen', 0) + 1; self.own['K'] = 45.0 + 5.0 / self.seen; self.law()"
SLOW = "1 ms (DefaultExperiment), not the benchmark's 0.25 ms; every result will be marked"
DICE = "self.law(); self.own['u_m[1]'] += random.random() / 1e6"
OUTSIDE = "o.append(1); self.law(); self.own['u_m[1]'] += len(o) / 1e9"
OFF = "N.m at rest, more than a step of the torque's quantization"


@pytest.mark.parametrize(
    ("severity", "subject", "words", "body", "imports"),
    [
        ("warning", "sample time", SLOW, "slow", ""),
        ("warning", "latency", "1 samples from a measurement to the torque", UNIT_DELAY, ""),
        ("warning", "initial output", f"u_m0 +1, +0 {OFF}", "self.law(); self.own['u_m[1]'] += 1.0", ""),
        ("ok", "initial output", "u_m0 +0.001, +0 N.m at rest", "self.law(); self.own['u_m[1]'] += 1e-3", ""),
        ("note", "timing", "is unknown: the response to a step depends on when it begins", START_UP, ""),
        # Whatever this machine takes for a sleep of 0.3 ms, it is more than the sample time.
        pytest.param(
            *("warning", "cost", "beyond the time limit of 30 s", "time.sleep(0.3e-3); self.law()", "import time"),
            marks=pytest.mark.slow,
        ),
        ("error", "latency", "does not respond", "self.own['u_m[1]'] = self.own['u_m0[1]']", ""),
        ("warning", "determinism", "other numbers each time", DICE, "import random"),
        ("warning", "determinism", "passes from one simulation to the next", OUTSIDE, "o = []"),
        ("error", "timing", "gains.txt", "open('gains.txt')", ""),
    ],
    ids=[
        *("slow", "unit delay", "offset", "offset below a torque step", "start-up phase", "expensive", "frozen"),
        *("dice", "state outside the instance", "file of the user's folder"),
    ],
)
def test_peculiarities_and_errors(severity, subject, words, body, imports, tmp_path, monkeypatch):
    """Each is found and said with figures, and the check goes on; only what costs performance is a warning, and
    simulations run in an empty folder, so nothing beside the user is found."""
    (tmp_path / "gains.txt").write_text("45")
    monkeypatch.chdir(tmp_path)
    step, body = (1e-3, "self.law()") if body == "slow" else (0.25e-3, body)
    file = python_controller(tmp_path, "Odd", 45.0, step, imports, step_body=body + "; return True")
    found = check(file, "note" if severity == "ok" else severity, Benchmark("quick", timeout=30.0))
    assert found[subject].severity == severity and words in found[subject].text
    if imports == "o = []":
        assert found["instances"].severity == "note"


REFUSED_RESET = {"fmi2Reset": 'fmi2Status fmi2Reset(fmi2Component c) { return refuse(c, "no way back"); }'}
CRASHING_RESET = {"fmi2Reset": "#include <stdlib.h>\nfmi2Status fmi2Reset(fmi2Component c) { abort(); }"}
ONLY_ONE = {
    "component_new": """static Component only;
Component *component_new(const char *name)
{
    if (only.name) return NULL;
    only.name = strdup(name);
    only.memory = malloc(memory_size());
    component_reset(&only);
    return &only;
}""",
    "component_free": "void component_free(Component *component) { component->name = NULL; }",
    "fmi2Instantiate": """fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
    fmi2String resources, const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    return component_new(name);
}""",
}


@pytest.mark.parametrize(
    ("functions", "subject", "words"),
    [
        (REFUSED_RESET, "reset", "reset failed"),
        (CRASHING_RESET, "reset", "SIGABRT"),
        (ONLY_ONE, "several instances", "instantiation failed"),
    ],
    ids=["refused reset", "crashing reset", "only one instance"],
)
def test_what_the_benchmark_does_not_need_is_a_warning(functions, subject, words, pid_c_file, tmp_path):
    found = check(with_functions(pid_c_file, tmp_path / "Limited.fmu", functions), "warning")
    assert words in found[subject].text and "The benchmark does without" in found[subject].remedy
    assert [name for name, finding in found.items() if finding.severity == "warning"] == [subject]


def test_a_controller_that_does_not_want_to_end_is_a_warning(tmp_path):
    termination = check(hostile_fmu(tmp_path, Fault("status:3", "terminate", 0.0)), "warning")
    assert termination["termination"].severity == "warning" and "terminate failed" in termination["termination"].text


def test_an_fmu_that_refuses_to_start_is_one_error(pid_c_file, tmp_path):
    found = Benchmark("quick").check(Controller(of_another_guid(pid_c_file, tmp_path / "guid.fmu")))
    assert [finding.subject for finding in found if "GUID" in finding.text] == ["timing"], "once is enough"


@pytest.mark.parametrize("name", ["refused_two_candidates", "refused_missing_output"])
def test_connectors_that_do_not_fit_are_errors_with_a_remedy(name, exporter_folder):
    found = check(built(REFUSED[name], exporter_folder), "error")
    assert found["standard"].severity == "ok", "what was found before still stands"
    assert found["import"].what.startswith("connector-") and "--map" in remedy(found["import"])


def test_a_missing_file_is_an_error(tmp_path):
    found = check(tmp_path / "absent.fmu", "error")
    assert list(found) == ["import"] and found["import"].what == "no-file"


def test_findings_as_json(capsys, quick_pid_file):
    assert (
        guarded(checks.check, [str(quick_pid_file), "--json", "--map", "q_m[1]=absent", "--map", "q_m[2]=q_m[2]"]) == 2
    )
    document = json.loads(capsys.readouterr().out)
    assert (document["controller"], document["verdict"]) == (quick_pid_file.name, "error")
    assert (document["findings"][-1]["what"], document["findings"][-1]["value"]) == ("no-variable", "absent")


def test_the_table_shows_names_as_they_are_and_steers_no_terminal(tmp_path, capsys):
    body = "print('\\x1b[2Jprinted\\x07', flush=True); os._exit(3)"
    target = tmp_path / "[red]B[green]:smile:.fmu"
    file = python_controller(tmp_path, "Painter", imports="import os", step_body=body, target=target)
    assert guarded(checks.check, [str(file)]) == 2
    captured = capsys.readouterr()
    assert captured.out.splitlines()[0] == f"{file.name}  verdict: error" and "printed" in captured.out
    assert "exit code 3" in captured.out
    assert not any(character in captured.out + captured.err for character in "\x1b\x07")
    assert not (tmp_path / "runs").exists(), "a check writes nothing"


def test_what_an_fmu_logs_does_not_steer_the_terminal():
    written = log.Log()
    written.keep(b"first\x07\nsecond \xff", b"pid\x1b[2J")
    (line,) = written.lines()
    assert line == "pid\ufffd[2J: first\ufffd; second \ufffd"
