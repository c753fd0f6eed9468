"""results.json, cases.csv and their relatives, and the way back from a run's folder."""

from __future__ import annotations

import csv
import io
import json
import stat
from dataclasses import replace

import numpy as np
import pytest
from closed_loops import quiet
from hypothesis import given
from hypothesis import strategies as st
from reports import RECORDINGS, TABLE_2, evaluation, recording, stored
from results import everything, result, trajectory
from scipy.io import loadmat

from orchestrator.cosim.trajectory import Status
from orchestrator.errors import InputError
from orchestrator.report import files
from orchestrator.report.__main__ import main
from orchestrator.report.files import prepare_folder, write_text
from orchestrator.report.mat import mat_bytes
from orchestrator.report.outputs import remove_outdated
from orchestrator.report.recording import thin
from orchestrator.report.results import document
from orchestrator.report.run import load_run
from orchestrator.report.tables import csv_text
from orchestrator.report.trajectory_files import OBSERVED, columns, write_mat

TOP_LEVEL = {
    *("schema", "benchmark", "protocol", "complete", "cost", "criteria", "stability", "configurations", "cases"),
    *("controller", "plant", "rules", "seed", "sample_time", "loop_delay", "environment", "timing"),
}


@pytest.fixture
def run(tmp_path, plant_file, pid_file):
    return stored(tmp_path, evaluation(plant_file, pid_file))


def test_document_is_plain_json_with_stable_keys(plant_file, pid_file):
    contents = document(evaluation(plant_file, pid_file))
    assert json.loads(json.dumps(contents, allow_nan=False)) == contents
    assert set(contents) == TOP_LEVEL
    assert contents["cost"] == pytest.approx(140.7, abs=0.05)
    assert len(contents["cases"]) == 324
    assert contents["criteria"]["B5"]["paper"] == 10.2e-3
    assert contents["plant"]["nominal"]["l[2]"] == 1.5


def test_what_was_written_is_read_back(run, plant_file, pid_file):
    assert run.document == document(evaluation(plant_file, pid_file))
    for back, original in zip(run.recordings, RECORDINGS, strict=True):
        assert back.about == original.about
        np.testing.assert_array_equal(back.motion, original.motion)
        np.testing.assert_array_equal(back.torque, original.torque)


def test_csv_has_one_row_a_case(plant_file, pid_file):
    failed = replace(result(2, "sticky", "gain_1", None, None, Status.CRASHED), message='said "no",\nthen died; ü')
    cases = [*everything(TABLE_2, [0]), failed]
    rows = list(csv.DictReader(io.StringIO(csv_text(document(evaluation(plant_file, pid_file, cases))))))
    assert [row["id"] for row in rows] == [entry.case.id for entry in cases]
    assert {row["B5 [m]"] for row in rows} == {"", "0.0102"}
    assert rows[-1]["message"] == failed.message
    assert rows[-1]["limit_cycle_x [m]"] == ""


def test_parquet_is_the_same_table(run):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert main([str(run.folder), "--parquet", "--no-report"]) == 0
    table = parquet.read_table(run.folder / "cases.parquet").to_pydict()
    assert table["id"] == [case["id"] for case in run.document["cases"]]
    assert set(table["B5 [m]"]) == {None, 0.0102}


def test_parquet_without_pyarrow_is_one_clear_message(run, monkeypatch):
    monkeypatch.setattr("orchestrator.report.outputs.find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install pyarrow"):
        main([str(run.folder), "--parquet"])


@pytest.mark.parametrize("count", [0, 1, 5])
def test_mat_holds_the_recordings(run, count):
    contents = loadmat(io.BytesIO(mat_bytes(replace(run, recordings=RECORDINGS[:count]))), simplify_cells=True)
    rows = contents["recordings"] if count != 1 else [contents["recordings"]]
    assert len(rows) == count
    for row, original in zip(rows, RECORDINGS, strict=False):
        assert row["id"] == original.about.id
        np.testing.assert_array_equal(row["x"], original.motion[:, 1])
        np.testing.assert_array_equal(row["u_m2"], original.torque[:, 2])


def test_figures_are_written_in_all_formats_and_repeat_byte_for_byte(run):
    def written():
        assert main([str(run.folder), "--figures", "--no-report"]) == 0
        return {file.name: file.read_bytes() for file in (run.folder / "figures").iterdir()}

    first = written()
    assert {name.split("_")[1] for name in first} == {"03", "04", "08", "09", "10", "11", "12"}
    assert len(first) == 7 * 3
    assert written() == first


def test_figures_without_recordings_are_those_of_the_plant(tmp_path, plant_file, pid_file):
    run = stored(tmp_path, evaluation(plant_file, pid_file), ())
    assert main([str(run.folder), "--figures"]) == 0
    assert {file.name.split("_")[1] for file in (run.folder / "figures").iterdir()} == {"03", "04"}


def test_what_has_nothing_to_show_is_left_out_and_told(tmp_path, plant_file, pid_file, capsys):
    run = stored(tmp_path, evaluation(plant_file, pid_file), ())
    assert main([str(run.folder), "--figures", "--mat", "--no-report"]) == 0
    told = capsys.readouterr().err
    left_out, written = told.splitlines()[0], told.splitlines()[-1]
    assert left_out.startswith("not written") and "no trajectories" in left_out and "--no-report" in told
    for name in ("trajectories.mat", *(f"figures/figure_{number}_" for number in ("08", "09", "10", "11", "12"))):
        assert name in left_out and name not in written
    assert "figure_03" in written and "figure_03" not in left_out
    assert not (run.folder / "trajectories.mat").exists()


