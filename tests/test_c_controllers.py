"""The controllers in C: the PID for every kind of FMI with the same torques to the last bit, the LQG up to rounding."""

from ctypes import byref, c_bool, c_double, c_int
from functools import partial

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model
from numpy.testing import assert_allclose
from support.pid_fmus import T_S, Signals, built, fmpys_torques, in_child, instance, law, random_signals, slave
from support.stub_fmus import strict_compiler
from test_pid import STARTS

import build_fmus
from orchestrator import Benchmark, Controller
from orchestrator.loop.signals import quantize

pytestmark = pytest.mark.needs("compiler")

KINDS = ("DiagonalPID_C", *build_fmus.VARIANTS)
LQG = "DitheredLQG_C"
MODEL_EXCHANGE = ("DiagonalPID_C_me2", "DiagonalPID_C_me3")
WITH_ARRAYS = ("DiagonalPID_C_fmi3", "DiagonalPID_C_me3")
U_M, U_M0, T_S_REFERENCE, TIME = 4, 15, 14, 17
HELD = Signals(np.array([(0.3, -0.1)] * 3), np.array([(0.1, 0.2)] * 3), (0.0, 0.0))
"""Signals that do not change."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The FMUs of all KINDS and the LQG by name, compiled without a warning."""
    folder = tmp_path_factory.mktemp("fmus")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", strict_compiler())
        return {name: build_fmus.build(name, folder) for name in (*KINDS, LQG)}


@pytest.mark.parametrize("name", build_fmus.VARIANTS)
def test_description_keeps_what_was_declared(name, files):
    described = {kind: fmpy.read_model_description(str(files[kind])).modelVariables for kind in (name, KINDS[0])}
    declared, wanted = (
        {v.name.partition("[")[0]: (v.unit, v.description) for v in variables if v.name != "time"}
        for variables in described.values()
    )
    assert declared == wanted
    shapes = {v.name: v.shape for v in described[name]}
    assert name not in WITH_ARRAYS or (shapes["q_m"], shapes["T_s"]) == ((2,), ())


def test_torques_are_the_laws_to_the_last_bit(files):
    signals = random_signals()
    paths = [files[name] for name in KINDS]
    for name, torques in zip(KINDS, in_child(fmpys_torques, paths, signals), strict=True):
        assert len(torques) == len(signals.rows) + 1
        if name in MODEL_EXCHANGE:  # the last event, at stop time, holds the last inputs; the law has no sample for it
            assert torques[:-1] == law(signals), name
        else:
            assert torques == [signals.u_m0, *law(signals)], name


ALLOWED = 1e-4
"""Difference of torques, in steps of the drive's rounding: at most about one torque in 10^4 is rounded otherwise. It
comes from the Riccati equations, whose terms differ by many orders of magnitude."""


def _torques(path, signals, parameters):
    with slave(path) as one:
        one.begin(signals.q_m_ref[0], signals.u_m0)
        one.set(list(parameters), list(parameters.values()))
        one.fmu.exitInitializationMode()
        return np.array(one.run(signals.rows))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ManipulatorLQG", "DitheredLQG"])
def test_torques_of_the_lqg_are_those_of_python(name, files, fmu_folder):
    """On the angles of a whole case; the LQG without a dither is the one with a dither of no amplitude."""
    measured = Benchmark().simulate(Controller(built(name, fmu_folder)), "c14.slippery.gain_2")
    scenario = measured.case.scenario
    q_m = np.vectorize(partial(quantize, quantum=scenario.sensor.quantum))(measured.trajectory.measured[:-1])
    signals = Signals(np.tile(measured.trajectory.q_m_ref, (len(q_m), 1)), q_m, tuple(measured.trajectory.u_m0))
    quiet = {"amplitude[1]": 0.0, "amplitude[2]": 0.0} if name == "ManipulatorLQG" else {}
    here = in_child(_torques, built(name, fmu_folder), signals, {})
    there = in_child(_torques, files[LQG], signals, {**STARTS[name], **quiet})
    assert here.shape == (104_000, 2) and 1.0 < np.abs(here).max() < 20.0, "a whole case, far from the limits"
    assert_allclose(there / scenario.drive.quantum, here / scenario.drive.quantum, rtol=0.0, atol=ALLOWED)


