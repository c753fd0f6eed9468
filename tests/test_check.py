"""The conformance report: what it finds in good and bad controllers, its exit codes, and its JSON."""

from __future__ import annotations

import json
import os
import subprocess

import pytest
from bad_fmus import of_another_guid
from command_lines import command, environment, run
from conftest import build_or_skip
from edited_sources import with_functions
from exporters import RECIPES, REFUSED
from hostile.fmus import Fault, hostile_fmu
from python_controllers import python_controller
from test_sandbox import sandboxed

from orchestrator import check, commands
from orchestrator.cosim.slaves import log
from orchestrator.execution.job import Job


@pytest.fixture
def report(capsys):
    """Runs the check in this process: exit code and findings by subject, of each (severity, text, remedy)."""

    def run_check(file, *options):
        code = commands.guarded(check.main, [str(file), "--json", *options])
        document = json.loads(capsys.readouterr().out)
        assert document["verdict"] in ("ok", "note", "warning", "error")
        assert code == {"error": 2, "warning": 1}.get(document["verdict"], 0)
        findings: dict[str, list[tuple[str, str, str]]] = {}
        for row in document["findings"]:
            assert set(row) == {"severity", "subject", "text", "remedy"}
            assert row["remedy"] or row["severity"] in ("ok", "note") or row["subject"] == "import"
            findings.setdefault(row["subject"], []).append((row["severity"], row["text"], row["remedy"]))
        return code, findings

    return run_check


def severities(findings):
    return {severity for rows in findings.values() for severity, _, _ in rows}


# ---- Good controllers ----


def test_the_default_controller(report, pid_c_file):
    code, findings = report(pid_c_file)
    assert code == 0 and severities(findings) == {"ok", "note"}
    assert findings["standard"][0][1] == "FMI 2.0 co-simulation, exported by an unnamed tool"
    assert "linux64" in findings["platforms"][0][1]
    assert findings["description"] == [("ok", "valid", "")]
    assert findings["q_m"] == [("ok", "q_m[1] [rad] = 0, q_m[2] [rad] = 0 (exact)", "")]
    assert findings["u_m"] == [("ok", "u_m[1] [N.m], u_m[2] [N.m] (exact)", "")]
    assert findings["q_a_ref"][0][0] == "note" and "optional" in findings["q_a_ref"][0][1]
    assert findings["T_s"][0][1] == "T_s [s] = 0.00025; it is given the sample time"
    assert findings["sample time"] == [("ok", "0.25 ms (DefaultExperiment)", "")]
    assert findings["latency"][0][:2] == ("ok", "0 samples from a measurement to the torque")
    assert findings["timing"][0][1] == "samples at the start of each step"
    assert findings["initial output"] == [("ok", "u_m0 at rest", "")]
    subjects = ("determinism", "reset", "instances", "termination", "cost")
    assert {findings[subject][0][0] for subject in subjects} == {"ok"}
    assert findings["cost"][0][1].endswith(" µs a step")


@pytest.mark.parametrize(
    ("name", "subject", "words"),
    [
        ("pythonfmu3_arrays", "q_m", "q_m[2] [?] = 0, 0 (exact)"),
        ("names_nested", "q_m", "Controller.q_m[1] [rad] = 0, Controller.q_m[2] [rad] = 0 (by spelling)"),
        ("no_units", "q_m", "declares no unit; taken as rad"),
        ("position_error", "e", "e[1] [rad] = 0, e[2] [rad] = 0 (exact)"),
        ("timing_initialization", "timing", "once during initialization"),
        ("timing_twice_first", "timing", "twice in the first step"),
        ("degrees_and_millinewton", "u_m", "[mN.m]"),
        ("casadi", "description", "is not a legal variable name"),
        ("casadi", "standard", "FMI 3.0 Model Exchange, exported by CasADi"),
    ],
)
def test_exporters_have_but_notes(name, subject, words, report, exporter_folder):
    if RECIPES[name].missing():
        pytest.skip(RECIPES[name].missing())
    code, findings = report(RECIPES[name].build(exporter_folder))
    assert code == 0
    assert any(words in text for _, text, _ in findings[subject]), findings[subject]
    assert findings["latency"][0][0] == "ok"


def test_options_stand_in_the_report(report, exporter_folder):
    if RECIPES["names_underscore"].missing():
        pytest.skip(RECIPES["names_underscore"].missing())
    swapped = [f"{name}[{i}]={name}_{3 - i}" for name in ("q_m", "q_m_ref", "u_m", "u_m0") for i in (1, 2)]
    options = [word for connection in swapped for word in ("--map", connection)]
    options += ["--set", "K_p_1=40", "--sample-time", "0.00025"]
    code, findings = report(RECIPES["names_underscore"].build(exporter_folder), *options)
    assert findings["q_m"][0][1] == "q_m_2 [rad] = 0, q_m_1 [rad] = 0 (mapped)"
    assert findings["parameters"][0][1] == "K_p_1 = 40"
    assert findings["sample time"][0][1] == "0.25 ms (given)"
    assert code == 0


# ---- Controllers with warnings ----


