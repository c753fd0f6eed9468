"""The commands from end to end: the files they write, equal to the last bit however they are run, and their help."""

from __future__ import annotations

import csv
import io
import json
import math

import pytest
from command_lines import run

import build_fmus
from orchestrator import __version__
from orchestrator.benchmark import protocol as protocols

ONE = ("--only", "c00.compliant.noise")
CONTROLLER = "DiagonalPID_C"


@pytest.fixture(scope="module")
def quick(pid_c_file, tmp_path_factory):
    """One quick evaluation in its default folder: what the command said, and where it wrote."""
    folder = tmp_path_factory.mktemp("quick")
    finished = run("evaluate", pid_c_file, "--quick", "--jobs", "2", "--no-report", folder=folder)
    assert finished.code == 0, finished.err
    return finished, folder / "runs" / f"{CONTROLLER}-quick"


@pytest.fixture(scope="module")
def results(quick):
    return json.loads((quick[1] / "results.json").read_text())


# ---- evaluate: results ----


def test_results_have_all_that_was_promised(results, pid_c_file):
    assert set(results) >= {
        *("schema", "benchmark", "protocol", "complete", "cost", "criteria", "stability", "cases", "controller"),
        *("plant", "seed", "loop_delay", "environment", "timing"),
    }
    assert results["protocol"] == "quick" and results["complete"] is True and results["seed"] == 0
    assert list(results["criteria"]) == [f"B{i}" for i in range(1, 8)]
    for criterion in results["criteria"].values():
        assert set(criterion) >= {"value", "target", "weight", "unit", "worst_case"}
    weighed = sum(c["weight"] * c["value"] / c["target"] for c in results["criteria"].values())
    assert results["cost"] == pytest.approx(weighed)
    assert list(results["stability"]) == ["A1", "A2", "A3"]
    for requirement in results["stability"].values():
        assert set(requirement) >= {"passed", "axes", "worst_case"}
    for fmu in (results["controller"], results["plant"]):
        assert set(fmu) >= {"file", "sha256", "fmi_version", "generation_tool"}
    assert results["controller"]["file"] == pid_c_file.name
    assert results["environment"]["flexible_manipulator_benchmark"] == __version__
    assert results["loop_delay"]["seconds"] == 0.00025 and results["loop_delay"]["samples"] == 1.0
    assert results["timing"]["workers"] == 2 and results["timing"]["wall_time"] > 0


def test_cases_stand_in_results_and_table_alike(results, quick):
    rows = list(csv.DictReader(io.StringIO((quick[1] / "cases.csv").read_text())))
    assert len(results["cases"]) == len(rows) == 24
    for case, row in zip(results["cases"], rows, strict=True):
        assert set(case) >= {"id", "status", "configuration", "system", "test", "measurements"}
        assert (case["id"], case["status"]) == (row["id"], row["status"]) and case["status"] in ("done", "unstable")
        for name, value in case["measurements"].items():
            column = next(key for key in row if key.split(" ")[0] == name)
            assert row[column] == str(value)
    assert {case["status"] for case in results["cases"] if case["test"] in ("noise", "disturbance")} == {"done"}
    assert "B5 [m]" in rows[0] and "B6 [s]" in rows[0] and "B1 [N.m]" in rows[0]


def test_the_scorecard_is_printed_for_people(quick):
    out, err = quick[0].out, quick[0].err
    for words in ("B1", "B7", "V ", "A1", "A2", "A3", "c0", "loop delay 0.250 ms", "141.0", "protocol quick"):
        assert words in out
    assert "not comparable" in out.lower()
    assert "\x1b" not in out
    assert "results.json, cases.csv" in err
    assert max(len(line) for line in out.splitlines()) <= 80


@pytest.mark.slow
def test_bit_identical_for_any_number_of_processes_and_from_run_to_run(quick, results, pid_c_file, tmp_path):
    expected = (quick[1] / "cases.csv").read_bytes()
    changing = ("timing", "environment")
    for number, jobs in enumerate((1, 2)):
        options = ("--quick", "--jobs", jobs, "--force", "--no-report", "--output-dir", tmp_path)
        finished = run("evaluate", pid_c_file, *options, folder=tmp_path)
        assert finished.code == 0 and "earlier run" not in finished.err
        assert (tmp_path / "cases.csv").read_bytes() == expected, number
        again = json.loads((tmp_path / "results.json").read_text())
        assert {k: v for k, v in again.items() if k not in changing} == {
            k: v for k, v in results.items() if k not in changing
        }


