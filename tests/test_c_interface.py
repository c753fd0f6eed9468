"""What compiled FMUs refuse, call by call: the value that is refused is named in the log, and nothing has changed.

Random sequences of calls are in ``test_random_calls.py``.
"""

import itertools
import math
import shlex
import subprocess
import tempfile
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p

import pytest
from fmpy import calloc, extract, free, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Model,
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import fmi3LogMessageCallback
from random_calls.fmus import FMUS
from support.pid_fmus import T_S, instance

from controller_fmu.export import unpack

pytestmark = pytest.mark.needs("compiler")

SLAVES = ("FlexibleManipulatorNative", "DiagonalPID_C", "DitheredLQG_C", "RobustLQG", "RobustLinearLQG")
SLAVES += ("SteadyLQG", "Imperfections", "state_space", "mlp_tanh", "mlp_relu")
CONTROLLERS = [name for name in SLAVES if name not in ("FlexibleManipulatorNative", "Imperfections")]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A function that builds an FMU of FMUS once."""
    known, folder = {}, tmp_path_factory.mktemp("c_interface")

    def of(name):
        if name not in known:
            known[name] = FMUS[name](folder)
        return known[name]

    return of


LOG: list[str] = []
"""What the instances of FMI 2.0 have logged."""


def _callbacks():
    """Without FMPy's proxy for formats, as there are none in the messages: it knows the logger of one instance only."""
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(lambda *arguments: LOG.append(arguments[-1].decode()))
    callbacks.allocateMemory, callbacks.freeMemory = (
        fmi2CallbackAllocateMemoryTYPE(calloc),
        fmi2CallbackFreeMemoryTYPE(free),
    )
    return callbacks


CALLBACKS = _callbacks()


class One:
    """An FMI 2.0 co-simulation instance, with variables by name."""

    def __init__(self, path):
        description = read_model_description(str(path))
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            modelIdentifier=description.coSimulation.modelIdentifier,
            unzipDirectory=extract(str(path), unzipdir=tempfile.mkdtemp(dir=path.parent)),
        )
        self.fmu.instantiate(callbacks=CALLBACKS, loggingOn=True)
        self.start()

    def start(self, parameters=(), start=0.0):
        """Initialize with these parameters."""
        self.fmu.reset()
        self.fmu.setupExperiment(startTime=start)
        self.set(dict(parameters))
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, values):
        self.fmu.setReal([self.references[name] for name in values], list(values.values()))

    def get(self, *names):
        return list(self.fmu.getReal([self.references[name] for name in names]))

    def refusal(self, function, *arguments):
        """What is logged when a call is refused."""
        count = len(LOG)
        with pytest.raises(FMICallException, match="status 3"):
            function(*arguments)
        (message,) = LOG[count:]
        return message


@pytest.fixture(scope="module")
def one(file):
    """A function that gives the instance of an FMU of FMUS, initialized with its start values."""
    known = {}

    def of(name):
        if name not in known:
            known[name] = One(file(name))
        known[name].start()
        return known[name]

    return of


# ---- Every FMU ----


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", SLAVES)
def test_inputs_that_are_not_finite_are_refused(name, value, one):
    fmu = one(name)
    target = "u_m[2]" if name == "FlexibleManipulatorNative" else "q_m[2]"
    message = fmu.refusal(fmu.set, {target.replace("2", "1"): 0.25, target: value})
    assert message.startswith(f"{target} = {value:g} (value reference {fmu.references[target]}") and "finite" in message
    assert fmu.get(target.replace("2", "1")) == [0.0], "nothing of the call was set"


