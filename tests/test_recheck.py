"""The second checker: its own physics against laws, and the faults that it has to find in a recorded case."""

import io
import json
import math
import zipfile
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orchestrator import Benchmark, Controller, Variation
from orchestrator.documents import case_file
from orchestrator.recheck import Unreadable, recheck
from orchestrator.recheck.__main__ import main
from orchestrator.recheck.equations import arm, friction, rates, rest, spring, tool
from orchestrator.recheck.signals import delayed, rounded
from plant_fmu.flexible_manipulator.parameters import NOMINAL

SMOOTH = {f"{name}[{axis}]": 0.0 for name in ("d", "f_d", "f_c") for axis in (1, 2)}
NOTHING = np.zeros((2, 1))


def energy(own, state):
    """Of motion, height and gears, by the bodies' positions alone: none of the formulas that are tested."""
    q_m, q_a, dq_m, dq_a = (state[rows] for rows in (slice(0, 2), slice(2, 4), slice(4, 6), slice(6, 8)))
    one, two = own.axes

    def centre(q, first, second):
        return np.array(
            [
                first * math.sin(q[0]) + second * math.cos(q[0] + q[1]),
                first * math.cos(q[0]) - second * math.sin(q[0] + q[1]),
            ]
        )

    total = 0.0
    for axis, first, second in ((one, one.xi, 0.0), (two, one.l, two.xi)):
        step = 1e-6
        ends = (centre(q_a + sign * step * dq_a, first, second) for sign in (1.0, -1.0))
        speed = np.subtract(*ends) / (2.0 * step)
        total += 0.5 * axis.m * speed @ speed + axis.m * own.g * centre(q_a, first, second)[1]
    total += 0.5 * one.j * dq_a[0] ** 2 + 0.5 * two.j * (dq_a[0] + dq_a[1]) ** 2
    for i, axis in enumerate(own.axes):
        total += 0.5 * axis.j_m * dq_m[i] ** 2
        twists = np.linspace(0.0, q_a[i] - q_m[i] / axis.n, 4001)
        total += np.trapezoid(spring(axis, twists), twists)
    return total


def test_without_friction_and_damping_energy_is_kept():
    own = arm({**NOMINAL, **SMOOTH})
    state = np.array([30.0, -40.0, 0.151, -0.198, 20.0, -15.0, 0.3, -0.2])
    found = solve_ivp(
        lambda _, y: rates(own, y[:, None], NOTHING, NOTHING, NOTHING)[:, 0], (0.0, 0.3), state, rtol=1e-11, atol=1e-11
    )
    energies = [energy(own, column) for column in found.y.T]
    assert np.ptp(energies) < 1e-6 * 0.5 * sum(axis.j_m * 20.0**2 for axis in own.axes)


def test_the_arm_rests_where_it_should_and_the_tool_is_pushed_by_its_jacobian():
    own, q_a = arm(NOMINAL), np.array([0.4, -1.1])
    q_m, u_m = rest(own, q_a)
    state = np.concatenate([q_m, q_a, np.zeros(4)])[:, None]
    assert np.abs(rates(own, state, u_m[:, None], NOTHING, NOTHING)).max() < 1e-9
    push = np.array([[30.0], [-20.0]])
    moved = rates(own, state, u_m[:, None], NOTHING, push)[6:8, 0]
    steps = [(tool(own, q_a + 1e-6 * unit) - tool(own, q_a - 1e-6 * unit)) / 2e-6 for unit in np.eye(2)]
    load = np.array(steps) @ push[:, 0]
    responses = [(rates(own, state, u_m[:, None], NOTHING, p[:, None])[6:8, 0]) for p in np.eye(2)]
    inverse = np.array(responses).T @ np.linalg.inv(np.array(steps))
    np.testing.assert_allclose(moved, inverse @ load, rtol=1e-6)
    np.testing.assert_allclose(inverse, inverse.T, rtol=1e-6)  # of a symmetric inertia


