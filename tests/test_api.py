"""The library: what an evaluation and a simulation hold, equal to the last bit however they are run."""

import csv
import math
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as changed
from support.refusals import refusal

import orchestrator
from build_fmus import find_compiler
from orchestrator import Benchmark, Controller, Evaluation, InputError, Simulation, Variation, compare
from orchestrator.loop.trajectory import Status

ONE = "c00.compliant.noise"
SHORT = Variation(duration=Fraction(1, 10))


@pytest.fixture(scope="module")
def pid(quick_pid_file: Path) -> Controller:
    return Controller(quick_pid_file)


def evaluated(pid: Controller, bench: Benchmark | None = None, **options: object) -> Evaluation:
    """A single case."""
    return (bench or Benchmark()).evaluate(pid, **{"only": ONE, "recordings": False, **options})  # type: ignore[arg-type]


def test_importing_the_package_has_no_effect_and_loads_nothing(tmp_path: Path) -> None:
    program = """
import os, sys
before = set(sys.modules), dict(os.environ), sys.excepthook
import orchestrator
assert dict(os.environ) == before[1] and sys.excepthook is before[2] and not os.listdir()
heavy = {"numpy", "numba", "fmpy", "matplotlib", "scipy", "rich", "msgspec"} & (set(sys.modules) - before[0])
assert not heavy, heavy
assert all(getattr(orchestrator, name) is not None for name in orchestrator.__all__)
from orchestrator import Benchmark, Controller, Evaluation, Simulation, compare
assert "numba" not in sys.modules and "matplotlib" not in sys.modules and not os.listdir(os.environ["CACHE"])
"""
    folders = {name: tmp_path / name for name in ("cache", "empty")}
    for folder in folders.values():
        folder.mkdir()
    cache = str(folders["cache"])
    environment = {"FLEXIBLE_MANIPULATOR_CACHE": cache, "CACHE": cache, "PYTHONPATH": str(Path.cwd())}
    subprocess.run([sys.executable, "-c", program], cwd=folders["empty"], env=environment, check=True)


def test_an_evaluation_holds_the_scorecard(quick: Evaluation, pid_file: Path) -> None:
    assert quick.complete and quick.cost is not None
    assert list(quick.criteria) == [f"B{i}" for i in range(1, 8)] and list(quick.requirements) == ["A1", "A2", "A3"]
    shares = [criterion.weight * criterion.value / criterion.target for criterion in quick.criteria.values()]  # type: ignore[operator]
    assert quick.cost == pytest.approx(sum(shares))
    assert np.mean([configuration.cost for configuration in quick.configurations]) == pytest.approx(quick.cost)
    results = quick.results
    assert (results.protocol, results.seed, len(quick.cases)) == ("quick", 0, 24)
    assert results.controller.file == pid_file.name and results.controller.path == str(pid_file)
    assert results.head.environment["flexible_manipulator_benchmark"] == orchestrator.__version__
    assert (results.loop_delay.seconds, results.loop_delay.samples) == (0.00025, 1.0)
    computing = results.timing.computing_time
    assert computing is not None and computing.steps > 20
    assert 0.0 <= computing.median <= computing.percentile_99 <= computing.largest
    bound = results.controller.connectors["q_m"]
    assert bound is not None and (bound.variables, bound.found, bound.notes) == (("q_m[1]", "q_m[2]"), "exact", ())
    assert results.controller.connectors["e"] is None


def test_save_and_load(quick: Evaluation, pid: Controller, tmp_path: Path) -> None:
    loaded = Evaluation.load(quick.save(tmp_path))
    assert loaded.results == quick.results
    assert [each.about for each in loaded.recordings] == [each.about for each in quick.recordings]
    assert loaded.report(tmp_path / "report.html").stat().st_size > 100_000
    assert "<table" in loaded._repr_html_() and f"{quick.cost:.1f}" in loaded._repr_html_()
    assert f"V = {quick.cost:.1f}" in repr(loaded)
    table = loaded.to_pandas()
    rows = list(csv.DictReader((tmp_path / "cases.csv").open(encoding="utf-8")))
    assert len(rows) == len(table) == 24 and list(table.columns) == list(rows[0])


@pytest.mark.parametrize("workers", [1, 3])
def test_bit_identical_for_any_number_of_processes(quick: Evaluation, pid_file: Path, workers: int) -> None:
    bench, some = Benchmark("quick", workers=workers), ["*.noise", "c00.*.delay_1"]
    again = bench.evaluate(Controller(pid_file), only=some, recordings=False).cases
    assert len(again) == 5 and again == tuple(quick.results.case(case.id) for case in again)