def _events(path, row, early):
    """Return for each call of the event update: did u_m change, u_m, is a next event defined, and when."""
    with pytest.raises(Exception, match="Failed to instantiate"):
        instance(path, guid="{not-this-one}")
    model = instance(path)
    if isinstance(model, FMU2Model):
        model.setupExperiment(startTime=1.0)
        model.enterInitializationMode()
        model.setReal([0, 1, 2, 3], row)
        update, get = model.newDiscreteStates, lambda: tuple(model.getReal([U_M, U_M + 1]))
    else:
        model.enterInitializationMode(startTime=1.0)
        model.setFloat64([0, 2], row)
        update, get = model.updateDiscreteStates, lambda: tuple(model.getFloat64([U_M], nValues=2))
    model.exitInitializationMode()
    seen = []
    # The first event mode iterates; then come one between samples, one in time, one a rounding error early.
    for k in (0.0, 0.0, 0.5, 1.0, 2.0 - early):
        if k > 0.0:
            model.enterContinuousTimeMode()
            model.setTime(1.0 + k * T_S)
            model.enterEventMode()
        before = get()
        *_, defined, event = update()
        seen.append((before != get(), get(), defined, event))
    model.freeInstance()
    return seen


@pytest.mark.parametrize("name", MODEL_EXCHANGE)
def test_each_time_event_is_handled_once(name, files):
    seen = in_child(_events, files[name], HELD.rows[0], 1e-9)
    torques = law(HELD)
    changes = zip((True, False, False, True, True), (0, 0, 0, 1, 2), (1, 1, 1, 2, 3), strict=True)
    assert seen == [(changed, torques[k], True, 1.0 + event * T_S) for changed, k, event in changes]


def _step(slave, h, t=0.0):
    """Return the status of fmi3DoStep and its other results, from values that it must overwrite."""
    results = c_bool(True), c_bool(True), c_bool(True), c_double(-1.0)
    status = 0
    try:
        slave.fmi3DoStep(slave.component, t, h, c_bool(True), *map(byref, results))
    except FMICallException as error:
        status = error.status
    return status, *(value.value for value in results)


def _fmi3_calls(path):
    log = []
    with pytest.raises(Exception, match="Failed to instantiate"):
        instance(path, log, event_mode_used=True)
    slave = instance(path, log)
    slave.enterInitializationMode(startTime=0.0)
    slave.exitInitializationMode()
    slave.setFloat64([0, 2], HELD.rows[0])
    kept = slave.serializeFMUState(slave.getFMUState())
    assert _step(slave, T_S) == (0, False, False, False, T_S)
    stepped = slave.getFMUState()
    assert _step(slave, 2 * T_S, T_S) == (3, False, False, False, T_S)
    assert (tuple(slave.getFloat64([U_M], nValues=2)), slave.getFloat64([TIME])) == (law(HELD)[0], [T_S])
    assert slave.getFloat64([T_S_REFERENCE, U_M0], nValues=3) == [T_S, 0.0, 0.0]
    slave.setFMUState(slave.deserializeFMUState(kept))
    assert (slave.getFloat64([U_M], nValues=2), slave.getFloat64([TIME])) == ([0.0, 0.0], [0.0])
    for function, *arguments in (
        (slave.getFloat64, [0]),
        (slave.getFloat64, [99]),
        (slave.getInt32, [0]),
        (slave.setFloat64, [TIME], [1.0]),
    ):
        slave.setFMUState(stepped)
        with pytest.raises(FMICallException, match="status 3"):
            function(*arguments)
    slave.setFMUState(stepped)
    slave.terminate()
    slave.freeInstance()
    assert len(log) == 6, "one message for each refusal"


def _fmi1_wrong_step(path):
    slave = instance(path)
    # FMPy declares these two as returning strings, and would read the status of a failure as an address.
    for name in ("fmi1InitializeSlave", "fmi1DoStep"):
        slave._functions[name].restype = c_int
    slave.initialize()
    slave.fmi1DoStep(slave.component, 0.0, T_S, b"\1")
    with pytest.raises(FMICallException, match="fmi1DoStep failed with status 3"):
        slave.fmi1DoStep(slave.component, T_S, 2 * T_S, b"\1")
    slave.freeInstance()


@pytest.mark.parametrize(
    ("calls", "name"), [(_fmi3_calls, "DiagonalPID_C_fmi3"), (_fmi1_wrong_step, "DiagonalPID_C_fmi1")]
)
def test_calls(calls, name, files):
    in_child(calls, files[name])