def test_a_finished_run_is_not_run_again(quick, pid_c_file):
    folder = quick[1]
    before = (folder / "cases.csv").read_bytes()
    finished = run("evaluate", pid_c_file, "--quick", "--no-report", folder=folder.parent.parent)
    assert finished.code == 0 and "24 of 24 cases are there from an earlier run (--force runs anew)" in finished.err
    assert (folder / "cases.csv").read_bytes() == before


# ---- evaluate: options ----


def only_run(folder):
    """The results of the one run below ``folder``."""
    (file,) = folder.glob("runs/*/results.json")
    return file


def test_only_part_of_the_protocol(pid_c_file, tmp_path):
    options = ("--only", "c0[01].compliant.noise", "--only", "c02.slippery.gain_1", "--no-report")
    finished = run("evaluate", pid_c_file, *options, folder=tmp_path)
    assert finished.code == 0 and "Incomplete" in finished.out
    contents = json.loads(only_run(tmp_path).read_text())
    assert [case["id"] for case in contents["cases"]] == [
        "c00.compliant.noise",
        "c01.compliant.noise",
        "c02.slippery.gain_1",
    ]
    assert contents["complete"] is False and contents["cost"] is None


def test_json_on_stdout_is_the_results_file(pid_c_file, tmp_path):
    finished = run("evaluate", pid_c_file, *ONE, "--json", "--no-report", folder=tmp_path)
    printed = json.loads(finished.out)
    written = json.loads(only_run(tmp_path).read_text())
    assert finished.code == 0 and printed == written


def noise_torque(pid_c_file, folder, *options):
    folder.mkdir()
    finished = run("evaluate", pid_c_file, "--json", "--no-report", *options, folder=folder)
    assert finished.code == 0, finished.err
    document = json.loads(finished.out)
    return document, document["criteria"]["B1"]["value"]


def test_the_seed_decides_noise_and_random_systems(pid_c_file, tmp_path):
    only = ("--only", "c00.random_1.noise")
    runs = [noise_torque(pid_c_file, tmp_path / str(i), *only, "--seed", s) for i, s in enumerate((0, 1, 1))]
    assert runs[0][0]["seed"] == 0 and runs[1][0]["seed"] == 1
    assert runs[0][1] != runs[1][1] == runs[2][1]


def test_parameters_and_plant_parameters_count(pid_c_file, tmp_path):
    (tmp_path / "gains.toml").write_text("[parameters]\nK_d = [3.0, 0.5]\nK_p = [1, 2]\n")
    reference = noise_torque(pid_c_file, tmp_path / "a", *ONE)[1]
    document, tuned = noise_torque(
        pid_c_file, tmp_path / "b", *ONE, "--parameters", tmp_path / "gains.toml", "--set", "K_p[1]=45"
    )
    assert document["controller"]["parameters"] == {"K_d[1]": 3.0, "K_d[2]": 0.5, "K_p[1]": 45.0, "K_p[2]": 2.0}
    assert tuned > 1.5 * reference
    document, _ = noise_torque(pid_c_file, tmp_path / "c", *ONE, "--plant-set", "k_high[2]=5e5")
    assert document["plant"]["parameters"] == {"k_high[2]": 5e5}


def test_another_sample_time_is_marked(tmp_path, pid_file):
    document, _ = noise_torque(pid_file, tmp_path / "slow", *ONE, "--sample-time", "0.0005")
    assert document["sample_time"] == {"seconds": 0.0005, "as_in_benchmark": False}
    folder = tmp_path / "text"
    folder.mkdir()
    finished = run("evaluate", pid_file, *ONE, "--sample-time", "0.0005", "--no-report", folder=folder)
    assert "not comparable" in " ".join(finished.out.split())