def test_friction_and_gear_are_those_of_the_paper():
    axis = arm(NOMINAL).axes[0]
    speeds = np.array([-3.0, 0.0, 0.2, 5.0])
    slow = axis.mu_k + (1.0 - axis.mu_k) / np.cosh(axis.beta * speeds)
    np.testing.assert_allclose(
        friction(axis, speeds), axis.f_d * speeds + axis.f_c * slow * np.tanh(axis.alpha * speeds)
    )
    inside, outside = 0.5 * axis.psi, 2.0 * axis.psi
    k_3 = (axis.k_high - axis.k_low) / (3.0 * axis.psi**2)
    assert spring(axis, np.array(inside)) == pytest.approx(axis.k_low * inside + k_3 * inside**3)
    begin = axis.k_low * axis.psi + k_3 * axis.psi**3
    assert spring(axis, np.array(-outside)) == pytest.approx(-begin - axis.k_high * axis.psi)


def test_signals_are_rounded_limited_and_delayed():
    assert rounded(np.array([0.26, -0.26, 0.24]), 0.5).tolist() == [0.5, -0.5, 0.0]
    later = delayed(np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]), (1, 2), np.array([-1.0, -2.0]))
    assert later.tolist() == [[-1.0, -2.0], [1.0, -2.0], [3.0, 2.0]]


@pytest.fixture(scope="session")
def recorded(pid_c_file):
    """Bytes of a case that has been recorded, cut after the force: 11 s."""
    bench = Benchmark("strict")
    case = bench.varied(bench.case("c07.compliant.disturbance_0"), Variation(duration=Fraction(11)))
    found = bench.simulate(Controller(pid_c_file), case)
    return case_file.packed(bench.rules, case, found.controller, bench.nominal, found.trajectory, found.result)


def changed(content, arrays=(), **about):
    """A recorded case with other numbers: ``about`` are paths into its description."""
    with np.load(io.BytesIO(content)) as file:
        known = {name: file[name] for name in file.files}
    told = json.loads(str(known.pop("about")))
    for path, value in about.items():
        *inner, last = path.split("__")
        place = told
        for name in inner:
            place = place[name]
        place[last] = value(place[last]) if callable(value) else value
    known |= {name: change(known[name].copy()) for name, change in dict(arrays).items()}
    with io.BytesIO() as stream:
        np.savez(stream, about=np.array(json.dumps(told)), **known)
        return stream.getvalue()


def parameter(content, name, factor):
    """Another value of a parameter, in both places where a file has it."""

    def scaled(pairs):
        return [[key, value * factor if key == name else value] for key, value in pairs]

    with np.load(io.BytesIO(content)) as file:
        value = json.loads(str(file["about"]))["parameters"][name]
    return changed(content, parameters=lambda all: {**all, name: value * factor}, scenario__parameters=scaled)


