"""The controller in C for the other kinds of FMI: always the same torques, to the last bit."""

from __future__ import annotations

import os
from ctypes import byref, c_bool, c_double, c_int

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException, FMU1Slave
from fmpy.fmi2 import FMU2Model
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.validation import validate_fmu
from pid_fmus import INPUTS, OUTPUTS, T_S, Signals, in_child, instance_arguments, law, random_signals

import build_fmus

pytestmark = pytest.mark.skipif(build_fmus.find_compiler() is None, reason="no C compiler")

CO_SIMULATION = ("DiagonalPID_C", "DiagonalPID_C_fmi1", "DiagonalPID_C_fmi3", "DiagonalPID_C_fmi3_scalars")
MODEL_EXCHANGE = ("DiagonalPID_C_me2", "DiagonalPID_C_me3")
WITH_ARRAYS = ("DiagonalPID_C_fmi3", "DiagonalPID_C_me3")
U_M, U_M0, T_S_REFERENCE, TIME = 4, 15, 14, 17


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture
def fmu(request, folder):
    return built(request.param, folder)


def built(name, folder):
    path = folder / f"{name}.fmu"
    return path if path.exists() else build_fmus.build(name, folder)


def each(*names):
    """Run a test with the FMUs of these names."""
    return pytest.mark.parametrize("fmu", names, indirect=True)


@each(*build_fmus.VARIANTS)
def test_strict_validation_finds_nothing(fmu):
    assert validate_fmu(str(fmu)) == []


@each(*build_fmus.VARIANTS)
def test_description_keeps_what_was_declared(fmu, folder):
    description = fmpy.read_model_description(str(fmu))
    reference = fmpy.read_model_description(str(built("DiagonalPID_C", folder)))
    assert description.modelName == fmu.stem
    units = {v.name.partition("[")[0]: (v.unit, v.description) for v in reference.modelVariables}
    assert {
        v.name.partition("[")[0]: (v.unit, v.description) for v in description.modelVariables if v.name != "time"
    } == units
    if fmu.stem in WITH_ARRAYS:
        assert {v.name: v.shape for v in description.modelVariables if v.name in ("q_m", "T_s")} == {
            "q_m": (2,),
            "T_s": (),
        }


@each(*build_fmus.VARIANTS)
def test_equal_sources_give_equal_bytes(fmu, tmp_path):
    assert build_fmus.build(fmu.stem, tmp_path).read_bytes() == fmu.read_bytes()


@pytest.mark.skipif(os.name != "posix", reason="options of gcc and clang")
@pytest.mark.parametrize("name", ("DiagonalPID_C", *build_fmus.VARIANTS))
def test_sources_compile_without_a_warning(name, tmp_path, monkeypatch):
    compiler = " ".join(build_fmus.find_compiler())
    monkeypatch.setenv("CC", f"{compiler} -Wall -Wextra -Wno-unused-parameter -pedantic -Werror")
    build_fmus.build(name, tmp_path)


def held(q_m_ref, q_m, samples):
    """Signals that do not change."""
    return Signals(np.array([q_m_ref] * samples), np.array([q_m] * samples), (0.0, 0.0))


# ---- Torques through FMPy's own simulation ----


def _simulate(path, signals, arrays):
    """Return u_m at all multiples of T_S, initial value included."""
    times = [k * T_S for k in range(len(signals.rows))]
    if arrays:
        dtype = [("time", float), ("q_m_ref", float, (2,)), ("q_m", float, (2,))]
        rows = [(t, row[:2], row[2:]) for t, row in zip(times, signals.rows, strict=True)]
        outputs, start = ["u_m"], {"u_m0": list(signals.u_m0)}
    else:
        dtype = [("time", float), *((name, float) for name in INPUTS)]
        rows = [(t, *row) for t, row in zip(times, signals.rows, strict=True)]
        outputs, start = list(OUTPUTS), dict(zip(("u_m0[1]", "u_m0[2]"), signals.u_m0, strict=True))
    result = fmpy.simulate_fmu(
        str(path),
        stop_time=len(rows) * T_S,
        output_interval=T_S,
        step_size=T_S,
        solver="Euler",
        record_events=False,
        input=np.array(rows, dtype=dtype),
        start_values=start,
        output=outputs,
    )
    columns = [np.asarray(result[name], dtype=float).reshape(len(result), -1) for name in outputs]
    return [tuple(row) for row in np.hstack(columns).tolist()]


@each(*CO_SIMULATION)
def test_co_simulation_samples_at_step_start(fmu):
    signals = random_signals()
    torques = in_child(_simulate, fmu, signals, fmu.stem in WITH_ARRAYS)
    assert torques == [signals.u_m0, *law(signals)]


@each(*MODEL_EXCHANGE)
def test_model_exchange_samples_at_time_events(fmu):
    signals = random_signals()
    torques = in_child(_simulate, fmu, signals, fmu.stem in WITH_ARRAYS)
    # The last event, at stop time, holds the last inputs; the law has no sample for it.
    assert torques[:-1] == law(signals)[: len(torques) - 1]
    assert len(torques) == len(signals.rows) + 1


# ---- Model Exchange, event by event ----


