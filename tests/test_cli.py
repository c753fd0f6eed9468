"""The commands: exit codes, what is printed where, and that wrong input is one clear line."""

import argparse
import csv
import json
import math
import re
import shlex
import shutil
import sys
from argparse import ArgumentTypeError
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hostile.commands import finished
from msgspec.structs import replace
from support.command_lines import Finished, call
from support.edited_fmus import with_broken_sources, without
from support.python_controllers import python_controller
from support.reports import ABOUT, head_of, results_of, searched
from support.tools import PRESENT, require

import orchestrator
from controller_fmu import starters
from orchestrator import Benchmark, Controller
from orchestrator.benchmark.results import CaseResult
from orchestrator.cli import guard, simulate, values, verify
from orchestrator.cli.main import COMMANDS, main
from orchestrator.cli.options import benchmark
from orchestrator.cli.study import folder_name
from orchestrator.codec import from_json
from orchestrator.documents import worst_page
from orchestrator.documents.commands import (
    MORE_TRIALS,
    ROBUST,
    compare_command,
    range_words,
    recording_command,
    simulate_command,
    study_command,
    tune_command,
)
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.head import SampleTimeRecord
from orchestrator.documents.results import Results
from orchestrator.search.findings import Found, Margin
from orchestrator.study.dry_run import DryRun

ONE = ("--only", "c00.compliant.noise", "--no-report")
EVALUATE = (sys.executable, "-m", "orchestrator.evaluate")


