"""Compiled FMUs under any sequence of calls: no crash, no hang, no sanitizer report, no leak, and nothing left behind.

The harness in ``random_calls`` is compiled together with each FMU's own sources, by a compiler that has
AddressSanitizer and UndefinedBehaviorSanitizer. ``benchmarks/random_calls.py`` makes more calls.
"""

import re

import pytest
from random_calls.build import build, run
from random_calls.fmus import FMUS, LQGS

needs_sanitizers = pytest.mark.needs("sanitizers")

CALLS = 100_000

# ---- What the standards say ----

INSTANTIATED, INITIALIZATION, EVENT, CONTINUOUS, STEP, TERMINATED, ERROR = STATES = (
    *("instantiated", "initialization", "event", "continuous", "step", "terminated", "error"),
)
INITIALIZED = (EVENT, CONTINUOUS, STEP)
ANY, NONE = STATES, ()
SETTABLE = (INSTANTIATED, INITIALIZATION, *INITIALIZED)
EVALUATED = (INITIALIZATION, EVENT, CONTINUOUS, TERMINATED, ERROR)
STATUS = (STEP, TERMINATED)

ALLOWED = {
    "1": {  # FMI 1.0 for Co-Simulation, section 4.2; "step" is the state stepComplete
        "fmiInitializeSlave": (INSTANTIATED,),
        "fmiTerminateSlave": (STEP,),
        "fmiDoStep": (STEP,),
        "fmiCancelStep": NONE,
        "fmiSetReal": (INSTANTIATED, STEP),
        "fmiSetInteger": (INSTANTIATED, STEP),
        "fmiSetBoolean": (INSTANTIATED, STEP),
        "fmiSetString": (INSTANTIATED, STEP),
        "fmiSetRealInputDerivatives": (INSTANTIATED, STEP),
        "fmiGetRealOutputDerivatives": (STEP, TERMINATED, ERROR),
        **dict.fromkeys(("fmiGetReal", "fmiGetInteger", "fmiGetBoolean", "fmiGetString"), ANY),
        **dict.fromkeys(("fmiSetDebugLogging", "fmiResetSlave"), ANY),
        **{f"fmiGet{kind}Status": STATUS for kind in ("", "Real", "Integer", "Boolean", "String")},
    },
    "2": {  # FMI 2.0.4, tables in sections 3.2.3 and 4.2.4
        "fmi2SetupExperiment": (INSTANTIATED,),
        "fmi2EnterInitializationMode": (INSTANTIATED,),
        "fmi2ExitInitializationMode": (INITIALIZATION,),
        "fmi2Terminate": INITIALIZED,
        "fmi2DoStep": (STEP,),
        "fmi2CancelStep": NONE,
        "fmi2SetReal": SETTABLE,
        **dict.fromkeys(
            ("fmi2SetInteger", "fmi2SetBoolean", "fmi2SetString"), (INSTANTIATED, INITIALIZATION, EVENT, STEP)
        ),
        **dict.fromkeys(("fmi2GetReal", "fmi2GetInteger", "fmi2GetBoolean", "fmi2GetString"), ANY),
        **dict.fromkeys(("fmi2GetFMUstate", "fmi2SetFMUstate", "fmi2FreeFMUstate", "fmi2SerializedFMUstateSize"), ANY),
        **dict.fromkeys(("fmi2SerializeFMUstate", "fmi2DeSerializeFMUstate", "fmi2SetDebugLogging", "fmi2Reset"), ANY),
        "fmi2GetDirectionalDerivative": NONE,  # providesDirectionalDerivative is false
        "fmi2EnterEventMode": (EVENT, CONTINUOUS),
        "fmi2NewDiscreteStates": (EVENT,),
        "fmi2EnterContinuousTimeMode": (EVENT,),
        "fmi2CompletedIntegratorStep": (CONTINUOUS,),
        "fmi2SetTime": (EVENT, CONTINUOUS),
        "fmi2SetContinuousStates": (CONTINUOUS,),
    },
    "3": {  # FMI 3.0, sections 2.3, 3.2 and 4.2
        "fmi3EnterInitializationMode": (INSTANTIATED,),
        "fmi3ExitInitializationMode": (INITIALIZATION,),
        "fmi3Terminate": INITIALIZED,
        "fmi3DoStep": (STEP,),
        "fmi3SetFloat": SETTABLE,
        **{f"fmi3Set{kind}": SETTABLE for kind in ("Int32", "UInt64", "Boolean", "String", "Clock")},
        **{f"fmi3Get{kind}": ANY for kind in ("Float", "Int32", "UInt64", "Boolean", "String", "Clock")},
        **dict.fromkeys(("fmi3GetFMUState", "fmi3SetFMUState", "fmi3FreeFMUState", "fmi3SerializedFMUStateSize"), ANY),
        **dict.fromkeys(("fmi3SerializeFMUState", "fmi3DeserializeFMUState", "fmi3SetDebugLogging", "fmi3Reset"), ANY),
        # Nothing of these is declared: partial derivatives, dependencies of elements, event mode in co-simulation,
        # structural parameters, separate discrete states, clocks.
        **dict.fromkeys(("fmi3GetDirectionalDerivative", "fmi3GetNumberOfVariableDependencies"), NONE),
        **dict.fromkeys(("fmi3EnterStepMode", "fmi3EnterConfigurationMode", "fmi3ExitConfigurationMode"), NONE),
        **dict.fromkeys(("fmi3EvaluateDiscreteStates", "fmi3ActivateModelPartition"), NONE),
        "fmi3EnterEventMode": (CONTINUOUS,),
        "fmi3UpdateDiscreteStates": (EVENT,),
        "fmi3EnterContinuousTimeMode": (EVENT,),
        "fmi3CompletedIntegratorStep": (CONTINUOUS,),
        "fmi3SetTime": (EVENT, CONTINUOUS),
        "fmi3SetContinuousStates": (CONTINUOUS,),
    },
}
"""States in which a function is accepted, by FMI version.

More than the standards allow, because importers do it: variables are read in any state, inputs are set before
initialization, an FMI 1.0 instance is reset in any state, and time is set in event mode.
"""

