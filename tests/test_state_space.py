"""Controllers of matrices: the recursion of the documentation, whatever the system came from."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from numpy.testing import assert_allclose
from scipy import signal
from scipy.io import savemat
from support.command_lines import call
from support.pid_fmus import T_S, Signals, in_child, live
from support.refusals import refusal
from support.stub_fmus import strict_compiler
from support.tools import PRESENT, require

from controller_fmu import controller_from_mlp, controller_from_state_space, errors
from controller_fmu.export import systems

RANDOM = np.random.default_rng(7)
STATES, LIMIT = 5, (1.0, 0.6)
POINTS = np.array([(0.0, 0.0), (200.0, 0.0), (0.0, 200.0), (200.0, 220.0)])
A = RANDOM.normal(size=(4, STATES, STATES))
A *= 0.95 / np.abs(np.linalg.eigvals(A)).max(axis=1)[:, None, None]
B, C, D, BACK = (0.5 * RANDOM.normal(size=(4, *shape)) for shape in ((STATES, 2), (2, STATES), (2, 2), (STATES, 2)))
MIDDLE = (50.0, 20.0)
"""Of the triangle of the first three points."""


def torques(A, B, C, D, back, signals):
    """The recursion of the documentation."""
    x, found = np.zeros(len(A)), []
    for q_m_ref, q_m in zip(signals.q_m_ref, signals.q_m, strict=True):
        e = q_m_ref - q_m
        wanted = signals.u_m0 + C @ x + D @ e
        found.append(np.clip(wanted, -np.array(LIMIT), LIMIT))
        x = A @ x + B @ e + back @ (found[-1] - wanted)
    return np.array(found)


@pytest.mark.needs("compiler")
@pytest.mark.parametrize(("interpolation", "weights"), [("nearest", (1, 0, 0, 0)), ("linear", (0.65, 0.25, 0.1, 0))])
def test_torques_are_those_of_the_recursion(interpolation, weights, tmp_path, monkeypatch):
    """Limited, scheduled, from the start and from restored states; longer steps are refused.

    Up to rounding: NumPy adds the products in another order than the FMU. A torque is of the size 1 and the states
    forget within a hundred samples, so that a thousand roundings of 1e-16 remain below the tolerance.
    """
    monkeypatch.setenv("CC", strict_compiler())
    file = controller_from_state_space(
        *(A, B, C, D, T_S),
        out=tmp_path / "scheduled.fmu",
        points=POINTS,
        interpolation=interpolation,
        anti_windup=BACK,
        torque_limit=LIMIT,
    )
    assert validate_fmu(str(file)) == []
    e = np.random.default_rng(1).normal(size=(100, 2))
    signals = Signals(np.tile(MIDDLE, (100, 1)), np.array(MIDDLE) - e, (0.7, -0.3))
    expected = torques(*(np.tensordot(weights, matrices, 1) for matrices in (A, B, C, D, BACK)), signals)
    assert 10 < np.sum(np.abs(expected) == LIMIT) < 190, "in and out of the limits"
    life = in_child(live, file, signals, MIDDLE, [1.5 * T_S, 2.0 * T_S], [])
    assert life["initial"] == signals.u_m0 and life["failed"] == ["fmi2DoStep"] * 2
    assert "step of 0.000375" in life["log"]
    assert len(life["runs"]) == 5
    for run in life["runs"]:
        assert_allclose(run, expected, rtol=0.0, atol=1e-12)


def beyond(path):
    """Torques per unit of error at references beyond the points."""
    from support.pid_fmus import slave

    found = []
    for q in ((-300.0, -300.0), (100.0, -50.0)):
        with slave(path) as one:
            one.initialize(q, (0.0, 0.0))
            found.append(one.run([(*q, q[0] - 1.0, q[1])])[0])
    return found


@pytest.mark.needs("compiler")
def test_a_schedule_holds_its_border_beyond_the_points(tmp_path):
    gains = np.zeros((4, 2, 2))
    gains[:, 0, 0] = (1.0, 2.0, 3.0, 4.0)
    empty = np.zeros((4, 0, 0)), np.zeros((4, 0, 2)), np.zeros((4, 2, 0))
    out, how = tmp_path / "gains.fmu", {"points": POINTS, "interpolation": "linear"}
    file = controller_from_state_space(*empty, gains, T_S, out=out, **how)
    corner, edge = in_child(beyond, file)
    assert corner == (1.0, 0.0)
    assert edge == (pytest.approx(0.6 * 1.0 + 0.4 * 2.0), 0.0)  # weights 0.75, 0.5, -0.25


ONE = tuple(matrices[0] for matrices in (A, B, C, D))
SYSTEMS = {
    "matrices": lambda folder: (*ONE, T_S),
    "scipy": lambda folder: (signal.StateSpace(*ONE, dt=T_S),),
    "npz": lambda folder: (saved(folder / "one.npz", lambda file: np.savez(file, **NAMED)),),
    "mat": lambda folder: (saved(folder / "one.mat", lambda file: savemat(file, NAMED)),),
    "json": lambda folder: (saved(folder / "one.json", lambda file: file.write_text(json.dumps(LISTED))),),
    "control": lambda folder: (of_python_control(),),
}
NAMED = {**dict(zip("ABCD", ONE, strict=True)), "T_s": T_S}
NETWORK = {"W1": np.ones((2, 8)), "b1": np.ones(2), "activation": "tanh"}
LISTED = {name: np.array(value).tolist() for name, value in NAMED.items()}


def of_python_control():
    require("control")
    import control

    return control.ss(*ONE, T_S)


def saved(file, write):
    write(file)
    return file


def law(system, *others, method=None):
    """What a system comes to, as the builder reads it."""
    given = systems.contents(system) if isinstance(system, Path) else system
    B, C, D, T_s = others or (None,) * 4
    return systems.stacked(given, B, C, D, T_s, method)


@pytest.mark.parametrize("kind", SYSTEMS)
def test_systems_of_every_kind_are_the_same(kind, tmp_path):
    found = law(*SYSTEMS[kind](tmp_path))
    assert found.T_s == T_S
    for matrix, expected in zip(found[:4], ONE, strict=True):
        np.testing.assert_array_equal(matrix, expected[None])


def test_schedules_come_as_lists_of_systems_and_as_files(tmp_path):
    several = [signal.StateSpace(*(matrix[i] for matrix in (A, B, C, D)), dt=T_S) for i in range(4)]
    stacked = {name: np.moveaxis(matrix, 0, -1) for name, matrix in zip("ABCD", (A, B, C, D), strict=True)}
    file = saved(tmp_path / "all.mat", lambda file: savemat(file, {**stacked, "Ts": T_S, "points": POINTS}))
    for found in (law(several), law(file)):
        for matrix, expected in zip(found[:4], (A, B, C, D), strict=True):
            np.testing.assert_array_equal(matrix, expected)
    if PRESENT["compiler"]:
        how = {"points": POINTS, "interpolation": "linear"}
        built = [
            controller_from_state_space(*system, out=tmp_path / "all.fmu", **how).read_bytes()
            for system in ((several,), (file,), (A, B, C, D, T_S))
        ]
        assert built[0] == built[1] == built[2]


def test_continuous_systems_are_sampled_as_asked():
    integrator = np.diag([-2.0, 0.0]), np.eye(2), np.eye(2), np.zeros((2, 2))
    held, tustin = (law(*integrator, 0.1, method=method) for method in ("zoh", "tustin"))
    assert_allclose(held.A[0], np.diag([np.exp(-0.2), 1.0]), rtol=1e-14)
    assert_allclose(held.B[0], np.diag([(1 - np.exp(-0.2)) / 2, 0.1]), rtol=1e-14)
    z = np.exp(0.3j)
    for axis, pole in enumerate((-2.0, 0.0)):
        response = tustin.C[0] @ np.linalg.solve(z * np.eye(2) - tustin.A[0], tustin.B[0]) + tustin.D[0]
        assert response[axis, axis] == pytest.approx(1.0 / (20.0 * (z - 1) / (z + 1) - pole), rel=1e-12)


REFUSED = {
    "unstable": (lambda: ((1.1 * A[0] / 0.95, *ONE[1:], T_S), {}), errors.UnstableError, "1.1"),
    "inputs": (lambda: ((ONE[0], ONE[1][:, :1], *ONE[2:], T_S), {}), errors.ShapeError, "B"),
    "points": (lambda: ((A, B, C[:2], D, T_S), {}), errors.ShapeError, "C"),
    "nan": (lambda: ((*ONE[:3], np.full((2, 2), np.nan), T_S), {}), errors.ShapeError, "D"),
    "words": (lambda: (("no.mat",), {}), errors.SystemFileError, ""),
    "complex": (lambda: ((*ONE[:3], 1j * ONE[3], T_S), {}), errors.ShapeError, "D"),
    "nothing": (lambda: ((1.0, 2.0, 3.0, 4.0, T_S), {}), errors.ShapeError, "A"),
    "dictionary": (lambda: ((3.0,), {}), errors.ShapeError, ""),
    "no T_s": (lambda: (ONE, {}), errors.SampleTimeError, "None"),
    "continuous": (lambda: ((signal.StateSpace(*ONE), None, None, None, T_S), {}), errors.SampleTimeError, ""),
    "sampled": (lambda: ((signal.StateSpace(*ONE, dt=T_S),), {"method": "zoh"}), errors.SampleTimeError, "zoh"),
    "method": (lambda: ((*ONE, T_S), {"method": "euler"}), errors.SampleTimeError, "euler"),
    "other T_s": (
        lambda: ((signal.StateSpace(*ONE, dt=T_S), None, None, None, 0.001), {}),
        errors.SampleTimeError,
        "0.001",
    ),
    "no points": (lambda: ((A, B, C, D, T_S), {}), errors.ScheduleError, "points"),
    "a line": (
        lambda: ((A, B, C, D, T_S), {"points": [(i, i) for i in range(4)], "interpolation": "linear"}),
        errors.ScheduleError,
        "points",
    ),
    "cubic": (lambda: ((*ONE, T_S), {"interpolation": "cubic"}), errors.ScheduleError, "cubic"),
    "back": (lambda: ((*ONE, T_S), {"anti_windup": np.eye(2)}), errors.ShapeError, "anti_windup"),
    "one point": (lambda: ((A, B, C, D, T_S), {"points": POINTS[0]}), errors.ShapeError, "points"),
    "folder": (lambda: ((*ONE, T_S), {"out": "nowhere/x.fmu"}), errors.TargetError, "nowhere"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make, kind, value = REFUSED[name]
    arguments, how = make()
    error = refusal(controller_from_state_space, *arguments, kind=kind, **{"out": "x.fmu", **how})
    assert error.value == value and not list(tmp_path.iterdir())


def test_a_mat_file_that_ends_its_reader_is_refused(tmp_path, monkeypatch):
    """SciPy dies of a segmentation fault at some damaged files; here the reader does at any."""
    savemat(tmp_path / "gains.mat", NAMED)
    monkeypatch.setattr(systems, "_READER", "import os\nos.kill(os.getpid(), 11)")
    with pytest.raises(errors.SystemFileError, match="the file is damaged"):
        systems.contents(tmp_path / "gains.mat")


@pytest.mark.parametrize("kind", ["statespace", "mlp"])
def test_without_a_compiler_the_command_names_the_remedy(kind, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "ziglang", None)
    np.savez(tmp_path / "gains.npz", **(NAMED if kind == "statespace" else NETWORK))
    finished = call("new", kind, "gains.npz", "--out", "my.fmu", folder=tmp_path)
    assert (finished.code, finished.out) == (1, "") and finished.err.count("\n") == 1
    assert "no C compiler" in finished.err and "pip install 'flexible-manipulator-benchmark[native]'" in finished.err
    assert [file.name for file in tmp_path.iterdir()] == ["gains.npz"]
    assert call("new", "statespace", "gains.npz", "--out", "my.fmu", "--method", "zoh", folder=tmp_path).code == 2


@pytest.mark.needs("compiler")
def test_a_controller_that_is_unstable_by_itself_may_be_insisted_on(tmp_path):
    matrices = dict(zip("ABCD", (1.00015 * np.eye(2), np.eye(2), np.eye(2), np.eye(2)), strict=True))
    savemat(tmp_path / "gains.mat", matrices | {"T_s": T_S})
    refused = call("new", "statespace", "gains.mat", "--out", "mine.fmu", folder=tmp_path)
    assert refused.code == 2 and "unstable" in refused.err and "--unstable" in refused.err
    assert call("new", "statespace", "gains.mat", "--out", "mine.fmu", "--unstable", folder=tmp_path).code == 0


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ({"A": [[1.0, 2.0], [3.0]]}, errors.ShapeError),
        ({"T_s": "a"}, errors.SampleTimeError),
        ({"out": None}, errors.TargetError),
    ],
)
def test_what_is_no_system_sample_time_or_path_is_one_sentence(given, kind, tmp_path):
    usual = {"A": np.zeros((2, 2)), "B": np.eye(2), "C": np.eye(2), "T_s": T_S, "out": tmp_path / "x.fmu"}
    assert "\n" not in str(refusal(controller_from_state_space, **{**usual, **given}, kind=kind))
    assert refusal(controller_from_mlp, None, out=tmp_path / "x.fmu", kind=errors.NetworkError).where