@pytest.mark.slow
@pytest.mark.needs("compiler")
def test_an_honest_case_is_found_right(recorded, tmp_path, capsys):
    found = recheck(recorded)
    assert found.ok, found.to_dict()
    assert {"given angles, axis 1", "torques, axis 2", "TCP, median of segments", "B5"} <= {
        row.name for row in found.rows
    }
    (tmp_path / "case.npz").write_bytes(recorded)
    assert main([str(tmp_path / "case.npz"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["ok"] is True


@pytest.mark.slow
@pytest.mark.needs("compiler")
def test_a_limit_cycle_is_judged_as_the_file_says(recorded):
    """Files of versions up to 3 have the larger of both coordinates, and do not say so."""
    with np.load(io.BytesIO(recorded)) as file:
        about, X = json.loads(str(file["about"])), file["X"]
    count = round(float(Fraction(about["scenario"]["duration"])) * 4000) + 1
    window = X[:count][-(round(about["definitions"]["limit_cycle_window"] * 4000) + 1) :]
    earlier = {name: value for name, value in about["definitions"].items() if name != "limit_cycle_directions"}
    larger = 0.5 * float(np.ptp(window, axis=0).max())
    assert recheck(changed(recorded, definitions=earlier, claimed__limit_cycle_at_end=larger)).ok
    assert not recheck(changed(recorded, claimed__limit_cycle_at_end=larger)).ok


def one_more(column, quantum, begin):
    def change(array):
        array[begin:, column] += quantum
        return array

    return change


def later(pulse):
    return {**pulse, "start": pulse["start"] + 0.005, "stop": pulse["stop"] + 0.005}


LSB = 2.0 * math.pi / 2**16

FAULTS = {
    "one quantizer step more": (lambda c: changed(c, {"given": one_more(0, LSB, 9000)}), "given angles, axis 1"),
    "a torque of one step more": (
        lambda c: changed(c, {"torque": one_more(1, 40.0 / 4096, 43_999)}),
        "torques, axis 2",
    ),
    "one sample less delay": (
        lambda c: changed(c, scenario__drive__delay=["1/2000", "1/2000"]),
        "motor angles, median of segments",
    ),
    "another torque limit": (lambda c: changed(c, scenario__drive__limit=[0.5, 20.0]), "torques, axis 1"),
    "2 % less friction": (lambda c: parameter(c, "f_c[1]", 1.0 / 1.02), "motor angles, median of segments"),
    "1 % less gravity": (lambda c: parameter(c, "g", 0.99), "link angles, median of segments"),
    "the force 5 ms later": (lambda c: changed(c, scenario__pulse=later), "link angles, largest"),
    "another figure": (lambda c: changed(c, claimed__B5=lambda value: 1.000001 * value), "B5"),
    "a figure that it does not have": (lambda c: changed(c, claimed__B8=1.0), "B8"),
    "no figures": (lambda c: changed(c, claimed={}, status="done"), "figures of a case that is done"),
    "much noise": (lambda c: changed(c, {"noise": lambda n: 9.0 * n}), "noise, in standard deviations"),
    "a TCP that stands still": (
        lambda c: changed(c, {"X": lambda X: np.repeat(X[:1], len(X), axis=0)}),
        "TCP, median of segments",
    ),
    "angles that stand still": (
        lambda c: changed(c, {"q_m": lambda q: np.where(np.arange(len(q))[:, None] > 41_000, q[41_000], q)}),
        "motor speeds between segments, largest",
    ),
}


@pytest.mark.slow
@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found(name, recorded, tmp_path):
    plant, row = FAULTS[name]
    found = recheck(plant(recorded))
    assert row in {each.name for each in found.rows if not each.ok}, found.to_dict()


@pytest.mark.slow
@pytest.mark.needs("compiler")
def test_what_is_no_case_is_refused_with_a_sentence(recorded, tmp_path, capsys):
    claiming = io.BytesIO()
    with zipfile.ZipFile(claiming, "w") as archive, archive.open("about.npy", "w") as entry:
        np.lib.format.write_array_header_1_0(entry, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)})
    pickled = io.BytesIO()
    np.savez(pickled, about=np.array([object()], dtype=object))
    bad = {
        "nothing": b"",
        "cut": recorded[:5000],
        "pickle": pickled.getvalue(),
        "more numbers than there is memory": claiming.getvalue(),
        "schema": changed(recorded, schema="other"),
        "number": changed(recorded, {"X": lambda X: np.where(np.arange(len(X))[:, None] == 7, np.nan, X)}),
        "shape": changed(recorded, {"given": lambda given: given[:-1]}),
        "delay": changed(recorded, scenario__drive__delay=["1/3000", "1/4000"]),
        "dropped samples": changed(recorded, scenario__drive__dropout=0.1),
        "jitter": changed(recorded, scenario__sensor__jitter="1/8000"),
        "parameters": changed(recorded, parameters=lambda all: {**all, "g": 1.0}),
        "missing": changed(recorded, definitions={}),
        "to 1000 directions": changed(recorded, definitions={"limit_cycle_directions": 1e9}),
    }
    for name, content in bad.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(Unreadable):
            recheck(content)
        assert main([str(tmp_path / name)]) == 2, name
        assert capsys.readouterr().err.startswith("error: ")
    assert main([str(tmp_path / "none.npz")]) == 2
