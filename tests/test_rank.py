"""The ranking of a hand-in: killed in the middle it goes on, and a hostile or broken FMU costs its own place alone."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path

import pytest
from hostile.commands import finished, kill, started, wait_for
from hostile.fmus import Fault, hostile_fmu
from service.unusual import BINDING, unusual
from support.reports import unbroken

from orchestrator import Benchmark, InputError, Spread

FILE = Path(__file__).parents[1] / "examples" / "teaching" / "rank.py"
SMALL = """extends = "verification"
name = "small"
[grid]
q_a1_points = 1
q_a2_points = 1
also_deg = []
[sets]
performance = ["compliant"]
[selection]
poses = [0]
tests = ["noise", "disturbance"]
"""


@pytest.fixture
def rank(monkeypatch):
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("rank", FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.needs("compiler", "bubblewrap", "posix")
def test_a_ranking_goes_on_after_a_kill_and_each_fmu_costs_its_own_place(quick_pid_file: Path, tmp_path: Path) -> None:
    folder, ranking = tmp_path / "hand-in", tmp_path / "ranking"
    folder.mkdir()
    shutil.copy(quick_pid_file, folder / "<b>a.fmu")
    hostile_fmu(tmp_path, Fault("abort")).rename(folder / "b-crash.fmu")
    hostile_fmu(tmp_path, Fault("sleep")).rename(folder / "c-hang.fmu")
    (folder / "d-broken.fmu").write_bytes(b"no archive")
    (tmp_path / "small.toml").write_text(SMALL)
    command = [sys.executable, str(FILE), "hand-in", "--protocol", "small.toml", "--timeout", "2"]

    with started(command, tmp_path) as first:
        assert wait_for(lambda: (ranking / "runs" / "<b>a.fmu" / Spread.FILE).is_file())
        assert wait_for(lambda: (ranking / "runs" / "b-crash.fmu").is_dir() or first.poll() is not None)
        kill(first)
    before = (ranking / "hand-in.json").read_text()
    kept = (ranking / "runs" / "<b>a.fmu" / Spread.FILE).stat().st_mtime_ns

    done = finished(command, tmp_path)
    assert done.returncode == 0, done.stderr
    assert (ranking / "hand-in.json").read_text() == before
    assert (ranking / "runs" / "<b>a.fmu" / Spread.FILE).stat().st_mtime_ns == kept
    page = unbroken((ranking / "ranking.html").read_text())
    assert "d-broken.fmu is not an FMU" in page and "crashed" in page and "timeout" in page
    assert "<b>a" not in page and "not evaluated yet" not in page

    spreads = {place.name: Spread.load(place) for place in (ranking / "runs").iterdir() if place.name[0] != "d"}
    draws = {tuple(score.seed for score in (*each.seeds, *each.incomplete)) for each in spreads.values()}
    assert len(draws) == 1
    assert {name for name, each in spreads.items() if each.cost.mean is not None} == {"<b>a.fmu"}
    # Whoever was ranked gets the same numbers at home.
    first_draw = spreads["<b>a.fmu"].seeds[0]
    at_home = Benchmark(tmp_path / "small.toml", first_draw.seed).evaluate(quick_pid_file, recordings=False)
    assert (at_home.cost, at_home.requirements["A3"].passed) == (first_draw.cost, first_draw.requirements["A3"])


def test_a_hand_in_is_closed_before_its_draws_are_known(rank, tmp_path: Path) -> None:
    folder = tmp_path / "hand-in"
    folder.mkdir()
    (folder / "one.fmu").write_bytes(b"1")
    first = rank.closed(folder, "verification", tmp_path)
    assert rank.closed(folder, "verification", tmp_path) == first
    assert json.loads((tmp_path / "hand-in.json").read_text())["files"].keys() == {"one.fmu"}
    (folder / "late.fmu").write_bytes(b"2")
    with pytest.raises(InputError, match=r"late\.fmu") as refused:
        rank.closed(folder, "verification", tmp_path)
    assert refused.value.what == "other-hand-in"


def test_draws_follow_from_all_files_and_the_entropy(rank) -> None:
    one = rank.HandIn({"a.fmu": "1", "b.fmu": "2"}, "verification", rank.fresh())
    others = (
        rank.HandIn({"a.fmu": "1", "b.fmu": "3"}, "verification", one.entropy),
        rank.HandIn({"a.fmu": "1"}, "verification", one.entropy),
        rank.HandIn(one.files, "verification", rank.fresh()),
    )
    assert one.seeds == rank.HandIn(dict(reversed(one.files.items())), "verification", one.entropy).seeds
    assert len({seed for each in (one, *others) for seed in each.seeds}) == 12


@pytest.mark.needs("compiler", "bubblewrap", "posix")
def test_a_mapping_beside_an_fmu_is_a_part_of_the_hand_in(rank, pid_c_file: Path, tmp_path: Path) -> None:
    folder = tmp_path / "hand-in"
    folder.mkdir()
    unusual(pid_c_file, folder / "Ada.fmu")
    (folder / "other.toml").write_text("of no FMU")
    (tmp_path / "small.toml").write_text(SMALL)
    words = [str(folder), "--protocol", str(tmp_path / "small.toml"), "--output-dir"]
    assert rank.main([*words, str(tmp_path / "without")]) == 0
    assert "Not evaluated" in (tmp_path / "without" / "ranking.html").read_text()

    lines = [f"{json.dumps(name)} = {json.dumps(variable)}" for name, variable in BINDING.items()]
    (folder / "Ada.toml").write_text("\n".join(["[map]", *lines]))
    with pytest.raises(InputError, match=r"Ada\.toml"):
        rank.main([*words, str(tmp_path / "without")])
    assert rank.main([*words, str(tmp_path / "with")]) == 0
    assert json.loads((tmp_path / "with" / "hand-in.json").read_text())["files"].keys() == {"Ada.fmu", "Ada.toml"}
    assert Spread.load(tmp_path / "with" / "runs" / "Ada.fmu").cost.mean is not None
    shutil.copy(folder / "Ada.toml", folder / "Ada.ssm")
    assert rank.main([*words, str(tmp_path / "both")]) == 0
    assert "more than one mapping" in (tmp_path / "both" / "ranking.html").read_text()