def test_finished_cases_are_found_again(pid: Controller, tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    two = {"only": ["c0[01].compliant.noise"], "folder": tmp_path}
    for _ in range(2):
        evaluation = evaluated(pid, **two, on_result=lambda result, *counts: told.append((result.id, *counts)))
        assert not evaluation.complete and evaluation.cost is None
    ids = [case.id for case in evaluation.cases]
    assert sorted(told[:2]) == [(ids[0], told[0][1], 2), (ids[1], told[1][1], 2)]
    assert told[2:] == [(ids[0], 1, 2), (ids[1], 2, 2)]
    assert Evaluation.load(tmp_path).cases == evaluation.cases


def test_the_seed_and_all_parameters_count(pid: Controller, quick_pid_file: Path, tmp_path: Path) -> None:
    def torque(evaluation: Evaluation) -> float:
        value = evaluation.criteria["B1"].value
        assert value is not None
        return value

    random = {"only": "c00.random_1.noise"}
    first, second, again = (torque(evaluated(pid, Benchmark(seed=seed), **random)) for seed in (0, 1, 1))
    assert first != second == again
    (tmp_path / "gains.toml").write_text("[parameters]\nK_d = [3.0, 0.5]\n")
    tuned = evaluated(Controller(quick_pid_file, parameters=tmp_path / "gains.toml"))
    assert tuned.results.controller.parameters == {"K_d[1]": 3.0, "K_d[2]": 0.5}
    assert torque(tuned) > 1.5 * torque(evaluated(pid))
    changed = evaluated(pid, Benchmark(plant_parameters={"k_high[2]": 5e5})).results.plant
    assert changed.parameters == {"k_high[2]": 5e5} and changed.nominal["k_high[2]"] == 5e5


def test_the_default_controller_is_the_papers_pid_and_another_sample_time_is_marked() -> None:
    results = evaluated(Controller(sample_time="0.0005")).results
    assert results.controller.file == ("DiagonalPID_C.fmu" if find_compiler() else "DiagonalPID.fmu")
    assert results.controller.generation_tool
    assert (results.sample_time.seconds, results.sample_time.as_in_benchmark) == (0.0005, False)


def test_a_case_of_the_protocol_has_its_figures(pid_file: Path, quick: Evaluation, tmp_path: Path) -> None:
    simulation = Benchmark("quick").simulate(Controller(pid_file), ONE)
    assert simulation.result == quick.results.case(ONE)
    assert simulation.time.shape == (8001,) and simulation.X.shape == (8001, 2) and simulation.torque.shape == (8000, 2)
    assert simulation.q_a.shape == simulation.q_m.shape == (8001, 2) and simulation.tcp_error.shape == (8001,)
    assert len(simulation.to_pandas()) == 8001
    loaded = Simulation.load(simulation.save(tmp_path / "case.sim"))
    assert np.array_equal(loaded.torque, simulation.torque) and loaded.result == simulation.result
    assert "image/png" in loaded._repr_html_() and len(loaded._repr_html_()) < 150_000 and "done at 2 s" in repr(loaded)


def test_a_loop_that_does_not_come_to_rest_is_told_as_unstable(pid_file: Path) -> None:
    """Its simulation comes to its end, and the judgement says what that end is, as in the results of an evaluation."""
    simulation = Benchmark().simulate(Controller(pid_file), "c00.slippery.delay_2")
    assert simulation.ending.status is Status.DONE and simulation.result.status is Status.UNSTABLE
    told = f"unstable at {simulation.ending.time:g} s: {simulation.result.message}"
    assert simulation.summary().kicker == told and "unstable at" in repr(simulation)


def test_a_varied_case_is_judged_as_far_as_it_can_be(pid: Controller) -> None:
    bench = Benchmark()
    still = replace(SHORT, ideal=True, undisturbed=True)
    calm = bench.simulate(pid, bench.varied(bench.case("c07.compliant.disturbance"), still))
    assert calm.varied and calm.kind == "no verdict" and calm.tcp_error.max() < 1e-9
    assert calm.result.measurements.names == {"B3", "B4"} and calm.cut_short

    def columns(variation: Variation, **case: str) -> Mapping[str, np.ndarray]:
        return bench.simulate(pid, bench.case_at((0.3, -0.9), variation=variation, **case)).columns()

    pushed = columns(replace(still, force=500.0, t_1=0.01, t_2=0.02))
    assert np.hypot(pushed["F_x [N]"], pushed["F_z [N]"]).max() == pytest.approx(500)
    assert pushed["tcp_error [m]"].max() > 1e-4
    limited = columns(replace(still, torque_limit=(5.0, 3.0)))
    assert [np.nanmax(np.abs(limited[f"u_m[{i}] [N.m]"])) for i in (1, 2)] == pytest.approx([5, 3])
    # A test without disturbances can be given some: the protocol's fixed ones, unless something else is said.
    given = Variation(chirp_amplitude=(1.0, -1.0), t_4=0.6, force=500.0, t_1=0.1, t_2=0.2, duration=Fraction(7, 10))
    noise = columns(given, test="noise")
    assert noise["u_d[1] [N.m]"].max() > 0.9 and noise["u_d[2] [N.m]"].min() < -0.9
    at = np.argmax(np.abs(noise["F_x [N]"]))
    assert math.atan2(noise["F_z [N]"][at], noise["F_x [N]"][at]) == pytest.approx(0.7)


def test_pose_system_and_plant_are_chosen(pid: Controller) -> None:
    bench = Benchmark(plant_parameters={"psi[2]": 1e-3})
    pose = (math.radians(45), math.radians(-60))
    simulation = bench.simulate(pid, bench.case_at(pose, "random_3", variation=SHORT))
    assert simulation.q_a[0] == pytest.approx(pose) and simulation.case.id == "free.random_3.disturbance"
    assert dict(simulation.case.scenario.parameters)["psi[2]"] != 1e-3  # drawn around the new nominal value
    assert bench.nominal["psi[2]"] == 1e-3


def test_compare_ranks_what_is_comparable(quick: Evaluation, pid: Controller) -> None:
    head = changed(quick.head, controller=changed(quick.head.controller, file="Other.fmu"))
    other = replace(quick, results=changed(quick.results, head=head))
    groups = compare([quick, other, evaluated(pid)])
    assert [[entry.name.split()[0] for entry in group.ranked] for group in groups] == [["DiagonalPID", "Other"], []]
    assert len(groups[1].unranked) == 1 and "protocol" in groups[1].difference


@pytest.mark.parametrize(
    ("use", "what"),
    [
        (lambda pid: Benchmark("papper"), "no-protocol"),
        (lambda pid: Benchmark(seed=-1), "bad-number"),
        (lambda pid: Benchmark(plant_parameters={"q_a_start[1]": 1.0}), "no-plant-parameter"),
        (lambda pid: Benchmark(plant_parameters={"m[1]": -1.0}), "bad-plant-parameter"),
        (lambda pid: Benchmark(plant_parameters={"d[1]": 1e12}).nominal, "bad-plant-parameter"),
        (lambda pid: Benchmark(plant_parameters={"psi[1]": 1e-300}).nominal, "bad-plant-parameter"),
        (lambda pid: Controller(parameters={"K_p[1]": math.nan}), "not-finite"),
        (lambda pid: Controller(sample_time="soon"), "bad-time"),
        (lambda pid: Benchmark().evaluate(pid, only="c99.*"), "no-case"),
        (lambda pid: Benchmark().case("c01.random_0.noise"), "no-system"),
        (lambda pid: Benchmark().case_at((0.0, 3.5)), "outside-workspace"),
        (lambda pid: Evaluation.load("nowhere"), "no-run"),
        (lambda pid: Simulation.load("nowhere"), "no-file"),
        (lambda pid: Benchmark().check(3), "no-controller"),
        (lambda pid: Benchmark("quick").evaluate("nowhere.fmu"), "no-file"),
    ],
)
def test_what_cannot_be_used_is_an_input_error(use, what: str, pid: Controller) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError) as refused:
        use(pid)
    assert refused.value.what == what


def test_a_report_overwrites_nothing_but_reports(tmp_path):
    """Benchmark.report("plain.fmu") left a page in the place of the controller."""
    bench, fmu, own, page = Benchmark("quick"), tmp_path / "plain.fmu", tmp_path / "own.html", tmp_path / "page.html"
    fmu.write_bytes(b"PK")
    own.write_text("<!DOCTYPE html><html>mine</html>")
    assert [refusal(bench.report, file).what for file in (fmu, own, tmp_path / "report")] == ["no-report-file"] * 3
    assert fmu.read_bytes() == b"PK" and "mine" in own.read_text()
    assert bench.report(page) == page == bench.report(page)
    assert refusal(bench.export_ssp, None, "c00.compliant.noise", fmu).what == "bad-file-name"
