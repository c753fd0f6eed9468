"""A controller in a process of its own: the same numbers, whatever its kind, and every failure is told."""

import os
import shutil
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hostile.cheats import PID_C
from hostile.fmus import Fault
from hostile.runs import STRUCK, bench, run, short_cases
from support.refusals import refusal
from support.tools import PRESENT

from controller_fmu.export import c_fmu
from controller_fmu.export.dialects import Dialect
from orchestrator.errors import EnvironmentFault
from orchestrator.execution import sandbox
from orchestrator.loop.scenario import Drive
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.pairing import simulate
from orchestrator.study.rehearsal import rehearse

pytestmark = pytest.mark.needs("linux")

KINDS = [Dialect(1), Dialect(2, "ModelExchange"), Dialect(3, arrays=True), Dialect(3, "ModelExchange")]


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_a_controller_apart_gives_the_same_bits(kind, plant_file, tmp_path):
    sources = [PID_C / name for name in ("model.c", "pid.c", "pid.h")]
    file = c_fmu(sources, PID_C / "modelDescription.xml", tmp_path / "Pid.fmu", kind)
    (case,) = short_cases((STRUCK,))
    scenario = replace(case.scenario, drive=Drive(delay=(Fraction("0.0001"), Fraction(0))))
    own = bench(plant_file, file, limit=120.0)
    one, other = simulate(own, scenario), simulate(replace(own, isolated=True), scenario)
    assert one.ending == other.ending and len(one.command) == 200
    for name in ("q_m", "X", "measured", "command", "torque"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    timing = rehearse(case, replace(own, isolated=True)).timing
    assert timing == rehearse(case, own).timing and timing.latency == 0


FAULTS = [
    (Fault("segfault"), Status.CRASHED, "controller's process was ended by SIGSEGV, in the call 'fmi2DoStep' of the"),
    (Fault("exit:0"), Status.CRASHED, "controller's process ended by itself with exit code 0"),
    (Fault("garbage"), Status.CRASHED, "controller's process sent what is no answer"),
    (Fault("spin"), Status.TIMEOUT, "in the call 'fmi2DoStep' of the controller at t = 0.02 s"),
    (Fault("status:3"), Status.ERROR, "fmi2DoStep returned error\n  hostile: as you wish"),
    (Fault("status:1"), Status.DONE, ""),
    (Fault("value:nan"), Status.ERROR, "a torque that is not a number"),
    (Fault("abort", "initialize", 0.0), Status.CRASHED, "controller's process was ended by SIGABRT"),
    (Fault("status:3", "initialize", 0.0), Status.ERROR, "as you wish"),
    (Fault("abort", "terminate", 0.0), Status.DONE, ""),
    (Fault("status:3", "terminate", 0.0), Status.DONE, ""),
    (Fault("grow"), Status.CRASHED, "of memory; the limit is 600 MB"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "status", "words"), FAULTS, ids=str)
def test_what_goes_wrong_there_is_told_here(fault, status, words, plant_file, faulty):
    own = bench(plant_file, faulty(fault), limit=3.0)
    boxed = PRESENT["bubblewrap"]
    own = replace(own, isolated=True, limits=replace(own.limits, memory=600_000_000), sandbox=boxed)
    (found,) = run(own, short_cases((STRUCK,)))
    assert (found.result.status, words in found.result.message) == (status, True), found.result
    assert "Traceback" not in found.result.message


@pytest.mark.slow
@pytest.mark.parametrize("what", ["kill:9", "kill-parent"])
def test_what_a_signal_ends_is_a_fault_from_outside_and_not_tried_again(what, plant_file, faulty):
    own = replace(bench(plant_file, faulty(Fault(what)), limit=3.0), isolated=True)
    problem = refusal(run, own, short_cases((STRUCK, STRUCK)), kind=EnvironmentFault)
    assert (problem.what, "ended by SIGKILL" in str(problem)) == ("outside", True)


@pytest.mark.needs("bubblewrap")
@pytest.mark.parametrize("failing", [1, 1000])
def test_a_process_that_cannot_be_started_is_no_crash_of_its_controller(
    failing, plant_file, pid_file, tmp_path, monkeypatch
):
    """As where its user may have no more processes for a moment: an honest PID had no place in a round by that."""
    starts, program = tmp_path / "starts", tmp_path / "bwrap"
    program.write_text(
        f"""#!/bin/sh
case "$*" in *controller_host*)
    echo >> {starts}
    [ $(wc -l < {starts}) -gt {failing} ] || {{ echo no room >&2; exit 1; }};;
esac
exec {shutil.which("bwrap")} "$@"
"""
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    own = replace(bench(plant_file, pid_file, limit=60.0), isolated=True, sandbox=True)
    if failing == 1:
        (found,) = run(own, short_cases((STRUCK,)))
        assert found.result.status is Status.DONE
    else:
        problem = refusal(run, own, short_cases((STRUCK,)), kind=EnvironmentFault)
        assert problem.what == "outside" and "no room" in str(problem)


@pytest.mark.needs("bubblewrap")
def test_the_plant_is_not_shown_to_a_controller_apart(plant_file, pid_file):
    own = bench(plant_file, pid_file)
    words = " ".join(sandbox.command((own.controller.folder,)))
    assert own.controller.sha256 in words and own.plant.sha256 not in words