@pytest.fixture(scope="module")
def folder(quick_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished quick evaluation that commands may add to."""
    return Path(shutil.copytree(quick_folder, tmp_path_factory.mktemp("cli") / "quick"))


def test_the_scorecard_is_printed_for_people_and_nothing_is_run_again(pid_file: Path, folder: Path) -> None:
    again = ("evaluate", pid_file, "--quick", "--no-report", "--output-dir", folder)
    finished = call(*again, folder=folder)
    for words in ("B1", "B7", "V ", "A1", "A2", "A3", "c0", "loop delay 0.250 ms", "141.0", "protocol quick"):
        assert words in finished.out
    assert "connectors q_m, u_m, q_m_ref, u_m0 (without q_a_ref)" in finished.out and "\x1b" not in finished.out
    assert all(len(line) <= 80 or "flexible-manipulator simulate" in line for line in finished.out.splitlines())
    assert "24 of 24 cases are there from an earlier run (--force" in finished.err
    as_json = call(*again, "--json", folder=folder)
    assert json.loads(as_json.out) == json.loads((folder / "results.json").read_text())


@pytest.mark.parametrize("command", ["evaluate", "report"])
def test_a_finished_evaluation_in_every_form(command: str, pid_file: Path, folder: Path) -> None:
    """All digits in SI units as JSON and CSV, those of the page in a paper's tables."""
    words = {"evaluate": (pid_file, "--quick", "--output-dir", folder), "report": (folder,)}[command]

    def told(form: str) -> str:
        finished = call(command, *words, "--no-report", form, folder=folder)
        assert finished.code == 0 and "written to" in finished.err
        return finished.out

    assert from_json(told("--json"), Results) == (results := Results.load(folder))
    cost, B5 = results.cost, results.criteria["B5"]
    assert cost is not None and B5.value is not None and B5.worst_case is not None
    assert f"V & Cost, eq. (15) & {cost:.1f} & 100.0 & 141.0 & -- " in told("--latex")
    assert f"| B5 | Force error \\[mm\\] | {1e3 * B5.value:.3g} | 7 | 10.2 |" in told("--markdown")
    rows = {row[0]: row[1:] for row in csv.reader(told("--csv").splitlines()) if row}
    assert rows["B5"][:2] == ["Force error [m]", repr(B5.value)] and float(rows["V"][1]) == cost
    assert call(command, *words, "--csv", "--json", folder=folder).code == 2


STARTER = Path(starters.__file__).parent / "python"

PLANNED = {
    "evaluate": ("--quick", 24),
    "evaluate --seeds": ("--seeds 0-2 --quick", 72),
    "sweep": ("--vary K_p[1]=40,50 --protocol quick", 48),
    "reliability": ("--draws 5 --protocol quick", 30),
    "reliability --only": ("--draws 5 --protocol quick --only A2 --distribution corners", 10),
    "verify": ("--no-strict --beside TunedPID", 420),
    "robustness": ("--only B6 --no-list --budget 30", None),
    "tune": ("--vary K_p[1]=40:50 --trials 1 --objective quick --protocol quick", None),
}
"""Options of a study, and how many cases it has, where that does not depend on their results."""


@pytest.mark.parametrize("name", PLANNED)
def test_a_dry_run_tells_the_cases_and_writes_nothing(
    name: str, quick_pid_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "tune":
        require("optuna", "cmaes")
    options, cases = PLANNED[name]
    planned = call(name.split()[0], quick_pid_file, *options.split(), "--dry-run", "--json", folder=tmp_path)
    found = from_json(planned.out, DryRun)
    assert planned.code == 0 and found.stored == 0 and found.cases > 0 and cases in (None, found.cases)
    assert found.seconds == pytest.approx(found.cases * found.seconds_per_case / found.workers) and found.seconds > 0.0
    assert not list(tmp_path.iterdir())


def test_a_dry_run_tells_what_is_stored(pid_file: Path, folder: Path) -> None:
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    for further, stored in (((), 24), (("--force",), 0)):
        planned = call("evaluate", pid_file, "--quick", "--output-dir", folder, "--dry-run", *further, folder=folder)
        assert planned.code == 0 and planned.out.startswith(f"24 cases, {stored} of them in the store\n")
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_a_dry_run_of_a_command_that_is_no_study_says_what_it_would_do(folder: Path, tmp_path: Path) -> None:
    whole = {
        ("check",): "1 controller to check: DiagonalPID",
        ("simulate", "--duration", "0.05"): "1 case to simulate: free.nominal.disturbance, 0.05 s",
        ("report", folder): f"{folder}: Evaluation of DiagonalPID.fmu",
        ("compare", folder): "Evaluations: ",
        ("new", "python", "my_law"): "my_law/README.md\nmy_law/my_law_fmu.py\n",
        ("build", "TunedPID", "--output-dir", "out"): "out/TunedPID.fmu\n",
        ("playground",): "build/playground.html\n",
        ("build", STARTER): f"{STARTER}/Python.fmu\n",
    }
    for words, told in whole.items():
        planned = call(*words, "--dry-run", folder=tmp_path)
        assert planned.code == 0 and planned.out.startswith(told), planned
        assert call(*words, "--dry-run", "--json", folder=tmp_path).code == 2
    assert not list(tmp_path.iterdir())


def test_what_is_written_is_a_list_in_json(tmp_path: Path) -> None:
    made = call("new", "python", "my_law", "--json", folder=tmp_path)
    files = ["my_law/README.md", "my_law/my_law_fmu.py"]
    assert made.code == 0 and json.loads(made.out) == {"written": files}
    assert sorted(str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*.*")) == files
    built = call("build", "my_law", "--json", folder=tmp_path)
    assert json.loads(built.out) == {"written": ["my_law/MyLaw.fmu"]} and (tmp_path / "my_law/MyLaw.fmu").is_file()
    named = call("build", "DiagonalPID", "--output-dir", ".", "--json", folder=tmp_path)
    assert json.loads(named.out) == {"written": ["DiagonalPID.fmu"]} and (tmp_path / "DiagonalPID.fmu").is_file()


def test_the_report_of_several_seeds_is_made_again(quick_pid_file: Path, tmp_path: Path) -> None:
    seeds = ("--seeds", "0,1", "--only", "c00.compliant.noise", "--parquet")
    first = call("evaluate", quick_pid_file, *seeds, "--output-dir", "out", folder=tmp_path)
    assert first.code == 0 and "seed 1: V = -" in first.err, first
    page = (tmp_path / "out" / "report.html").read_text()
    for own in ("seed-0", "seed-1"):
        assert {"results.json", "cases.parquet", "report.html"} <= {
            file.name for file in (tmp_path / "out" / own).iterdir()
        }
    (tmp_path / "out" / "report.html").unlink()
    again = call("report", "out", folder=tmp_path)
    assert again.code == 0 and again.out == first.out
    assert (tmp_path / "out" / "report.html").read_text() == page
    assert "holds no evaluation" in refusal_of(call("report", "out", "--figures", folder=tmp_path))


def test_the_command_beside_a_case_repeats_it(folder: Path, tmp_path: Path) -> None:
    results, id = Results.load(folder), "c01.compliant.noise"
    words = shlex.split(simulate_command(results.head, id))[2:]
    for options in (words, ("--from", folder, "--case", id)):
        told = call("simulate", *options, "--json", folder=tmp_path)
        assert told.code == 0 and from_json(told.out, CaseResult) == results.case(id)
    shown = call("simulate", *words, folder=tmp_path).out
    assert ["B1", "[Nm]", f"{results.case(id).measurements.B1:.3g}"] in map(str.split, shown.splitlines())
    for option in ("--seed=1", "--set=K_p[1]=40", "--protocol=quick", "--plant-set=m[1]=60"):
        assert "--from already says" in refusal(tmp_path, "simulate", "--from", folder, "--case", id, option)


def test_the_options_of_a_repeating_command_are_those_of_the_parser() -> None:
    head = head_of(
        protocol="quick",
        seed=3,
        sample_time=SampleTimeRecord(1e-3, False),
        controller={"path": "my arm.fmu", "parameters": {"K": 1.5}, "mapping": {"q_m[1]": "In 1"}},
        plant={"parameters": {"m[1]": 60.0}},
    )
    pose = replace(ABOUT, configuration=-1, q_a=(math.pi / 4, -math.pi / 3), system="random_3", test="noise")
    given = vars(simulate._parser().parse_args(shlex.split(recording_command(head, pose))[2:]))
    expected = {
        "controller": Path("my arm.fmu"),
        "protocol": "quick",
        "seed": 3,
        "sample_time": Fraction(1, 1000),
        "controller_parameters": [("K", "1.5")],
        "connections": [("q_m[1]", "In 1")],
        "plant_parameters": [("m[1]", 60.0)],
        "configuration": pytest.approx([45.0, -60.0]),
        "system": "random_3",
        "test": "noise",
    }
    assert {name: given[name] for name in expected} == expected


@pytest.mark.slow  # each dry run takes the time of a case
def test_the_commands_that_a_report_advises_are_accepted_as_they_stand(tmp_path: Path) -> None:
    head = head_of(controller={"path": ""}, plant={"parameters": {"m[1]": 60.0}})
    ranges = [range_words("K_p[1]", 20.0, 80.0, log=True)]
    advised = [study_command(head, name) for name in ("robustness", "reliability")]
    advised.append(study_command(head, "evaluate", parameters={"K_p[1]": 41.5}))
    advised += [tune_command(head, *more, ranges=ranges) for more in ((), ROBUST, MORE_TRIALS)]
    for command in advised:
        _, name, *words = shlex.split(command)
        assert call(name, *words, "--dry-run", folder=tmp_path).code == 0, command
    assert "NAME=LOW:HIGH" in tune_command(head), "a reader fills in what a report does not know"
    words = shlex.split(compare_command(tmp_path / "a run"))
    assert words[1:] == ["compare", str(tmp_path / "a run"), "FOLDER"]


def test_simulation_writes_table_and_picture_and_overwrites_nothing(quick_pid_file: Path, tmp_path: Path) -> None:
    for _ in range(2):
        wanted = ("--duration", "0.05", "--csv")
        finished = call("simulate", quick_pid_file, *wanted, folder=tmp_path)
        assert finished.code == 0 and "done at 0.05 s" in finished.out and "largest TCP error" in finished.out
    tables, *others = (list(tmp_path.rglob(f"trajectory.{ending}")) for ending in ("csv", "png", "npz"))
    assert [len(tables), *map(len, others)] == [2, 2, 2]
    header, *rows = csv.reader(tables[0].open())
    assert all("[" in name for name in header) and [float(row[0]) for row in rows] == [k / 4000 for k in range(201)]


def test_several_simulations_stand_on_one_page(quick_pid_file: Path, tmp_path: Path) -> None:
    also = ("--with", f"{quick_pid_file} --set K_p[1]=60", "--with", "--gain 2 1 --duration 0.06")
    words = (quick_pid_file, "--set", "K_p[2]=12", "--duration", "0.05", *also, "--output-dir", "out")
    finished = call("simulate", *words, folder=tmp_path)
    assert finished.code == 0 and "done, 0.06 s" in finished.out and finished.out.count("no verdict") == 6
    assert {file.suffix for file in (tmp_path / "out").glob("trajectory-3.*")} == {".npz", ".png"}
    first, second, third = (
        np.load(tmp_path / "out" / f"trajectory{end}.npz")["u_c[1] [N.m]"] for end in ("", "-2", "-3")
    )
    assert len(first) == len(second) == 201 and len(third) == 241 and not np.array_equal(first, second)
    page = (tmp_path / "out" / "simulation.html").read_text(encoding="utf-8")
    assert f"{quick_pid_file.name} --set K_p[1]=60" in page and "--output-dir out" in page
    assert len(json.loads(call("simulate", *words, "--json", folder=tmp_path).out)) == 3


def test_simulations_that_contradict_themselves(quick_pid_file: Path, tmp_path: Path) -> None:
    for words in ("--with 'a b'", "'", "--from run x", "--with=--ideal"):
        assert "--with" in refusal(tmp_path, "simulate", f"--with={words}")
    assert "more than once" in refusal(tmp_path, "simulate", "--with", "--gain 2 1", "--with", "--gain 2 1")
    case = ("--case", "c07.nominal.noise")
    assert "--case already says" in refusal(tmp_path, "simulate", quick_pid_file, *case, "--with", "--test noise")


def test_a_simulation_that_ends_before_its_test_has_no_verdict(quick_pid_file: Path, tmp_path: Path) -> None:
    """Short of the end, the arm still moves: that is neither unstable nor a limit cycle, and it may yet settle."""
    finished = call("simulate", quick_pid_file, "--duration", "10.6", "--json", folder=tmp_path)
    result = json.loads(finished.out)
    assert result["status"] == "done" and result["measurements"]["settled"] is False
    assert not {"rest_error", "limit_cycle", "limit_cycle_ratio"} & set(result["measurements"])
    shown = call("simulate", quick_pid_file, "--duration", "10.6", folder=tmp_path).out
    assert "there is no verdict" in shown and "B6 [s]" in shown and "> 0." in shown and "unstable" not in shown


def test_the_direction_of_the_force_may_be_given_in_degrees() -> None:
    in_degrees = vars(simulate._parser().parse_args(["--force-direction", "-90"]))
    assert in_degrees["phi_F"] == pytest.approx(-math.pi / 2)


@pytest.mark.needs("compiler")  # the package holds the manipulator in C
def test_simulation_exports_a_package(tmp_path: Path) -> None:
    assert call("simulate", "--duration", "0.05", "--export-ssp", "case.ssp", folder=tmp_path).code == 0
    assert (tmp_path / "case.ssp").is_file()
    options = ("--duration", "0.05", "--in-sequence")
    assert call("simulate", *options, "--export-ssp", "other.ssp", folder=tmp_path).code == 0
    assert (tmp_path / "other.ssp").read_bytes() != (tmp_path / "case.ssp").read_bytes()
    assert call("simulate", *options, folder=tmp_path).code == 2


def test_folders_say_what_differs(quick_pid_file: Path, tmp_path: Path) -> None:
    changes = [(), ("--seed", "1"), ("--set", "K_p[1]=44"), ("--plant-set", "k_high[2]=5e5"), ("--sample-time", "5e-4")]
    for change in changes:
        finished = call("evaluate", quick_pid_file, *ONE, *change, folder=tmp_path)
        assert finished.code == 0 and "replaced" not in finished.err
    names = {file.parent.name for file in tmp_path.glob("runs/*/results.json")}
    assert len(names) == len(changes) and any("K_p[1]=44" in name for name in names)


def test_a_command_has_the_defaults_of_the_library() -> None:
    """Memory was limited to 2048 MB by the commands, and to 2000 MB from Python."""
    given = verify.COMMAND.parser().parse_args([])
    bench = benchmark(argparse.Namespace(**{**vars(given), "protocol": "paper"}))  # it has one of its own
    assert bench == Benchmark(workers=bench.workers) and bench.workers == Benchmark().processes


@pytest.mark.needs("compiler")
def test_a_choice_of_library_has_a_folder_of_its_own(pid_c_file: Path) -> None:
    """Binary and sources need not give the same numbers, and the second evaluation took the first one's place."""
    of_file, of_sources = (
        folder_name(Benchmark("quick"), Controller(pid_c_file, library=library), argparse.Namespace())
        for library in (None, "source")
    )
    assert of_sources == f"{of_file}-library=source"


def test_other_results_are_replaced_with_a_note(quick_pid_file: Path, tmp_path: Path) -> None:
    for seed, note in ((0, False), (1, True)):
        finished = call("evaluate", quick_pid_file, *ONE, "--output-dir", "out", "--seed", seed, folder=tmp_path)
        assert finished.code == 0 and ("other results in out are replaced" in finished.err) == note


def test_compare_skips_what_is_unfinished(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "unfinished").mkdir()
    finished = call("compare", folder, "unfinished", "--json", folder=tmp_path)
    assert finished.code == 0 and "left out: " in finished.err and "unfinished" in finished.err
    (group,) = json.loads(finished.out)["groups"]
    assert group["conditions"]["sample_time"] == 0.00025 and len(group["ranked"]) == 1
    assert call("compare", "unfinished", folder=tmp_path).code == 2


def test_compare_says_of_a_simulation_what_it_is(folder: Path, tmp_path: Path) -> None:
    """A pattern such as runs/Mine-quick* names it, too."""
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "simulation.html").touch()
    finished = call("compare", folder, "case", folder=tmp_path)
    assert finished.code == 0 and "left out: case holds the simulation of one case, which has no V." in finished.err


def test_from_a_starter_kit_to_a_checked_controller(tmp_path: Path) -> None:
    assert call("new", "python", "my_arm", folder=tmp_path).code == 0
    built = call("build", "my_arm", folder=tmp_path)
    assert built.code == 0, built.err
    checked = call("check", built.out.strip(), "--set", "K_p[1]=50", folder=tmp_path)
    assert checked.code == 0 and "no unit" not in checked.out
    assert call("new", "python", "my_arm", folder=tmp_path).code == 2


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_a_module(name: str) -> None:
    source = Path(orchestrator.__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
    home = guard.HOMES.get(name, name)
    assert f'run("{name}")' in source and f"orchestrator.cli.{home}`" in source


def test_a_folder_is_built_as_the_options_say(tmp_path: Path) -> None:
    assert call("new", "python", "my_arm", folder=tmp_path).code == 0
    (tmp_path / "out").mkdir()
    built = call("build", "my_arm", "--output-dir", "out", folder=tmp_path)
    assert (built.code, built.out, built.err) == (0, "out/MyArm.fmu\n", "")
    assert not (tmp_path / "my_arm" / "MyArm.fmu").exists()
    for words in (("--all",), ("--platforms", "x86_64-windows"), ("--output-dir", "absent"), ("--output-dir", "/proc")):
        refusal(tmp_path, "build", "my_arm", *words)
    assert not (tmp_path / "my_arm" / "MyArm.fmu").exists()


@pytest.mark.needs("compiler")
def test_a_folder_in_c_is_built_for_the_platforms_that_exist(tmp_path: Path) -> None:
    assert call("new", "c", "my_arm", folder=tmp_path).code == 0
    assert "amiga" in refusal(tmp_path, "build", "my_arm", "--platforms", "x86_64-linux,amiga")
    assert call("build", "my_arm", folder=tmp_path).out == "my_arm/MyArm.fmu\n"


@pytest.mark.parametrize(
    ("broken", "where", "what"),
    [
        (b"import math\ndef law(:\n", "helper.py:2", "SyntaxError"),
        (b"if True:\npass\n", "helper.py:2", "IndentationError"),
        (b"x = '\xff'\n", "helper.py", "SyntaxError"),
        (b"return 1\n", "helper.py:1", "SyntaxError"),
        (b"x = 1\0\n", "helper.py", ""),
    ],
)
def test_a_syntax_error_is_told_with_its_file_and_line(broken: bytes, where: str, what: str, tmp_path: Path) -> None:
    assert call("new", "python", "my_arm", folder=tmp_path).code == 0
    (tmp_path / "my_arm" / "helper.py").write_bytes(broken)
    told = refusal(tmp_path, "build", "my_arm")
    assert told.startswith(f"error: my_arm/{where}") and what in told and len(told.splitlines()) == 1
    assert not list(tmp_path.rglob("*.fmu"))


def test_an_fmu_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    np.savez(tmp_path / "net.npz", W1=np.ones((2, 8)), b1=np.ones(2), activation="tanh")
    np.savez(tmp_path / "law.npz", A=np.eye(2) / 2, B=np.eye(2), C=np.eye(2), D=np.eye(2), T_s=0.25e-3)
    targets = ["absent/x.fmu", "law.npz/x.fmu", *(["/proc/x.fmu"] if PRESENT["compiler"] else [])]
    for target in targets:
        for words in (("statespace", "law.npz"), ("mlp", "net.npz")):
            told = refusal(tmp_path, "new", *words, "--out", target)
            assert target in told and len(told.splitlines()) == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_examples_and_exit_codes(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    finished = call(name, "--help", folder=tmp_path)
    assert finished.code == 0 and finished.err == ""
    assert finished.out.startswith(f"usage: flexible-manipulator {name} [OPTION ...]")
    _, after = finished.out.split("\nexamples:\n")
    examples, codes = after.rsplit("\nexit codes", 1)
    starts = (f"  flexible-manipulator {name}", '  eval "$(flexible-manipulator ')
    assert any(line.startswith(starts) and name in line for line in examples.splitlines())
    assert re.search(r"\b0 \w+", codes)


EXPLAINED = re.compile(r"^  (?:-\w(?: \w+)?, )?(--[\w-]+)", re.MULTILINE)
"""Begins what the help says of an option."""


@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_two_screens_and_names_every_option(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 40 lines with 100 columns. What it only names, ``--help-all`` explains."""
    monkeypatch.setenv("COLUMNS", "100")
    short, whole = (call(name, word, folder=tmp_path) for word in ("--help", "--help-all"))
    assert (whole.code, whole.err) == (0, "") and len(whole.out) >= len(short.out)
    assert sum(math.ceil(len(line) / 100) or 1 for line in short.out.splitlines()) <= 80
    explained = set(EXPLAINED.findall(whole.out))
    named = set(re.findall(r"(?<![\w-])--[a-zA-Z][\w-]*", short.out.partition("\nexamples:")[0]))
    assert {"--help", "--help-all"} <= explained <= named


def test_console_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2 and main(["frobnicate"]) == 2
    assert "there is no command frobnicate. Commands: evaluate, " in capsys.readouterr().err
    assert main(["evalute"]) == 2 and "Did you mean evaluate?" in capsys.readouterr().err
    assert main(["--help"]) == 0
    assert set(COMMANDS) <= set(capsys.readouterr().out.split())
    assert main(["--version"]) == 0 and capsys.readouterr().out.startswith("flexible-manipulator-benchmark ")
    assert main(["evaluate", "--list", "--quick"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "c00.compliant.noise"


def refusal_of(finished: Finished) -> str:
    """What a refused command said: exit code 2, and one error."""
    assert finished.code == 2 and finished.out == "", finished
    lines = finished.err.splitlines()
    assert sum(line.startswith("error: ") for line in lines) == 1 and "Traceback" not in finished.err, lines
    return finished.err


def refusal(folder: Path, *arguments: object) -> str:
    """The same of a command that finds ``folder`` without results, and leaves it so."""
    told = refusal_of(call(*arguments, folder=folder))  # type: ignore[arg-type]
    assert not list(folder.rglob("results.json")) and not list(folder.rglob("*.csv"))
    return told


REFUSED = {
    "evaluate": "--set K_q[1]=45 | --set K_p[1]=nan | --set K_p[1]=much | --set K_p[1] | --set z_p[1]=1.5 | "
    "--map q_m[1]=a --map q_m[1]=b | --map In1 | --mapping absent.toml | --parameters huge.toml | "
    "--sample-time 0.0004 | --sample-time 1e400 | --sample-time 1/0 | --plant-set m_3=1 | --only c99.* | --jobs 0 | "
    "--seed -1 | --timeout inf | --memory-limit 1e300 | --protocol papper | . | --nonsense | --wait 3 | "
    "--seed 1 --seeds 1 | --dry-run --no-report | --dry-run --latex | "
    "--dry-run --set K_q[1]=4 | --list --only c00.* | --list --json",
    "verify": "--seed 1 | --repeat absent.json --output-dir out | --repeat absent.json --dry-run | --wait 3",
    "simulate": "--configuration 0 200 | --case c01.compliant.noise --system sticky | --t-1 5 --t-2 4 | "
    "--duration 1e9999999999 | --torque-bits 5000 | --torque-limit -1 3 | --phi-F nan | "
    "--phi-F 1e9 | --chirp-frequencies 0 1e6 | --test nose | "
    "--from nowhere --case c00.compliant.noise",
    "linearize": "--configuration 0 200 | --system soft | --output absent.txt | --friction dry",
    "tune": "--vary K_p[1]=2:1",
    "sweep": "--vary K_p[1]=1:2 | --vary K_q=1,2",
    "reliability": "--draws 0 | --probability 2 | --draws 3 --more 4 | --more 4 | --distribution normal | --only A9",
    "report": "nowhere",
    "compare": "nowhere elsewhere",
    "selftest": "--nonsense | --latex | --json --dry-run",
    "new": "python my/controller | python my_arm --out x.fmu | statespace absent.mat | mlp absent.npz | statespace . | "
    "python /proc/nowhere | python /dev/null/x",
    "build": "my_controller | DiagonalPDI | . --all | . DiagonalPID | . --nonsense | . | "
    "DiagonalPID --output-dir absent | DiagonalPID_C --platforms amiga",
}


@pytest.mark.parametrize("line", [f"{name} {line}" for name, lines in REFUSED.items() for line in lines.split(" | ")])
def test_wrong_input_is_one_line(line: str, tmp_path: Path) -> None:
    (tmp_path / "huge.toml").write_text(f'[parameters]\n"K_p[1]" = {"9" * 401}\n')
    assert len(refusal(tmp_path, *line.split())) < 900


@pytest.mark.parametrize("stage", ["begin", "initialize"])
def test_what_an_fmu_refuses_is_said_in_its_own_words(stage: str, tmp_path: Path) -> None:
    body = "self.log('no licence for you', Fmi2Status.error); raise RuntimeError('no licence')"
    imports = "from pythonfmu.enums import Fmi2Status"
    file = python_controller(tmp_path, "Unlicensed", imports=imports, **{stage: body})  # type: ignore[arg-type]
    assert "no licence" in refusal(tmp_path, "evaluate", "--quick", file)


def test_sources_are_compiled_where_there_is_a_compiler(
    pid_c_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = with_broken_sources(pid_c_file, tmp_path / "broken.fmu")
    for _ in range(2):  # what a first attempt leaves in the cache does not change the answer
        assert "sources/pid.c:1:" in refusal(tmp_path, "evaluate", broken)
    sound = without(pid_c_file, tmp_path / "sources.fmu", "binaries/")
    with monkeypatch.context() as bare:
        bare.setenv("CC", "")
        bare.setenv("PATH", str(tmp_path))
        bare.setitem(sys.modules, "ziglang", None)  # the compiler of last resort
        assert "there is no C compiler" in refusal(tmp_path, "evaluate", sound)
    assert call("simulate", sound, "--duration", "0.01", folder=tmp_path).code == 0


@pytest.mark.parametrize("target", ["taken", "taken/below", "/dev/null/x", "/proc/nowhere"])
def test_an_unwritable_output_folder(target: str, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    for words in (("evaluate", *ONE), ("simulate", "--duration", "0.01")):
        assert target in refusal(tmp_path, *words, "--output-dir", target)


def test_an_evaluation_in_a_process_of_its_own_whose_reader_goes_away(quick_pid_file: Path, tmp_path: Path) -> None:
    words = [*EVALUATE, str(quick_pid_file), "--quick", "--only", "*.noise", "--seed", "3"]
    done = finished(["bash", "-c", f"{shlex.join(words)} | true; exit ${{PIPESTATUS[0]}}"], tmp_path)
    assert done.returncode in (0, 1)
    (written,) = (tmp_path / "runs").iterdir()
    assert written.name.startswith(f"{quick_pid_file.stem}-quick-seed3-")
    assert {"results.json", "cases.csv", "trajectories.npz", "report.html"} <= {file.name for file in written.iterdir()}


def test_results_that_cannot_be_written(pid_file: Path, folder: Path, tmp_path: Path) -> None:
    """All cases are in the store, but what is made of them finds no place."""
    shutil.copytree(folder, tmp_path / "out")
    (tmp_path / "out" / "results.json").unlink()
    (tmp_path / "out" / "results.json" / "in the way").mkdir(parents=True)
    stopped = call("evaluate", pid_file, "--quick", "--no-report", "--output-dir", tmp_path / "out", folder=tmp_path)
    assert stopped.code == 1 and "results.json" in stopped.err


def test_ctrl_c_while_modules_are_imported(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """In this process: no signal could be sent at that very moment."""

    def interrupted(name: str, package: str | None = None) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as during:
        during.setattr(guard, "import_module", interrupted)
        code = guard.run("evaluate", ["--quick"])
    assert (code, capsys.readouterr().err) == (130, "interrupted\n")


@pytest.mark.needs("bash")
def test_the_shell_completes_commands_and_options(tmp_path: Path) -> None:
    script = call("completion", folder=tmp_path).out
    helped = 'flexible-manipulator() { echo "  --seed N  --seeds LIST  of --protocol"; }'
    ask = 'asked() { COMP_WORDS=(flexible-manipulator "$@"); COMP_CWORD=$#; _flexible_manipulator; '
    ask += 'echo "${COMPREPLY[*]}"; }'
    wanted = "asked ev; asked evaluate --se; asked evaluate --se; asked evaluate quick"
    (tmp_path / "quick.fmu").touch()
    found = finished(["bash", "-c", "\n".join([helped, script, ask, wanted])], tmp_path)
    assert found.stdout.splitlines() == ["evaluate", "--seed --seeds", "--seed --seeds", "quick.fmu"], found.stderr


def test_runs_are_listed_with_their_v(tmp_path: Path) -> None:
    Evaluation(results_of(), ()).save(tmp_path / "runs" / "one")
    searched().save(tmp_path / "runs" / "two")
    (tmp_path / "runs" / "damaged").mkdir()
    (tmp_path / "runs" / "damaged" / "results.json").write_text("{}")
    shown = call("runs", folder=tmp_path)
    assert shown.code == 0 and "runs/one" in shown.out and "2 found" in shown.out
    assert "damaged" in shown.err and "Traceback" not in shown.err
    listed = {each["folder"]: each for each in json.loads(call("runs", "--json", folder=tmp_path).out)}
    assert listed["runs/one"]["V"] == pytest.approx(results_of().cost) and listed["runs/one"]["kind"] == "evaluation"
    assert listed["runs/two"]["holds"] is False
    assert call("runs", "absent", folder=tmp_path).code == 2


@pytest.mark.parametrize("command", ["verify", "build", "report", "evaluate"])
def test_a_name_that_no_file_can_have_is_one_clear_line(command: str, tmp_path: Path) -> None:
    assert "too long" in refusal_of(call(command, "x" * 300, folder=tmp_path))


def test_plant_parameters_are_given_one_by_one_or_several_at_once(tmp_path: Path) -> None:
    pairs = [("m[1]", 55.0), ("k_high[2]", 5e5), ("psi[1]", -1e-3)]
    assert values.assignments("m[1]=55,k_high[2]=5e5, psi[1]=-1e-3") == pairs
    assert values.assignments("K[1,2]=3") == [("K[1,2]", 3.0)]
    for wrong in ("m[1]=5,", "m[1]=5,k_high", "m[1]=5;k=1", ""):
        with pytest.raises(ArgumentTypeError):
            values.assignments(wrong)
    command = ("linearize", "--configuration", "45", "-60", "--json")
    apart = call(*command, "--plant-set", "m[1]=55", "--plant-set", "k_high[2]=5e5", folder=tmp_path)
    assert apart.code == 0 and call(*command, "--plant-set", "m[1]=55,k_high[2]=5e5", folder=tmp_path) == apart
    assert call(*command, "--plant-set", "m[1]=55,m[1]=56", folder=tmp_path).code == 2


def test_a_case_that_is_the_worst_in_several_respects_has_one_command() -> None:
    found = searched()
    same = {name: replace(own, worst_case=Found(1.0, "again")) for name, own in found.criteria.items()}
    listed = dict(worst_page.commands(same, found.requirements, {"gain_1": Margin(2.5, 20.0, command="again")}))
    assert listed["margin gain_1, largest B5, largest B6"] == "again"
