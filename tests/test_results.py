"""results.json, cases.csv and their relatives, and the way back from a run's folder."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace as replaced
from scipy.io import loadmat
from support.refusals import refusal
from support.reports import RECORDINGS, results_of, scaled, stored
from support.results import TABLE_2, everything, result, trajectory

from orchestrator import Benchmark
from orchestrator.codec import plain, to_json
from orchestrator.documents import files, simulations
from orchestrator.documents.comparability import conditions
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.figures import write_figures
from orchestrator.documents.files import write_text
from orchestrator.documents.recording import MOTION, OBSERVED, bent, extremes, record, shortened
from orchestrator.documents.results import cases_csv, mat_bytes, parquet_bytes
from orchestrator.documents.spread import Spread
from orchestrator.errors import EnvironmentFault
from orchestrator.loop.scenario import Chirp, Pulse, Scenario
from orchestrator.loop.trajectory import Status


@pytest.fixture
def run(tmp_path):
    return stored(tmp_path, results_of())


def test_what_was_written_is_read_back(run):
    assert run.results == results_of()
    assert run.results.cost == pytest.approx(140.7, abs=0.05)
    for back, original in zip(run.recordings, RECORDINGS, strict=True):
        assert back.about == original.about
        np.testing.assert_array_equal(back.motion, original.motion)
        np.testing.assert_array_equal(back.torque, original.torque)


def of_form_4(results):
    """The results as versions of the benchmark up to 3 wrote them: an amplitude and a verdict for each coordinate."""
    contents = plain(results) | {"schema": "flexible-manipulator-results/4"}
    contents["head"]["benchmark"] = "FlexibleManipulator-v3"
    for case in contents["cases"]:
        if (size := case["measurements"].pop("limit_cycle", None)) is not None:
            case["measurements"] |= {"limit_cycle_x": 0.5 * size, "limit_cycle_z": size}
    verdict = {name: value for name, value in contents["stability"]["A3"].items() if name != "axes"}
    contents["stability"]["A3"]["axes"] = {"x": verdict, "z": verdict}
    return contents


def test_results_of_version_3_are_read_and_not_ranked_with_others(run):
    file, cycling = run.folder / files.RESULTS, result(4, "slippery", "delay_2", {}, 2e-5)
    earlier = results_of([cycling if case.id == cycling.id else case for case in everything(TABLE_2)])
    file.write_text(json.dumps(of_form_4(earlier)))
    found = Evaluation.load(run.folder).results
    assert found == replaced(earlier, head=replaced(earlier.head, benchmark="FlexibleManipulator-v3"))
    assert found.stability["A3"].limit_cycle == 2e-5
    difference = conditions(found.head).difference(conditions(earlier.head))
    assert difference == "benchmark FlexibleManipulator-v3, not benchmark FlexibleManipulator-v4"
    damaged = of_form_4(earlier)
    damaged["cases"][5]["measurements"]["limit_cycle_x"] = "wide"
    file.write_text(json.dumps(damaged))
    assert refusal(Evaluation.load, run.folder).what == "damaged"


def test_other_forms_are_refused_with_what_to_do(run):
    file = run.folder / files.RESULTS
    file.write_text('{"schema": "flexible-manipulator-results/3"}')
    assert "has the form 'flexible-manipulator-results/3'" in str(refusal(Evaluation.load, run.folder))
    (run.folder / files.SPREAD).write_text('{"schema": "flexible-manipulator-spread/1"}')
    assert str(refusal(Spread.load, run.folder)).endswith("Make it again with this version.")
    (run.folder / files.SPREAD).write_text('{"schema": "flexible-manipulator-spread/99"}')
    assert str(refusal(Spread.load, run.folder)).endswith("A later version of this package made it.")


WRONG = {
    "damaged": [
        *("{", "[]"),
        lambda c: c.update(cost=1.0),
        lambda c: c.update(complete=False),
        lambda c: c["criteria"]["B5"].update(value=1e-3),
        lambda c: c["stability"]["A1"].update(passed=False),
        lambda c: c["cases"][0]["measurements"].update(B1=0.01),
        lambda c: c["cases"].append(c["cases"][0]),
        lambda c: c.update(cases=[]),
        lambda c: c["head"]["plant"]["nominal"].pop("l[1]"),
        lambda c: c["head"]["rules"]["cost"].update(paper=0.0),
        lambda c: c["head"]["rules"]["criteria"]["B1"].update(unit="parsec"),
    ],
    "other-schema": ["{}", '{"schema": "other/2"}'],
}


@pytest.mark.parametrize("what", WRONG)
def test_results_that_are_none_or_contradict_themselves_are_refused(run, what):
    file = run.folder / files.RESULTS
    for change in WRONG[what]:
        contents = json.loads(to_json(run.results))
        if not isinstance(change, str):
            change(contents)
        file.write_text(change if isinstance(change, str) else json.dumps(contents))
        refused(run.folder, what, file)
    file.unlink()
    refused(run.folder, "no-run", file)


def refused(folder, what, file):
    """A run cannot be loaded because of a file."""
    error = refusal(Evaluation.load, folder)
    assert (error.what, error.where) == (what, str(file))


@pytest.mark.needs("pyarrow")
def test_csv_has_one_row_per_case_and_no_cell_is_a_formula():
    from pyarrow import parquet

    messages = ['said "no",\r\nthen died; ü', *(f"{start}HYPERLINK(0)" for start in "=+-@\t")]
    failed = [result(n, "sticky", "gain_1", None, None, Status.CRASHED, text) for n, text in enumerate(messages, 2)]
    cases = [*everything(TABLE_2, [0]), result(1, "sticky", "gain_1"), *failed]
    rows = list(csv.DictReader(io.StringIO(cases_csv(results_of(cases)), newline="")))
    assert [row["id"] for row in rows] == [entry.id for entry in cases]
    assert {row["B5 [m]"] for row in rows} == {"", "0.0102"}
    expected = ['said "no",\nthen died; ü', *(f"'{text}" for text in messages[1:])]
    assert [row["message"] for row in rows[-6:]] == expected and rows[-1]["limit_cycle [m]"] == ""
    assert float(rows[-7]["q_a1 [rad]"]) < 0, "a number keeps its sign"
    table = parquet.read_table(io.BytesIO(parquet_bytes(results_of(cases)))).to_pydict()
    assert table["id"] == [entry.id for entry in cases] and set(table["B5 [m]"]) == {None, 0.0102}


@pytest.mark.parametrize("count", [0, 1, 5])
def test_mat_holds_a_struct_array_of_the_recordings(count):
    contents = loadmat(io.BytesIO(mat_bytes(Evaluation(results_of(), RECORDINGS[:count]))))
    recordings = contents["recordings"]
    assert recordings.shape == (1, count) and contents["units"]["q_a1"].item() == "rad"
    assert {"id", "roles", "window", "t", "x", "u_m2"} <= set(recordings.dtype.names)
    for entry, original in zip(recordings[0], RECORDINGS, strict=False):
        assert entry["id"].tolist() == [original.about.id]
        assert entry["window"].ravel().tolist() == list(original.about.window)
        np.testing.assert_array_equal(entry["x"], original.motion[:, 1:2])
        np.testing.assert_array_equal(entry["t_torque"], original.torque[:, :1])


def test_figures_are_written_in_all_formats_and_repeat_byte_for_byte(run, tmp_path):
    whole, plant = tmp_path / "figures", tmp_path / "without recordings"
    names, missing = write_figures(run, whole)
    assert (len(names), missing, len(list(whole.iterdir()))) == (7, [], 7 * 3)
    names, missing = write_figures(Evaluation(results_of()), plant)
    assert {name.split("_")[1] for name in names} == {"03", "04"} and len(missing) == 5
    assert all(file.read_bytes() == (whole / file.name).read_bytes() for file in plant.iterdir())


CHANGED_RECORDINGS = {
    "other columns": {"columns_torque": np.array(["t [s]", "u_m2 [N.m]", "u_m1 [N.m]"])},
    "not finite": {"torque_0": np.full((5, 3), np.nan, np.float32)},
    "times that decrease": {"torque_0": np.array([[0, 1, 3, 2, 4]] * 3, np.float32).T},
}


def test_recordings_are_those_that_were_written_or_refused(run):
    file = run.folder / files.TRAJECTORIES
    whole = file.read_bytes()
    with np.load(file) as stored_arrays:
        arrays = dict(stored_arrays)
    assert tuple(arrays["columns_motion"]) == MOTION
    for change in CHANGED_RECORDINGS.values():
        assert set(change) <= set(arrays)
        np.savez(file, **{**arrays, **change})
        refused(run.folder, "damaged", file)
    for contents in (b"", b"no archive", b"PK\x03\x04", whole[:-900]):
        file.write_bytes(contents)
        refused(run.folder, "damaged", file)
    file.unlink()
    file.mkdir()
    refused(run.folder, "no-file", file)  # what may not be read is not damaged


signal_rows = st.lists(st.tuples(*[st.floats(-1e3, 1e3)] * 2), min_size=1, max_size=200)


@given(signal_rows, st.integers(1, 20))
def test_the_extremes_of_intervals_are_those_of_every_signal_and_both_ends(rows, intervals):
    signals = np.array(rows)
    kept = extremes(signals, intervals)
    assert kept[0] == 0 and kept[-1] == len(signals) - 1
    for extreme in (np.min, np.max):
        np.testing.assert_array_equal(extreme(signals[kept], axis=0), extreme(signals, axis=0))
    assert kept.size <= max(2 * intervals, 4 * intervals + 2)


@given(signal_rows, st.floats(0.0, 100.0))
def test_a_curve_through_what_is_kept_is_no_farther_from_any_sample_than_its_slack(rows, slack):
    signals, time = np.array(rows), 0.1 * np.arange(len(rows))
    kept = bent(time, signals, (slack, 0.0), 1000)
    for signal, allowed in zip(signals.T, (slack, 0.0), strict=True):
        distance = np.abs(np.interp(time, time[kept], signal[kept]) - signal)
        assert distance.max() <= 2.0 * allowed + 1e-9, "twice: what is kept beside the bends is a sample, too"
        assert (signal[kept].min(), signal[kept].max()) == (signal.min(), signal.max())


def test_what_is_not_finite_is_not_kept_and_too_much_is_not_either():
    time, noise = np.arange(5000.0), np.random.default_rng(0).standard_normal((5000, 1))
    assert bent(time[:4], np.array([[0.0], [np.nan], [1.0], [np.inf]]), (0.0,), 5).tolist() == [0, 2]
    kept = bent(time, noise, (0.0,), 400)
    assert kept.size <= 400 and noise[kept].max() == noise.max()
    assert bent(time, noise, (0.0,), 0).size == 0


def dithered(frequency, duration=26.0):
    """A case whose torque of axis 1 oscillates by 4 N.m; that of axis 2 is quiet."""
    signals = trajectory(torque=(lambda t: 4.0 * np.sin(2 * np.pi * frequency * t), 2.0), duration=duration)
    return replace(signals, extra={name: np.zeros(signals.time.size) for name in OBSERVED})


@pytest.mark.parametrize("rows", [120_000, 5000])
@pytest.mark.parametrize("frequency", [3.0, 62.0, 230.0])
def test_no_curve_of_a_torque_has_a_frequency_that_it_does_not_have(frequency, rows):
    """A dither of 62 Hz was shown with 40.5 Hz: the smallest and the largest sample of 29 ms in turn."""
    (case,) = (case for case in Benchmark("paper").cases if case.id == "c07.compliant.disturbance")
    signals = dithered(frequency)
    entry = shortened(record(case, ("B5",), signals), rows)
    assert len(entry.motion) <= rows and len(entry.torque) <= rows
    time = signals.time[:-1]
    low, high = (np.interp(time, entry.torque[:, 0], table) for table in (entry.torque[:, 1], bounds(entry)[:, 0]))
    wave = signals.torque[:, 0]
    assert (wave >= low - 0.4).all() and (wave <= high + 0.4).all() and entry.largest_torque(1) == pytest.approx(4.0)
    assert entry.largest_torque(2) == 2.0
    bounded = high - low > 0.5
    assert not bounded.any() if rows > 5000 or frequency < 10.0 else bounded.any() and not bounded.all()
    for curve in (low, high):
        assert np.ptp(curve[bounded]) < 0.5 if bounded.any() else True, "bounds do not oscillate"
        assert np.abs(curve - wave)[~bounded].max() < 0.5
    np.testing.assert_array_equal(bounds(entry)[:, 1], 2.0)


def bounds(entry):
    return entry.torque[:, 1:] if entry.highest is None else entry.highest


def test_figures_for_publication_have_all_samples():
    (case,) = (case for case in Benchmark("paper").cases if case.id == "c07.compliant.disturbance")
    signals = dithered(230.0)
    entry = record(case, ("example",), signals)
    shown = np.interp(signals.time[:-1], entry.torque[:, 0], entry.torque[:, 1])
    np.testing.assert_allclose(shown, signals.torque[:, 0], atol=1e-2)  # times have single precision
    assert len(record(case, ("spread",), signals).torque) == 0, "of which errors alone are shown"


def test_a_trajectory_in_every_format_is_the_same(tmp_path):
    signals = trajectory(error_x=lambda t: 1e-3 * np.sin(t), torque=(lambda t: 0.1 * t, 2.0), duration=1.0)
    links = {name: np.zeros(signals.time.size) for name in OBSERVED}
    scenario = Scenario((), 1, 0.25e-3, chirp=Chirp((1.0, 2.0), 0.0, 1.0, 0.0, 15.0), pulse=Pulse((3.0, 4.0), 0.5, 0.6))
    table = simulations.columns(replace(signals, extra=links), scenario)
    assert table["F_z [N]"].max() == 4.0 and table["F_x [N]"][table["time [s]"] < 0.5].max() == 0.0
    np.testing.assert_allclose(table["u_d[2] [N.m]"], 2 * table["u_d[1] [N.m]"])
    for ending in ("csv", "npz", "mat"):
        getattr(simulations, f"write_{ending}")(table, tmp_path / f"a.{ending}")
    rows = list(csv.DictReader((tmp_path / "a.csv").open(newline="")))
    mat = loadmat(tmp_path / "a.mat", squeeze_me=True)
    with np.load(tmp_path / "a.npz") as npz:
        assert list(npz) == list(table)
        for name, values in table.items():
            np.testing.assert_array_equal(npz[name], values)
            np.testing.assert_array_equal([float(row[name]) for row in rows], values)
    np.testing.assert_array_equal(mat["u_m_1"], table["u_m[1] [N.m]"])
    assert {"time", "q_a_1", "q_m_2", "u_c_1", "u_d_2", "F_x", "x", "tcp_error"} <= set(mat)


def test_a_plot_shows_errors_in_mm_and_torques(tmp_path):
    signals = trajectory(error_x=3e-3, torque=(1.0, 2.0), duration=1.0)
    figure = simulations.plot(signals, Scenario((), 1, 0.25e-3), "costs $5 and $6")
    tops = [[line.get_ydata().max() for line in axes.lines] for axes in figure.axes]
    assert tops[0][0] == pytest.approx(3.0) and tops[1] == [1.0, 2.0]
    simulations.write_plot(figure, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_what_cannot_be_written_is_an_error_of_this_machine(run, tmp_path):
    file = tmp_path / "a.txt"
    write_text(file, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(file, "new \udc00")
    assert file.read_text() == "old" and not list(tmp_path.glob("*.txt?*")), "a file is replaced whole"
    (tmp_path / "figures").write_text("in the way")
    error = refusal(write_figures, run, tmp_path / "figures")
    assert (error.what, error.where) == ("folder-not-writable", str(tmp_path / "figures"))
    (tmp_path / "figures").unlink()
    (tmp_path / "figures" / "figure_03_stiffness.pdf").mkdir(parents=True)
    assert refusal(write_figures, run, tmp_path / "figures", kind=EnvironmentFault).what == "not-written"


def test_what_was_made_of_other_results_is_removed(run):
    (run.folder / files.REPORT).write_text("the old one")
    (run.folder / files.FIGURES).mkdir()
    (run.folder / "cases.sqlite").write_text("stays")
    later = replaced(run.results.head, timing=replaced(run.results.timing, wall_time=1.0), command="again")
    Evaluation(replaced(run.results, head=later), RECORDINGS).save(run.folder)
    assert (run.folder / files.REPORT).exists()
    Evaluation(scaled(0.5)).save(run.folder)
    assert {file.name for file in run.folder.iterdir()} == {files.RESULTS, files.CASES, "cases.sqlite"}