@pytest.mark.parametrize("name", SLAVES)
def test_states_are_refused_unless_they_are_of_this_fmu(name, one):
    fmu, other = one(name), one("DiagonalPID_C" if name != "DiagonalPID_C" else "Imperfections")
    state = fmu.fmu.getFMUstate()
    kept = fmu.fmu.serializeFMUstate(state)
    spoilt = [
        bytes([*kept[:at], kept[at] ^ 1, *kept[at + 1 :]]) for at in (0, 9, 17, 30, len(kept) // 2, len(kept) - 1)
    ]
    foreign = other.fmu.serializeFMUstate(other.fmu.getFMUstate())
    for taken in (*spoilt, foreign, kept[:-1], kept + b"\0", b"", bytes(len(kept))):
        fmu.fmu.setFMUstate(state)
        assert "state" in fmu.refusal(fmu.fmu.deSerializeFMUstate, taken)
    for pointer in (c_void_p(None), other.fmu.getFMUstate()):
        fmu.fmu.setFMUstate(state)
        assert "state" in fmu.refusal(fmu.fmu.setFMUstate, pointer)
    fmu.fmu.setFMUstate(fmu.fmu.deSerializeFMUstate(kept))
    fmu.fmu.doStep(0.0, 0.125e-3 if name == "Imperfections" else T_S)


@pytest.mark.parametrize("name", SLAVES)
def test_steps_are_refused_that_do_not_go_on_from_the_last_one(name, one):
    fmu, step = one(name), 0.125e-3 if name == "Imperfections" else T_S
    fmu.fmu.doStep(0.0, step)
    fmu.fmu.doStep(step * (1 + 1e-9), step)  # importers compute times in their own way
    for time in (0.0, -1.0, step, 5.0, 1e300, math.nan, math.inf):
        fmu.start()
        fmu.fmu.doStep(0.0, step)
        if time != step:
            assert f"{time:.3g}" in fmu.refusal(fmu.fmu.doStep, time, step)
    for wrong in (-step, math.nan, math.inf, 1e300):
        fmu.start()
        assert f"step of {wrong:.15g} s" in fmu.refusal(fmu.fmu.doStep, 0.0, wrong)
    fmu.fmu.reset()
    fmu.fmu.setupExperiment(startTime=0.0, stopTime=2 * step)
    fmu.fmu.enterInitializationMode()
    fmu.fmu.exitInitializationMode()
    fmu.fmu.doStep(0.0, step)
    fmu.fmu.doStep(step, step)
    assert "behind the stop time" in fmu.refusal(fmu.fmu.doStep, 2 * step, step)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("part", [0.02, 0.5, 0.98, 1.02, 3.0])
def test_controllers_take_steps_of_their_sample_time_alone(name, part, one):
    """Where the stop time is told, none but the last is shorter."""
    fmu = one(name)
    fmu.fmu.reset()
    fmu.fmu.setupExperiment(startTime=0.0, stopTime=1.0)
    fmu.fmu.enterInitializationMode()
    fmu.fmu.exitInitializationMode()
    assert "must equal the sample time T_s = 0.00025 s" in fmu.refusal(fmu.fmu.doStep, 0.0, part * T_S)


@pytest.mark.parametrize("name", SLAVES)
def test_times_that_are_none_are_refused(name, one):
    fmu = one(name)
    for start, stop in ((math.nan, None), (math.inf, None), (1e300, None), (0.0, math.nan), (1.0, 0.5)):
        fmu.fmu.reset()
        message = fmu.refusal(lambda start=start, stop=stop: fmu.fmu.setupExperiment(startTime=start, stopTime=stop))
        assert "time = " in message and f"{(start if stop is None else stop):.3g}"[:4] in message


@pytest.mark.parametrize("name", ["DiagonalPID_C", "FlexibleManipulatorNative"])
def test_variables_are_set_where_the_standard_allows_it(name, one):
    fmu = one(name)
    parameter, output = ("K_p[1]", "u_m[1]") if name == "DiagonalPID_C" else ("m[1]", "q_a[1]")
    reference = fmu.references[parameter]
    assert f"{parameter} = 2 (value reference {reference}) refused" in fmu.refusal(fmu.set, {parameter: 2.0})
    for prepare in (fmu.fmu.reset, fmu.start):
        prepare()
        assert f"{output} = 1 " in fmu.refusal(fmu.set, {output: 1.0})
    fmu.fmu.reset()
    assert fmu.get(output) == [0.0], "start values can be read before initialization"
    for unknown in (len(fmu.references), 2**32 - 1):
        fmu.fmu.reset()
        assert f"value reference {unknown} unknown" in fmu.refusal(fmu.fmu.getReal, [unknown])


def test_an_error_is_a_state_that_a_reset_or_a_saved_state_ends(one):
    fmu = one("DiagonalPID_C")
    state = fmu.fmu.getFMUstate()
    fmu.refusal(fmu.fmu.doStep, 0.0, 1.0)
    assert 'not allowed in the state "error": reset the instance' in fmu.refusal(fmu.fmu.doStep, 0.0, T_S)
    fmu.fmu.setFMUstate(state)
    fmu.fmu.doStep(0.0, T_S)


# ---- Instances ----


def test_no_instance_is_an_error_and_no_crash(one):
    fmu = one("DiagonalPID_C").fmu
    value, reference = c_double(), c_uint32(0)
    calls = {
        "fmi2SetReal": (byref(reference), c_size_t(1), byref(value)),
        "fmi2GetReal": (byref(reference), c_size_t(1), byref(value)),
        "fmi2DoStep": (c_double(0.0), c_double(T_S), c_int(1)),
        **dict.fromkeys(("fmi2Reset", "fmi2Terminate", "fmi2EnterInitializationMode"), ()),
    }
    for name, arguments in calls.items():
        assert getattr(fmu.dll, name)(None, *arguments) == 3
    fmu.dll.fmi2FreeInstance(None)


@pytest.mark.parametrize(
    ("name", "declared"),
    [
        *(("DiagonalPID_C_fmi3", "co-simulation"), ("FlexibleManipulatorNative_fmi3", "co-simulation")),
        *(("DiagonalPID_C_me3", "Model Exchange"), ("FlexibleManipulatorNative_me3", "Model Exchange")),
        *(("DiagonalPID_C", "co-simulation"), ("DiagonalPID_C_me2", "Model Exchange")),
    ],
)
def test_the_other_interface_gives_no_instance(name, declared, file):
    """Also where a tool asks for it that has not read the model description: by NULL, and a message."""
    path, log = file(name), []
    description = read_model_description(str(path))
    own = instance(path)
    token, library = description.guid.encode(), own.dll
    if description.fmiVersion == "3.0":
        logger = fmi3LogMessageCallback(lambda _environment, _status, _category, message: log.append(message.decode()))
        functions = [getattr(library, f"fmi3Instantiate{kind}") for kind in ("ModelExchange", "CoSimulation")]
        functions.append(library.fmi3InstantiateScheduledExecution)
        for function in functions:
            function.restype, function.argtypes = c_void_p, None
        exchange, co_simulation, scheduled = functions
        common = c_char_p(b"x"), c_char_p(token), None, c_bool(False), c_bool(True)
        options = c_bool(False), c_bool(False), None, c_size_t(0)
        if declared == "co-simulation":
            assert exchange(*common, None, logger) is None
        else:
            assert co_simulation(*common, *options, None, logger, None) is None
        assert scheduled(*common, None, logger, None, None, None) is None
        assert len(log) == 2
    else:
        LOG.clear()
        library.fmi2Instantiate.restype, library.fmi2Instantiate.argtypes = c_void_p, None
        for kind in (0 if declared == "co-simulation" else 1, 7):
            arguments = b"x", c_int(kind), c_char_p(token), b"", byref(CALLBACKS), c_int(0), c_int(1)
            assert library.fmi2Instantiate(*arguments) is None
        log = list(LOG)
        assert len(log) == 2
    assert all(f"declares {declared} alone" in message for message in log)
    own.freeInstance()


# ---- Value references and sizes of arrays in FMI 3 ----


@pytest.mark.parametrize(
    ("references", "size", "words"),
    [
        ([1], 2, "value reference 1 unknown"),  # the second element of q_m_ref
        ([16], 2, "value reference 16 unknown"),  # the second one of u_m0, after which the law's memory begins
        ([18], 1, "value reference 18 unknown"),
        ([2**31], 1, "value reference 2147483648 unknown"),
        ([2], 1, "value reference 2 (q_m) has 2 values, only 1 were passed"),
        ([0, 2], 3, "value reference 2 (q_m) has 2 values, only 1 were passed"),
        ([2], 3, "3 values were passed for variables that have 2"),
        ([], 1, "1 values were passed for variables that have 0"),
    ],
)
def test_arrays_of_fmi_3_end_where_they_are_declared(references, size, words, file):
    path, log = file("DiagonalPID_C_fmi3"), []
    fmu = instance(path, log)
    fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    state = fmu.getFMUState()
    for call in (lambda: fmu.getFloat64(references, nValues=size), lambda: fmu.setFloat64(references, [0.0] * size)):
        fmu.setFMUState(state)
        with pytest.raises(FMICallException, match="status 3"):
            call()
        assert words in log[-1]
    fmu.freeInstance()


# ---- One FMU each ----


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"sigma": 1e-4}, "noise_increment[4] = 0 refused"),
        ({"sigma": 1e-4, "noise_increment[4]": 2.0}, "noise_increment[4] = 2 refused"),
        ({"ticks_per_sample": 0.0}, "ticks_per_sample = 0 refused"),
        ({"ticks_per_sample": 1.5}, "ticks_per_sample = 1.5 refused: it must be a whole number"),
        ({"sensor_delay[2]": 1023.0}, "sensor_delay[2] = 1023 refused"),
        ({"drive_delay[1]": 0.0}, "drive_delay[1] = 0 refused"),
        ({"rate": -1.0}, "rate = -1 refused"),
        ({"angle_quantum": -1.0}, "angle_quantum = -1 refused"),
        ({"limit[1]": -5.0}, "limit[1] = -5 refused"),
        ({"noise_state[3]": 2.0**32}, "noise_state[3] = 4294967296 refused"),
    ],
)
def test_parameters_of_the_imperfections(parameters, words, one):
    fmu = one("Imperfections")
    assert words in fmu.refusal(fmu.start, parameters)


