"""Python FMUs share one interpreter; their modules must not mix, whatever they are called."""

from __future__ import annotations

import functools
from fractions import Fraction

import numpy as np
import pytest
from closed_loops import T_S, quiet, simulate_all
from python_controllers import python_controller

from orchestrator.cosim.archive import open_archive
from orchestrator.cosim.controller import Setup, Steady, prepared
from orchestrator.cosim.port import WARNING, exchange
from orchestrator.cosim.slaves import load
from orchestrator.execution import isolation
from orchestrator.execution.job import Finished, Job

STEADY = Steady((0.4, -1.1), (9.0, -6.0), (0.3, -0.9))
GAINS = (10.0, -3.0)

HELPER = "def scaled(slave):\n    slave.own['K'] = {gain}\n    slave.law()\n    return True\n"


@pytest.fixture(scope="module")
def twins(tmp_path_factory):
    """Two FMUs whose module, class, helper module and variables have equal names, but not their gains."""
    folder = tmp_path_factory.mktemp("twins")
    return [
        python_controller(
            folder,
            "Twin",
            imports="import twin_helper",
            step_body="return twin_helper.scaled(self)",
            modules={"twin_helper": HELPER.format(gain=gain)},
            target=folder / f"twin_{number}.fmu",
        )
        for number, gain in enumerate(GAINS)
    ]


@pytest.fixture(scope="module")
def lazy_twins(tmp_path_factory):
    """The same, but they import their helper in the first step only."""
    folder = tmp_path_factory.mktemp("lazy_twins")
    return [
        python_controller(
            folder,
            "Twin",
            step_body="import twin_helper; return twin_helper.scaled(self)",
            modules={"twin_helper": HELPER.format(gain=gain)},
            target=folder / f"twin_{number}.fmu",
        )
        for number, gain in enumerate(GAINS)
    ]


def answer(port, k):
    """The torques of step ``k`` for motor angles 1 rad below the reference."""
    port.input_values[:] = np.array(STEADY.q_m_ref) - 1.0
    assert exchange(port, 2, k * float(T_S), float(T_S), True)[1] <= WARNING
    return tuple(port.output_values)


def side_by_side(files, plant, first, task):
    """Torques of two controllers in one process, alive at once, stepped in turn."""
    second = load(open_archive(files[1]))
    with (
        prepared(first, Setup(), STEADY, T_S, 1.0) as one,
        prepared(second, Setup(), STEADY, T_S, 1.0) as two,
    ):
        return [(answer(one, k), answer(two, k)) for k in range(3)]


def one_after_the_other(files, plant, first, task):
    """Torques of two controllers in one process, one simulation after the other, several times."""
    slaves = [first, load(open_archive(files[1]))]
    answers = []
    for _ in range(2):
        for slave in slaves:
            with prepared(slave, Setup(), STEADY, T_S, 1.0) as port:
                answers.append(answer(port, 0))
    return answers


def in_child(work, plant, files):
    job = Job(open_archive(plant), open_archive(files[0]), (0,), functools.partial(work, files), (60.0,))
    (outcome,) = isolation.run_isolated(job)
    assert isinstance(outcome, Finished), outcome
    return outcome.value


EXPECTED = [tuple(u + gain for u in STEADY.u_m0) for gain in GAINS]


def test_two_alive_at_once_keep_their_code(plant_file, twins):
    assert np.allclose(in_child(side_by_side, plant_file, twins), [EXPECTED] * 3, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ["twins", "lazy_twins"])
def test_two_in_turn_keep_their_code(kind, plant_file, request):
    found = in_child(one_after_the_other, plant_file, request.getfixturevalue(kind))
    assert np.allclose(found, EXPECTED * 2, rtol=0, atol=1e-12)


IMPOSTOR = "STOLEN = True\n"


@pytest.mark.parametrize("name", ["Flexible_Manipulator", "Manipulator_FMU"])
@pytest.mark.parametrize("lazily", [False, True])
def test_modules_named_like_the_plants(name, lazily, plant_file, tmp_path):
    """A controller whose own module is called like the plant's package or script, and one more like its kernel."""
    controller = python_controller(
        tmp_path,
        name,
        gain=40.0,
        imports="" if lazily else "import integrator, dynamics",
        step_body=("import integrator, dynamics; " if lazily else "")
        + "assert dynamics.STOLEN; self.law(); return True",
        modules={"integrator": IMPOSTOR, "dynamics": IMPOSTOR},
    )
    other = python_controller(tmp_path, "Unmistakable", gain=40.0)
    scenario = quiet(Fraction(1, 20))
    (found,), (expected,) = (simulate_all(plant_file, file, [scenario]) for file in (controller, other))
    np.testing.assert_array_equal(found.command, expected.command)
    np.testing.assert_array_equal(found.X, expected.X)
    assert found.ending.status.value == "done"
    assert np.abs(found.command - found.u_m0).max() < 1e-6, "the plant should be at rest"
