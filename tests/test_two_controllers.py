"""Python FMUs share one interpreter; their modules must not mix, whatever they are called."""

import json
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from support.closed_loops import T_S, quiet, simulate_all
from support.python_controllers import python_controller

from orchestrator.execution.job import Done, Job
from orchestrator.execution.supervision import run_isolated
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.controller import Steady, prepared
from orchestrator.loop.setup import Setup
from orchestrator.loop.trajectory import Status

STEADY = Steady((0.4, -1.1), (9.0, -6.0), (0.3, -0.9))
GAINS = (10.0, -3.0)
EXPECTED = np.add.outer(GAINS, STEADY.u_m0)
"""Torques of the two controllers for motor angles 1 rad below the reference [N.m]."""

HELPER = "def scaled(slave):\n    slave.own['K'] = {gain}\n    slave.law()\n    return True\n"


def in_turn(plant, first, task):
    """Torques of two controllers in one process: instantiated both and stepped in turn, then one after the other."""
    from orchestrator.fmi.port import WARNING, exchange
    from orchestrator.fmi.slaves import load

    def answer(port):
        port.input_values[:] = np.array(STEADY.q_m_ref) - 1.0
        assert exchange(port, 2, 0.0, float(T_S), True)[1] <= WARNING
        return tuple(port.output_values)

    other, together = json.loads(task)
    answers, slaves = [], [first, load(open_archive(Path(other)))]
    for group in [slaves] * together + [[slave] for slave in slaves * 2]:
        with ExitStack() as stack:
            ports = [stack.enter_context(prepared(slave, Setup(), STEADY, T_S, 1.0)) for slave in group]
            answers += map(answer, ports)
    return json.dumps(answers).encode()


@pytest.mark.parametrize("together", [True, False])
def test_two_keep_their_code(together, plant_file, tmp_path):
    """Their module, class, helper module and variables have equal names; only the gains differ.

    If they import their helper in the first step only, the second would get the first one's side by side.
    """
    lazily = "" if together else "import twin_helper; "
    files = [
        python_controller(
            tmp_path,
            "Twin",
            imports="" if lazily else "import twin_helper",
            step_body=f"{lazily}return twin_helper.scaled(self)",
            modules={"twin_helper": HELPER.format(gain=gain)},
            target=tmp_path / f"twin_{number}.fmu",
        )
        for number, gain in enumerate(GAINS)
    ]
    task = json.dumps([str(files[1]), together]).encode()
    archives = open_archive(plant_file), open_archive(files[0])
    job = Job(*archives, f"{__name__}:in_turn", (task,), (60.0,), lambda index, value: json.loads(value))
    (outcome,) = run_isolated(job)
    assert isinstance(outcome, Done), outcome
    np.testing.assert_allclose(outcome.value, np.tile(EXPECTED, (3 if together else 2, 1)), rtol=0, atol=1e-12)


IMPOSTOR = "STOLEN = True\n"


@pytest.mark.parametrize(("name", "lazily"), [("Flexible_Manipulator", False), ("Manipulator_FMU", True)])
def test_modules_named_like_the_plants(name, lazily, plant_file, tmp_path):
    """Controllers whose own module is called like the plant's package or script, and others like its modules."""
    imports = "import integrator, dynamics"
    controller = python_controller(
        tmp_path,
        name,
        gain=40.0,
        imports="" if lazily else imports,
        step_body=f"{f'{imports}; ' if lazily else ''}assert dynamics.STOLEN; self.law(); return True",
        modules={"integrator": IMPOSTOR, "dynamics": IMPOSTOR},
    )
    (found,) = simulate_all(plant_file, controller, [quiet("1/20")])
    assert found.ending.status is Status.DONE
    assert np.abs(found.command - found.u_m0).max() < 1e-6 and found.tcp_error.max() < 1e-9, "at rest"