def test_another_sample_time_is_a_warning(report, tmp_path):
    code, findings = report(python_controller(tmp_path, "Slow", 45.0, step=0.001))
    assert code == 1
    assert findings["sample time"][0][0] == "warning"
    assert "1 ms (DefaultExperiment), not the benchmark's 0.25 ms" in findings["sample time"][0][1]
    assert findings["execution tool"][0][0] == "note"


def test_a_late_or_wrong_first_output_is_a_warning(report, tmp_path):
    body = "self.law(); self.own['u_m[1]'] += 1.0; return True"
    code, findings = report(python_controller(tmp_path, "Offset", 45.0, step_body=body))
    assert code == 1
    severity, text, remedy = findings["initial output"][0]
    assert severity == "warning" and "instead of u_m0" in text and "u_m0" in remedy


def test_a_unit_delay_is_a_warning(report, tmp_path):
    body = "late = self.own['u_m0[1]'], self.own['u_m0[2]']; late = getattr(self, 'late', late); self.law(); "
    body += "self.late = self.own['u_m[1]'], self.own['u_m[2]']; "
    body += "self.own['u_m[1]'], self.own['u_m[2]'] = late; return True"
    code, findings = report(python_controller(tmp_path, "UnitDelay", 45.0, step_body=body))
    assert code == 1
    severity, text, remedy = findings["latency"][0]
    assert (severity, text) == ("warning", "1 samples from a measurement to the torque") and "unit delay" in remedy
    assert findings["initial output"][0][0] == "ok"


# ---- What the benchmark can do without ----