@pytest.mark.parametrize("start", [-1.0, -1e-3, 1.0, 1e5])
def test_the_imperfections_begin_at_zero(start, one):
    fmu = one("Imperfections")
    fmu.start(start=start)
    assert f"t = {start:.15g} s refused: time begins at 0" in fmu.refusal(fmu.fmu.doStep, start, 0.25e-3)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"alpha[1]": 1e6}, "alpha[1] = 1e+06 s/rad"),
        ({"f_c[2]": 1e5}, "f_c[2] = 100000 N.m"),
        ({"j_m[2]": 1e-9}, "j_m[2] = 1e-09 kg.m2"),
        ({"alpha[1]": 1e300, "f_c[1]": 1e300}, "alpha[1] = 1e+300 s/rad"),
    ],
)
def test_parameters_that_need_too_many_substeps(parameters, words, one):
    fmu = one("FlexibleManipulatorNative")
    message = fmu.refusal(fmu.start, parameters)
    assert words in message and "shorter than 2.5e-07 s" in message
    fmu.start({"alpha[1]": 600.0, "alpha[2]": 300.0})  # far steeper than any of Table 1
    fmu.fmu.doStep(0.0, T_S)


@pytest.mark.parametrize("step", [13.0, 1e6, 1e9])
def test_steps_of_too_many_substeps(step, one):
    fmu = one("FlexibleManipulatorNative")
    assert f"step of {step:.15g} s" in fmu.refusal(fmu.fmu.doStep, 0.0, step)
    fmu.start()
    fmu.fmu.doStep(0.0, 12.0)