def _events(path, row, early):
    """Return for each call of the event update: did u_m change, u_m, is a next event defined, and when."""
    if fmpy.read_model_description(str(path)).fmiVersion == "2.0":
        model = FMU2Model(**instance_arguments(path))
        model.instantiate()
        model.setupExperiment(startTime=1.0)
        model.enterInitializationMode()
        model.setReal([0, 1, 2, 3], row)
        update, get = model.newDiscreteStates, lambda: tuple(model.getReal([U_M, U_M + 1]))
    else:
        model = FMU3Model(**instance_arguments(path))
        model.instantiate()
        model.enterInitializationMode(startTime=1.0)
        model.setFloat64([0, 2], row)
        update, get = model.updateDiscreteStates, lambda: tuple(model.getFloat64([U_M], nValues=2))
    model.exitInitializationMode()
    seen = []
    # The first event mode iterates; then come one between samples, one in time, one a rounding error early.
    for k in (0.0, 0.0, 0.5, 1.0, 2.0 - early):
        if k > 0.0:
            model.enterEventMode()
        model.setTime(1.0 + k * T_S)
        before = get()
        *_, defined, event = update()
        seen.append((before != get(), get(), defined, event))
        model.enterContinuousTimeMode()
    model.freeInstance()
    return seen


@each(*MODEL_EXCHANGE)
def test_each_time_event_is_handled_once(fmu):
    seen = in_child(_events, fmu, (0.3, -0.1, 0.1, 0.2), 1e-9)
    torques = law(held((0.3, -0.1), (0.1, 0.2), samples=3))
    assert [changed for changed, *_ in seen] == [True, False, False, True, True]
    assert [u_m for _, u_m, *_ in seen] == [torques[k] for k in (0, 0, 0, 1, 2)]
    assert all(defined for *_, defined, _ in seen)
    assert [event for *_, event in seen] == [1.0 + k * T_S for k in (1, 1, 1, 2, 3)]


# ---- FMI 3 co-simulation, call by call ----


def _step(slave, h):
    """Return the status of fmi3DoStep and all it tells beside, from values that it must overwrite."""
    told = c_bool(True), c_bool(True), c_bool(True), c_double(-1.0)
    status = 0
    try:
        slave.fmi3DoStep(slave.component, 0.0, h, c_bool(True), *map(byref, told))
    except FMICallException as error:
        status = error.status
    return status, *(value.value for value in told)


def _fmi3_calls(path):
    log = []
    slave = FMU3Slave(**instance_arguments(path))

    def log_message(*arguments):
        log.append(arguments[-1].decode())

    with pytest.raises(Exception, match="Failed to instantiate"):
        slave.instantiate(eventModeUsed=True, loggingOn=True, logMessage=log_message)
    slave.instantiate(loggingOn=True, logMessage=log_message)
    slave.enterInitializationMode(startTime=0.0)
    slave.exitInitializationMode()
    slave.setFloat64([0, 2], [0.3, -0.1, 0.1, 0.2])
    kept = slave.serializeFMUState(slave.getFMUState())
    steps = [_step(slave, T_S), _step(slave, 2 * T_S)]
    torques, time = slave.getFloat64([U_M], nValues=2), slave.getFloat64([TIME])
    mixed = slave.getFloat64([T_S_REFERENCE, U_M0], nValues=3)
    slave.setFMUState(slave.deserializeFMUState(kept))
    restored = slave.getFloat64([U_M], nValues=2), slave.getFloat64([TIME])
    for wrong in (
        lambda: slave.getFloat64([0]),
        lambda: slave.getFloat64([99]),
        lambda: slave.getInt32([0]),
        lambda: slave.setFloat64([TIME], [1.0]),
    ):
        with pytest.raises(FMICallException, match="status 3"):
            wrong()
    slave.terminate()
    slave.freeInstance()
    return steps, torques, time, mixed, restored, log


@each("DiagonalPID_C_fmi3")
def test_fmi3_calls(fmu):
    steps, torques, time, mixed, restored, log = in_child(_fmi3_calls, fmu)
    assert steps == [(0, False, False, False, T_S), (3, False, False, False, T_S)]
    assert tuple(torques) == law(held((0.3, -0.1), (0.1, 0.2), samples=1))[0]
    assert time == [T_S]
    assert mixed == [T_S, 0.0, 0.0]
    assert restored == ([0.0, 0.0], [0.0])
    reasons = (
        "no event mode",
        "must equal the sample time",
        "only 1 were passed",
        "99 unknown",
        "Float64",
        "the time",
    )
    assert [reason for reason, message in zip(reasons, log, strict=True) if reason not in message] == []


# ---- FMI 1 and identities ----


def _fmi1_wrong_step(path):
    slave = FMU1Slave(**instance_arguments(path))
    # FMPy declares these two as returning strings, and would read the status of a failure as an address.
    for name in ("fmi1InitializeSlave", "fmi1DoStep"):
        slave._functions[name].restype = c_int
    slave.instantiate(loggingOn=True)
    slave.initialize()
    slave.fmi1DoStep(slave.component, 0.0, T_S, b"\1")
    with pytest.raises(FMICallException, match="fmi1DoStep failed with status 3"):
        slave.fmi1DoStep(slave.component, T_S, 2 * T_S, b"\1")
    slave.terminate()
    slave.freeInstance()
    return True


@each("DiagonalPID_C_fmi1")
def test_fmi1_refuses_a_wrong_step(fmu):
    assert in_child(_fmi1_wrong_step, fmu)


def _instantiate_with_wrong_guid(path):
    FMU2Model(**{**instance_arguments(path), "guid": "{not-this-one}"}).instantiate()


@each("DiagonalPID_C_me2")
def test_wrong_guid_is_refused(fmu):
    with pytest.raises(Exception, match="Failed to instantiate"):
        in_child(_instantiate_with_wrong_guid, fmu)