REFUSED_RESET = {"fmi2Reset": 'fmi2Status fmi2Reset(fmi2Component c) { return refuse(c, "no way back"); }'}
CRASHING_RESET = {"fmi2Reset": "#include <stdlib.h>\nfmi2Status fmi2Reset(fmi2Component c) { abort(); }"}
ONLY_ONE = {
    "component_new": """static int alive;
Component *component_new(const char *name)
{
    if (alive) return NULL;
    Component *component = calloc(1, sizeof(Component));
    component->name = calloc(strlen(name) + 1, 1);
    component->memory = malloc(memory_size());
    strcpy(component->name, name);
    component_reset(component);
    alive = 1;
    return component;
}""",
    "component_free": "void component_free(Component *component) { alive = 0; free(component); }",
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
def test_what_the_benchmark_does_not_need_is_a_warning(functions, subject, words, report, pid_c_file, tmp_path):
    file = with_functions(pid_c_file, tmp_path / "Limited.fmu", functions)
    code, findings = report(file)
    assert code == 1
    (severity, text, remedy) = findings[subject][0]
    assert severity == "warning" and words in text and "The benchmark goes on without" in remedy
    others = [row[0] for name, rows in findings.items() if name != subject for row in rows]
    assert set(others) <= {"ok", "note"}


def test_a_controller_that_does_not_want_to_end_is_a_warning(report, tmp_path):
    file = build_or_skip(lambda: hostile_fmu(tmp_path, Fault("status:3", "terminate", 0.0)))
    code, findings = report(file)
    assert code == 1
    severity, text, remedy = findings["termination"][0]
    assert severity == "warning" and "terminate failed" in text and "results stand" in remedy


# ---- Controllers with errors ----


def test_a_frozen_output_is_an_error(report, tmp_path):
    body = "self.own['u_m[1]'], self.own['u_m[2]'] = self.own['u_m0[1]'], self.own['u_m0[2]']; return True"
    code, findings = report(python_controller(tmp_path, "Frozen", step_body=body))
    assert code == 2
    severity, text, remedy = findings["latency"][0]
    assert severity == "error" and "does not answer" in text and "q_m" in remedy


def test_a_torque_that_is_no_number_is_an_error(report, tmp_path):
    body = "self.law(); self.own['u_m[1]'] = float('nan'); return True"
    code, findings = report(python_controller(tmp_path, "Undefined", step_body=body))
    assert code == 2
    severity, text, remedy = findings["initial output"][0]
    assert severity == "error" and text.startswith("nan, ") and "division by zero" in remedy


def test_random_torques_are_an_error(report, tmp_path):
    body = "self.law(); self.own['u_m[1]'] += random.random(); return True"
    code, findings = report(python_controller(tmp_path, "Dicing", 45.0, imports="import random", step_body=body))
    assert code == 2
    assert findings["determinism"][0][0] == "error" and "Seed random numbers" in findings["determinism"][0][2]


def test_state_outside_the_instance_is_a_note(report, tmp_path):
    """Every step of any instance counts for all of them: two at once disturb each other, two in turn differ."""
    body = "counted.append(1); self.law(); self.own['u_m[1]'] += len(counted); return True"
    code, findings = report(python_controller(tmp_path, "Shared", 45.0, imports="counted = []", step_body=body))
    assert code == 2
    assert findings["determinism"][0][0] == "error" and findings["instances"][0][0] == "note"


def test_a_crash_is_an_error_and_the_report_goes_on(report, tmp_path):
    body = "os._exit(3)"
    code, findings = report(python_controller(tmp_path, "Quitter", imports="import os", step_body=body))
    assert code == 2
    (severity, text, remedy) = findings["timing"][0]
    assert severity == "error" and "exit code 3" in text and "debugger" in remedy
    assert {"timing", "repeatability", "several instances", "cost"} <= set(findings)


def test_an_fmu_that_refuses_to_start_is_an_error(report, pid_c_file, tmp_path):
    code, findings = report(of_another_guid(pid_c_file, tmp_path / "guid.fmu"))
    assert code == 2 and any("GUID" in text for _, text, _ in findings["timing"])
    told = [text for rows in findings.values() for _, text, _ in rows if "GUID" in text]
    assert len(told) == 1, "once is enough"


@pytest.mark.parametrize("recipe", REFUSED.values(), ids=REFUSED)
def test_connectors_that_do_not_fit_are_errors(recipe, report, exporter_folder):
    if recipe.missing():
        pytest.skip(recipe.missing())
    code, findings = report(recipe.build(exporter_folder))
    assert code == 2 and findings["import"][0][0] == "error"
    assert findings["standard"][0][0] == "ok", "what was found before still stands"


def test_a_missing_file_is_an_error(report, tmp_path):
    code, findings = report(tmp_path / "absent.fmu")
    assert code == 2 and list(findings) == ["import"] and "There is no file" in findings["import"][0][1]


def test_without_a_path_the_default_controller_is_named(capsys):
    assert commands.guarded(check.main, ["--json", "--map", "q_m[1]=absent"]) == 2
    assert json.loads(capsys.readouterr().out)["controller"] == "DiagonalPID.fmu"
    assert commands.guarded(check.main, ["--json", "--mapping", "absent.toml"]) == 2
    assert json.loads(capsys.readouterr().out)["controller"] == "DiagonalPID.fmu"


# ---- As a command ----


def test_conditions_are_those_asked_for(report, pid_c_file, monkeypatch):
    jobs: list[Job] = []
    monkeypatch.setattr(check, "run_isolated", lambda job: jobs.append(job) or ())
    report(pid_c_file)
    report(pid_c_file, "--sandbox", "--timeout", "7", "--memory-limit", "100")
    assert [(job.sandbox, set(job.time_limits), job.limits.memory) for job in jobs] == [
        (False, {60.0}, 2048 * 10**6),
        (True, {7.0}, 100 * 10**6),
    ]


@sandboxed
def test_a_check_in_the_sandbox(pid_c_file, tmp_path):
    finished = run("check", pid_c_file, "--sandbox", folder=tmp_path)
    assert finished.code == 0, finished
    assert any(line.startswith("ok ") and "latency" in line for line in finished.out.splitlines())


@pytest.mark.parametrize("option", [("--seed", "1"), ("--plant-set", "psi[1]=1e-3"), ("--protocol", "quick")])
def test_options_that_would_do_nothing_are_not_offered(option, capsys):
    with pytest.raises(SystemExit):
        check.main(list(option))
    assert "unrecognized arguments" in capsys.readouterr().err


def test_the_table_in_a_terminal_of_its_own(pid_c_file, tmp_path):
    finished = run("check", pid_c_file, folder=tmp_path)
    assert finished.code == 0 and finished.err == ""
    lines = finished.out.splitlines()
    assert lines[0].strip() == pid_c_file.name
    assert any(line.startswith("ok ") and "latency" in line for line in lines)
    assert "\x1b" not in finished.out
    assert not list(tmp_path.iterdir()), "a check writes nothing"


def test_names_are_no_markup(pid_c_file, tmp_path):
    file = tmp_path / "[red]B[green]:smile:.fmu"
    file.write_bytes(pid_c_file.read_bytes())
    finished = run("check", file, folder=tmp_path)
    assert finished.code == 0 and finished.out.splitlines()[0].strip() == file.name


def test_what_an_fmu_prints_does_not_steer_the_terminal(tmp_path):
    body = "print('\\x1b[2Jprinted\\x07', flush=True); os._exit(3)"
    finished = run(
        "check", python_controller(tmp_path, "Painter", imports="import os", step_body=body), folder=tmp_path
    )
    assert finished.code == 2 and "printed" in finished.out
    assert "\x1b" not in finished.out + finished.err and "\x07" not in finished.out + finished.err


def test_what_an_fmu_logs_does_not_steer_the_terminal():
    log.clear()
    log.note(b"pid\x1b[2J", 3, b"first\x07\nsecond \xff")
    (line,) = log.lines()
    log.clear()
    assert line == "pid\ufffd[2J: first\ufffd; second \ufffd"


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_a_reader_that_has_gone_is_no_traceback(options, pid_c_file, tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    finished = subprocess.run(
        command("check", pid_c_file, *options),
        cwd=tmp_path,
        env=environment(),
        stdout=writer,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(writer)
    assert (finished.returncode, finished.stderr) == (1, b"")


def test_exit_code_2_of_the_command(tmp_path):
    finished = run("check", "absent.fmu", folder=tmp_path)
    assert finished.code == 2 and "There is no file absent.fmu" in finished.out and "Traceback" not in finished.err