def test_the_plant_is_not_stepped_before_it_is_initialized(one):
    fmu = one("FlexibleManipulatorNative")
    fmu.fmu.reset()
    assert 'fmi2DoStep is not allowed in the state "instantiated"' in fmu.refusal(fmu.fmu.doStep, 0.0, T_S)
    fmu.fmu.reset()
    fmu.fmu.setupExperiment(startTime=0.0)
    fmu.set({"m[1]": -1.0})
    fmu.fmu.enterInitializationMode()
    fmu.refusal(fmu.fmu.exitInitializationMode)
    assert 'not allowed in the state "error"' in fmu.refusal(fmu.fmu.doStep, 0.0, T_S)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_torque_that_is_not_finite_is_an_error_and_not_a_limit(name, one):
    """Angles that are finite, but too large to compute with, come to torques that are not."""
    fmu = one(name)
    fmu.set({"q_m[1]": 1.7e308, "q_m[2]": -1.7e308, "q_m_ref[1]": -1.7e308, "q_m_ref[2]": 1.7e308})
    before = fmu.get("u_m[1]", "u_m[2]")
    message = fmu.refusal(fmu.fmu.doStep, 0.0, T_S)
    assert "u_m[" in message and "the torque must be finite" in message
    assert fmu.get("u_m[1]", "u_m[2]") == before == [0.0, 0.0]