def test_nothing_is_said_to_be_left_out_of_a_run_with_trajectories(run, capsys):
    assert main([str(run.folder), "--figures", "--mat", "--no-report"]) == 0
    assert "not written" not in capsys.readouterr().err


def test_json_of_a_run_is_its_results(run, capsys):
    assert main([str(run.folder), "--json", "--no-report"]) == 0
    assert json.loads(capsys.readouterr().out) == run.document


@pytest.mark.parametrize(
    ("contents", "message"),
    [(None, "cannot be read"), ("{", "no JSON"), ("[]", "schema"), ('{"schema": "other/2"}', "other/2")],
)
def test_a_folder_without_results_is_said_to_be_one(tmp_path, contents, message):
    if contents is not None:
        (tmp_path / "results.json").write_text(contents)
    with pytest.raises(InputError, match=message):
        load_run(tmp_path)


@pytest.mark.parametrize("damage", [b"", b"no archive", b"PK\x03\x04"])
def test_broken_recordings_are_an_input_error(run, damage):
    (run.folder / files.TRAJECTORIES).write_bytes(damage)
    with pytest.raises(InputError, match="trajectories.npz is damaged"):
        load_run(run.folder)


def test_recordings_broken_anywhere_are_told_in_the_projects_own_words(run):
    """Every layer of the file: NumPy, JSON, ZIP and its compression have errors of their own."""
    file = run.folder / files.TRAJECTORIES
    whole = file.read_bytes()
    random = np.random.default_rng(0)
    for place in [*random.integers(len(whole), size=60), *random.integers(len(whole) - 900, len(whole), size=60)]:
        for damaged in (whole[:place], whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :]):
            file.write_bytes(damaged)
            try:
                load_run(run.folder)  # a few bytes are read by nobody
            except InputError as problem:
                assert "pickle" not in str(problem) and str(problem).startswith(f"{file} is damaged. ")


def test_recordings_that_may_not_be_read_are_not_damaged(run):
    (run.folder / files.TRAJECTORIES).unlink()
    (run.folder / files.TRAJECTORIES).mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        load_run(run.folder)


def test_a_file_is_replaced_whole(tmp_path):
    file = tmp_path / "a.txt"
    write_text(file, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(file, "new \udc00")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_folder_that_cannot_be_made_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--output-dir"):
        prepare_folder(tmp_path / "file" / "folder")
    prepare_folder(tmp_path / "new" / "folder")
    assert stat.S_ISDIR((tmp_path / "new" / "folder").stat().st_mode)


@given(
    st.integers(1, 20),
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=200),
)
def test_thinning_keeps_extremes_and_ends_in_order(intervals, values):
    signals = np.array(values)
    kept = thin(signals, intervals)
    assert (np.diff(kept) > 0).all()
    assert kept[0] == 0 and kept[-1] == len(signals) - 1
    np.testing.assert_array_equal(signals[kept].min(axis=0), signals.min(axis=0))
    np.testing.assert_array_equal(signals[kept].max(axis=0), signals.max(axis=0))
    assert kept.size <= max(2 * intervals, 4 * intervals + 2)


def test_thinning_leaves_out_what_is_not_finite():
    signals = np.array([[0.0], [np.nan], [1.0], [np.inf]])
    assert thin(signals, 5).tolist() == [0, 2]
    assert thin(np.full((3, 1), np.nan), 5).size == 0


def test_error_is_the_distance_from_the_beginning():
    entry = recording(("B5",))
    assert entry.error.max() == pytest.approx(8e-3, rel=0.05)


def test_a_trajectory_in_full_for_matlab(tmp_path):
    signals = trajectory(error_x=1e-3, torque=(1.0, 2.0), duration=1.0)
    links = {name: np.zeros(signals.time.size) for name in OBSERVED}
    write_mat(columns(replace(signals, extra=links), quiet("1")), tmp_path / "trajectory.mat")
    contents = loadmat(tmp_path / "trajectory.mat", squeeze_me=True)
    np.testing.assert_array_equal(contents["u_m_2"][:-1], signals.torque[:, 1])
    assert {"time", "q_a_1", "q_m_2", "u_c_1", "u_d_2", "F_x", "x", "tcp_error"} <= set(contents)


# ---- Other results in the same folder ----


def test_what_was_made_of_other_results_is_removed(run, plant_file, pid_file):
    (run.folder / files.REPORT).write_text("the old one")
    (run.folder / files.FIGURES).mkdir()
    (run.folder / "cases.sqlite").write_text("stays")
    same = document(evaluation(plant_file, pid_file))
    same["timing"]["wall_time"] = 1.0
    assert not remove_outdated(run.folder, same)
    assert (run.folder / files.REPORT).exists()
    assert remove_outdated(run.folder, {**same, "seed": 1})
    assert [file.name for file in run.folder.iterdir()] == ["cases.sqlite"]


def test_an_empty_folder_has_nothing_outdated(tmp_path, plant_file, pid_file):
    assert not remove_outdated(tmp_path, document(evaluation(plant_file, pid_file)))