CO_SIMULATION = {
    "2": {
        "fmi2SetRealInputDerivatives": (INSTANTIATED, INITIALIZATION, STEP),
        "fmi2GetRealOutputDerivatives": (STEP, TERMINATED, ERROR),
        **{f"fmi2Get{kind}Status": STATUS for kind in ("", "Real", "Integer", "Boolean", "String")},
    },
    "3": {"fmi3GetOutputDerivatives": (STEP, TERMINATED, ERROR)},
}
"""What is allowed in co-simulation alone."""

MODEL_EXCHANGE = {
    "2": {
        **dict.fromkeys(("fmi2GetContinuousStates", "fmi2GetDerivatives", "fmi2GetEventIndicators"), EVALUATED),
        "fmi2GetNominalsOfContinuousStates": ANY,
    },
    "3": {
        **dict.fromkeys(("fmi3GetContinuousStates", "fmi3GetContinuousStateDerivatives"), EVALUATED),
        **dict.fromkeys(("fmi3GetEventIndicators", "fmi3GetNominalsOfContinuousStates"), EVALUATED),
        **dict.fromkeys(("fmi3GetNumberOfContinuousStates", "fmi3GetNumberOfEventIndicators"), ANY),
    },
}
"""What is allowed in Model Exchange alone."""

OK, DISCARD, FAILED = "0", "2", "3"


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """A function that builds an FMU of FMUS and its harness, once."""
    known = {}

    def of(name):
        if name not in known:
            folder = tmp_path_factory.mktemp("random_calls")
            known[name] = build(FMUS[name](folder), folder)
        return known[name]

    return of


def kind_of(name):
    """FMI version and whether it is Model Exchange, of the FMU of a name in FMUS."""
    found = re.search(r"_(fmi|me)(\d)", name)
    return (found[2], found[1] == "me") if found else ("2", False)


# Each initialization of an LQG solves Riccati equations: 100,000 calls take a minute. The benchmark makes more.
SLOW, CALLS_OF_LQG = {name: [pytest.mark.slow] for name in LQGS}, 60_000


@needs_sanitizers
@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in FMUS])
def test_random_calls(name, program):
    least = CALLS_OF_LQG if name in LQGS else CALLS
    done = run(program(name), "random", 1, least, calls=least)
    assert done.returncode == 0, done.stderr
    calls, sequences, errors = map(int, re.match(r"(\d+) calls in (\d+) sequences, (\d+) errors", done.stdout).groups())
    assert calls >= least and sequences > 100 and 0.05 < errors / calls < 0.6, "legal and illegal ones"


STATE_MACHINES = [
    *("DiagonalPID_C_fmi1", "DiagonalPID_C", "FlexibleManipulatorNative", "DiagonalPID_C_me2", "DiagonalPID_C_fmi3"),
    *("FlexibleManipulatorNative_me2", "FlexibleManipulatorNative_me3", "FlexibleManipulatorNative_fmi3"),
]


@needs_sanitizers
@pytest.mark.parametrize("name", STATE_MACHINES)
def test_functions_are_allowed_in_the_states_of_the_standard(name, program):
    version, model_exchange = kind_of(name)
    done = run(program(name), "table")
    assert done.returncode == 0, done.stderr
    found = {tuple(line.split()[:2]): line.split()[2] for line in done.stdout.splitlines()}
    of_kind, of_other = (MODEL_EXCHANGE, CO_SIMULATION) if model_exchange else (CO_SIMULATION, MODEL_EXCHANGE)
    allowed = ALLOWED[version] | of_kind.get(version, {}) | dict.fromkeys(of_other.get(version, {}), NONE)
    states = [state for state in STATES if (state != STEP if model_exchange else state not in (EVENT, CONTINUOUS))]
    states = [state for state in states if version != "1" or state != INITIALIZATION]
    assert {state for _, state in found} == set(states)
    assert {function for function, _ in found if "Instantiate" not in function} == set(allowed)
    for function, where in allowed.items():
        for state in states:
            # There is nothing to tell about a step that ended at once, and FMI has a status for that.
            told = DISCARD if function.endswith("Status") and "Real" not in function else OK
            if function == "fmi2GetBooleanStatus":
                told = OK
            assert found[function, state] == (told if state in where else FAILED), (function, state)