# ---- The sources ----


@pytest.mark.parametrize("compiler", [pytest.param(name, marks=pytest.mark.needs(name)) for name in ("gcc", "clang")])
@pytest.mark.parametrize(
    "name", ["FlexibleManipulatorNative", "DitheredLQG_C", "RobustLQG", "Imperfections", "mlp_relu"]
)
def test_sources_are_one_translation_unit_without_a_warning(name, compiler, file, tmp_path):
    """As importers compile them that include all source files in one."""
    for path, data in unpack(file(name)).items():
        if path.startswith("sources/"):
            (tmp_path / path.removeprefix("sources/")).write_bytes(data)
    sources = sorted(source.name for source in tmp_path.glob("*.c"))
    (tmp_path / "all.c").write_text("".join(f'#include "{source}"\n' for source in sources))
    flags = "-std=c99 -O1 -Wall -Wextra -Wno-unused-parameter -pedantic -Werror"
    done = subprocess.run([compiler, *shlex.split(flags), "-c", "all.c"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["DiagonalPID_C", "DitheredLQG_C", "RobustLQG"])
def test_a_step_is_a_difference_of_two_times(name, one):
    """Far from zero the times that importers subtract are coarse."""
    fmu, start = one(name), 1e5
    fmu.start(start=start)
    times = [start + k * T_S for k in range(40)]
    for t, end in itertools.pairwise(times):
        fmu.fmu.doStep(t, end - t)
    assert "must equal the sample time" in fmu.refusal(fmu.fmu.doStep, times[-1], 1.02 * T_S)


@pytest.mark.parametrize(
    ("inputs", "step"), [({"u_m[1]": 1e300}, 1e-3), ({"F[1]": 1e200}, 1e-3), ({"u_m[1]": 1e7}, 0.1)], ids=str
)
def test_the_plant_refuses_a_step_after_which_its_state_is_not_finite(inputs, step, one):
    fmu = one("FlexibleManipulatorNative")
    fmu.set(inputs)

    def steps():
        for k in range(10):
            fmu.fmu.doStep(k * step, step)

    assert "the state does not stay finite" in fmu.refusal(steps)
    assert all(map(math.isfinite, fmu.get("q_m[1]", "q_a[1]", "X[1]")))


def test_the_plant_has_no_state_of_rest_at_an_angle_that_is_not_one(one):
    fmu = one("FlexibleManipulatorNative")
    assert "no state of rest" in fmu.refusal(fmu.start, {"q_a_start[1]": 1e308})


def test_an_event_that_was_left_out_is_refused(file):
    description = read_model_description(str(file("DiagonalPID_C_me2")))
    fmu = FMU2Model(
        guid=description.guid,
        modelIdentifier=description.modelExchange.modelIdentifier,
        unzipDirectory=extract(str(file("DiagonalPID_C_me2")), unzipdir=tempfile.mkdtemp()),
    )
    fmu.instantiate(callbacks=CALLBACKS, loggingOn=True)
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.newDiscreteStates()
    fmu.enterContinuousTimeMode()
    fmu.setTime(0.5)
    fmu.enterEventMode()
    with pytest.raises(FMICallException):
        fmu.newDiscreteStates()
    assert "was left out" in LOG[-1]