def test_the_default_controller_is_the_papers_pid(tmp_path):
    finished = run("evaluate", *ONE, "--json", "--no-report", folder=tmp_path)
    document = json.loads(finished.out)
    assert document["controller"]["file"] == "DiagonalPID.fmu"
    assert document["controller"]["generation_tool"].startswith("PythonFMU")


# ---- simulate ----


def simulated(folder, *options):
    """What the command printed, the units by column, and the columns."""
    finished = run("simulate", *options, folder=folder)
    assert finished.code == 0, finished.err
    (path,) = folder.rglob("trajectory.csv")
    header, *rows = csv.reader(io.StringIO(path.read_text()))
    names = [name.rpartition(" [") for name in header]
    units = {name: unit.rstrip("]") for name, _, unit in names}
    return (
        finished,
        units,
        {name: [float(row[i]) if row[i] else math.nan for row in rows] for i, (name, _, _) in enumerate(names)},
    )


def test_simulation_writes_table_and_picture(pid_c_file, tmp_path):
    finished, units, columns = simulated(tmp_path, pid_c_file, "--duration", "0.05")
    assert units["time"] == "s" and units["q_m[1]"] == "rad" and units["u_m[2]"] == "N.m" and units["x"] == "m"
    assert all(units.values()), "every column has a unit"
    assert columns["time"] == [k / 4000 for k in range(201)]
    (picture,) = tmp_path.rglob("trajectory.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "done at 0.05 s" in finished.out and "largest TCP error" in finished.out
    assert "trajectory.csv, trajectory.png" in finished.err


def test_a_case_of_an_evaluation_has_its_figures(pid_c_file, quick, tmp_path):
    """B1 and B2 of a single case are those of the evaluation."""
    finished, _, _ = simulated(tmp_path, pid_c_file, "--case", "c00.compliant.noise")
    printed = dict(line.split(" = ") for line in finished.out.splitlines() if " = " in line)
    assert set(printed) == {"B1", "B2"} and all(text.endswith((" N.m", " Nm")) for text in printed.values())


def test_everything_can_be_switched_off(pid_c_file, tmp_path):
    """Without disturbance and imperfection nothing moves; the loop may be changed piece by piece from there."""
    _, _, still = simulated(tmp_path / "a", pid_c_file, *_ideal(tmp_path / "a"))
    assert max(still["tcp_error"]) < 1e-9
    _, _, pushed = simulated(
        tmp_path / "b", pid_c_file, *_ideal(tmp_path / "b"), "--force", "500", "--t-1", "0.01", "--t-2", "0.02"
    )
    assert max(math.hypot(*force) for force in zip(pushed["F_x"], pushed["F_z"], strict=True)) == pytest.approx(500)
    assert max(pushed["tcp_error"]) > 1e-4
    _, _, limited = simulated(
        tmp_path / "c", pid_c_file, *_ideal(tmp_path / "c"), "--torque-limit", "5", "3", "--configuration", "0", "0"
    )
    assert max(abs(u) for u in limited["u_m[1]"] if not math.isnan(u)) <= 5


def test_a_test_without_disturbances_can_be_given_some(pid_c_file, tmp_path):
    """They are the protocol's fixed ones, where nothing else is said."""
    given = ("--chirp-amplitude", "1", "-1", "--t-4", "0.6", "--force", "500", "--t-1", "0.1", "--t-2", "0.2")
    _, _, columns = simulated(tmp_path, pid_c_file, "--test", "gain_1", "--duration", "0.7", *given)
    assert max(columns["u_d[1]"]) > 0.9 and min(columns["u_d[2]"]) < -0.9
    x, z = max(zip(columns["F_x"], columns["F_z"], strict=True))
    assert math.atan2(z, x) == pytest.approx(0.7)


def _ideal(folder):
    folder.mkdir()
    return ("--ideal", "--undisturbed", "--duration", "0.1")


def test_systems_configurations_and_parameters_are_chosen(pid_c_file, tmp_path):
    options = (
        "--configuration",
        "45",
        "-60",
        "--system",
        "random_3",
        "--plant-set",
        "psi[2]=1e-3",
        "--duration",
        "0.01",
    )
    finished, _, columns = simulated(tmp_path, pid_c_file, *options)
    assert "random_3 system at 45° / -60°" in finished.out
    assert columns["q_a[1]"][0] == pytest.approx(math.radians(45)) and columns["q_a[2]"][0] == pytest.approx(
        math.radians(-60)
    )


def test_runs_that_differ_do_not_share_a_default_folder(pid_c_file, tmp_path):
    changes = [(), ("--seed", "1"), ("--set", "K_p[1]=44"), ("--plant-set", "k_high[2]=5e5"), ("--sample-time", "5e-4")]
    for change in changes:
        finished = run("evaluate", pid_c_file, *ONE, *change, "--no-report", folder=tmp_path)
        assert finished.code == 0 and "replaced" not in finished.err
    names = {file.parent.name for file in tmp_path.glob("runs/*/results.json")}
    assert len(names) == len(changes) and all(name.startswith(f"{CONTROLLER}-paper-") for name in names)


def test_results_of_another_evaluation_in_the_folder_are_replaced_whole(pid_c_file, tmp_path):
    first = run("evaluate", pid_c_file, *ONE, "--output-dir", "out", folder=tmp_path)
    assert first.code == 0 and (tmp_path / "out" / "report.html").exists()
    second = run("evaluate", pid_c_file, *ONE, "--output-dir", "out", "--seed", "1", "--no-report", folder=tmp_path)
    assert "other results in out are replaced" in second.err
    assert not (tmp_path / "out" / "report.html").exists() and not (tmp_path / "out" / "trajectories.npz").exists()


def test_what_is_connected_is_told(results, quick):
    assert "connectors q_m, u_m, q_m_ref, u_m0 (without q_a_ref)" in quick[0].out
    connectors = results["controller"]["connectors"]
    assert connectors["q_m"] == {"variables": ["q_m[1]", "q_m[2]"], "found": "exact", "notes": []}
    assert connectors["e"] is None and results["controller"]["mapping"] == {}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--noise-power", "-1"), "-1 is below 0"),
        (("--torque-bits", "5000"), "no whole number from 0 to 52"),
        (("--torque-limit", "-1", "3"), "-1 is below 0"),
        (("--phi-F", "nan"), "'nan' is no finite number"),
        (("--timeout", "inf"), "'inf' is no finite number"),
        (("--memory-limit", "inf"), "'inf' is no finite number"),
        (("--set", "K_p[1]=nan"), "parameter K_p[1], nan, is no finite number"),
        (("--plant-set", "q_a_start[1]=1"), "no nominal parameter q_a_start[1]"),
        (("--plant-set", "j_m[1]=-1"), "j_m[1] = -1 kg.m2 is outside its physical range"),
    ],
)
def test_values_that_make_no_sense_are_bad_input(options, told, pid_c_file, tmp_path):
    finished = run("simulate", pid_c_file, *options, folder=tmp_path)
    assert finished.code == 2 and told in finished.err and "Traceback" not in finished.err


# ---- Help ----


@pytest.mark.parametrize("module", ["evaluate", "simulate", "check"])
def test_help_shows_examples_and_exit_codes(module, tmp_path):
    finished = run(module, "--help", folder=tmp_path, changes={"COLUMNS": "100"})
    assert finished.code == 0 and finished.err == ""
    assert f"usage: python -m orchestrator.{module}" in finished.out
    assert "examples:" in finished.out and f"  python -m orchestrator.{module} my_controller.fmu" in finished.out
    assert "exit codes:" in finished.out
    for option in ("--map", "--set", "--parameters", "--sample-time", "--sandbox"):
        assert option in finished.out


def test_build_fmus_help_and_names():
    assert set(protocols.names()) >= {"paper", "quick"}
    assert build_fmus.NAMES[0] == "FlexibleManipulator"


@pytest.mark.parametrize("module", ["evaluate", "simulate", "check"])
def test_an_unknown_option_is_bad_input(module, tmp_path):
    finished = run(module, "--nonsense", folder=tmp_path)
    assert (
        finished.code == 2 and "unrecognized arguments: --nonsense" in finished.err and "Traceback" not in finished.err
    )
