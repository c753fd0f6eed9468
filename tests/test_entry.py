"""What enters the Python interface is made plain at its border: NumPy's spellings are those of Python."""

import functools
import inspect
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.refusals import refusal

import orchestrator
from orchestrator import Benchmark, Controller, InputError, Variation, entry
from orchestrator.api import benchmark as api
from orchestrator.documents.document import Comparable, Document
from orchestrator.study import stored
from orchestrator.study.evaluate import EvaluationStudy, SpreadStudy
from orchestrator.study.reliability import ReliabilityStudy
from orchestrator.study.sweep import SweepStudy
from orchestrator.study.tune import TuningStudy
from orchestrator.study.verify import VerificationStudy
from orchestrator.study.worst_case import RobustnessStudy

CHECKED_BY_ITSELF = {"compare", "controller_from_mlp", "controller_from_state_space"}
"""Functions whose arguments are documents, or arrays of any spelling."""

RESULTS = {
    name
    for name in orchestrator.__all__
    if inspect.isclass(kind := getattr(orchestrator, name))
    and (issubclass(kind, Document | Comparable | BaseException) or name in ("LinearLoop", "LinearModel", "Simulation"))
}
"""Types that the package makes: they are not called by users, and their files are any paths."""

CASE = Benchmark("quick").cases[0]

numbers = st.floats(0.015625, 8.0, width=16)
"""Exact in half precision, so that all spellings are of the same number."""


def spelled_number(value: float) -> st.SearchStrategy:
    """Ways to write a number that half precision holds."""
    kinds = [float, np.float16, np.float32, np.float64, np.longdouble, np.array, Fraction, Decimal]
    return st.sampled_from([kind(value) for kind in kinds])


def spelled_int(value: int) -> st.SearchStrategy:
    """Ways to write a small natural number."""
    kinds = [int, float, np.int8, np.uint8, np.int16, np.int64, np.uint64, np.float32, np.array, Fraction, Decimal]
    return st.sampled_from([kind(value) for kind in kinds])


def spelled_sequence(values: tuple, spelled) -> st.SearchStrategy:
    """Ways to write a sequence."""
    items = st.tuples(*map(spelled, values))
    return st.one_of(items, items.map(list), st.just(np.array(values)))


def spelled_text(value: str) -> st.SearchStrategy:
    """Ways to write a text."""
    return st.sampled_from([value, np.str_(value), np.array(value)])


def spelled_path(value: str) -> st.SearchStrategy:
    """Ways to write a path; two of them stay what they are."""
    return st.sampled_from([value, np.str_(value), np.array(value), Path(value), PurePosixPath(value)])


def spelled_time(value: str) -> st.SearchStrategy:
    """Ways to write a time [s]."""
    kinds = [str, float, np.float32, np.float64, Fraction, Decimal, np.str_, lambda v: np.array(float(v))]
    return st.sampled_from([kind(value) for kind in kinds])


def with_plain(plain: st.SearchStrategy, spelled) -> st.SearchStrategy:
    """Pairs of a plain value and another spelling of it."""
    return plain.flatmap(lambda value: st.tuples(st.just(value), spelled(value)))


def mapped(pairs: st.SearchStrategy) -> st.SearchStrategy:
    """The same as values of a mapping by name."""
    return pairs.map(lambda pair: ({"K_p[1]": pair[0]}, {np.str_("K_p[1]"): pair[1]}))


flag = with_plain(st.booleans(), lambda value: st.sampled_from([value, np.bool_(value), np.array(value)]))
number = with_plain(numbers, spelled_number)
count = with_plain(st.integers(1, 100), spelled_int)
pair = with_plain(st.tuples(numbers, numbers), lambda value: spelled_sequence(value, spelled_number))
word = with_plain(st.sampled_from(["nominal", "box"]), spelled_text)
instant = with_plain(st.sampled_from(["0.5", "0.001", "2"]), spelled_time)
words = with_plain(st.just(("A2", "B5")), lambda value: spelled_sequence(value, spelled_text))
place = with_plain(st.just("strict"), spelled_path)
sequence = with_plain(st.lists(numbers, min_size=1).map(tuple), lambda value: spelled_sequence(value, spelled_number))

SPELLED = {
    "bool": flag,
    "int": count,
    "float": number,
    "str": word,
    "str | Path": place,
    "Pair": pair,
    "Limits": pair,
    "Delays": with_plain(
        st.just(("0.5", "0.001")),
        lambda v: st.tuples(*map(spelled_time, v)).flatmap(
            lambda t: st.sampled_from([t, list(t), np.array([0.5, 0.001])])
        ),
    ),
    "Fraction": instant,
    "Fraction | float | str": instant,
    "tuple[float, float]": pair,
    "Iterable[int]": with_plain(st.just((3, 1)), lambda value: spelled_sequence(value, spelled_int)),
    "Sequence[str]": words,
    "Sequence[str] | str": st.one_of(word, words),
    "Mapping[str, float]": mapped(number),
    "Mapping[str, float] | str | Path": st.one_of(
        place, mapped(with_plain(numbers, spelled_number)), mapped(flag), mapped(word)
    ),
    "Mapping[str, Scalar]": st.one_of(mapped(with_plain(numbers, spelled_number)), mapped(flag), mapped(word)),
    "Mapping[str, Scalar | Sequence[Scalar]] | str | Path": st.one_of(
        place, mapped(with_plain(numbers, spelled_number)), mapped(flag), mapped(word)
    ),
    "Mapping[str, str] | str | Path": st.one_of(place, mapped(word)),
    "Mapping[str, Sequence[float]]": mapped(sequence),
    "Mapping[str, Range | tuple[float, float] | tuple[float, float, str]]": mapped(
        with_plain(st.just((0.5, 2.0)), lambda value: spelled_sequence(value, spelled_number))
    ),
    "Given": place,
    "Given | object": place,
    "Case | str": word,
    "Distribution": word,
    "Friction": word,
    "Order": word,
    "LibraryKind": word,
    "Sequence[Fraction | float | str]": with_plain(
        st.just(("0.5", "0.001")), lambda values: spelled_sequence(values, spelled_time)
    ),
}
"""By annotation: values and other spellings of them."""


def functions():
    """Public functions and methods by name, with those that classes inherit."""
    for name in orchestrator.__all__:
        own = getattr(orchestrator, name)
        if inspect.isclass(own) and name not in RESULTS:
            methods = {key: getattr(own, key) for key in dir(own) if key[0] != "_"}
            yield from ((f"{name}.{key}", method) for key, method in methods.items() if callable(method))
        elif callable(own) and name not in RESULTS | CHECKED_BY_ITSELF:
            yield name, own


INHERITED = {"Benchmark.pairing", "Benchmark.prepared", "Benchmark.sampled", "Controller.of", "Controller.built_in"}
"""Methods for the package itself, and those whose only argument has a check of its own."""

PUBLIC = {name: own for name, own in functions() if name not in INHERITED}


def hints(function) -> dict[str, str]:
    """Annotations of parameters, without None."""
    listed = inspect.signature(function).parameters.values()
    return {each.name: str(each.annotation).removesuffix(" | None") for each in listed if each.name != "self"}


def parameters(function) -> dict[str, str]:
    """Those of parameters that something other than the package's own types can be given for."""
    return {name: kind for name, kind in hints(function).items() if kind not in entry.OBJECTS}


TAKING = {name: own for name, own in PUBLIC.items() if parameters(own)}


@pytest.mark.parametrize("name", TAKING)
def test_every_public_function_has_the_border(name):
    """One that is new has it, or fails here."""
    assert hasattr(TAKING[name], "__wrapped__"), f"{name} is not decorated by entered"


def test_every_rule_is_tried():
    assert set(entry.RULES) == set(SPELLED)


@given(st.data())
@pytest.mark.parametrize("name", TAKING)
def test_numpy_spells_the_same_as_python(name, data):
    """What the function itself gets, by type and value, whatever the spelling."""
    plain, spelled = {}, {}
    for parameter, kind in parameters(TAKING[name]).items():
        plain[parameter], spelled[parameter] = data.draw(SPELLED[kind], parameter)
    assert shape(received(TAKING[name], plain)) == shape(received(TAKING[name], spelled))


@functools.cache
def standing_in(kind):
    """A function, or an object whose type has the name of one of the package's."""
    return print if kind.startswith("On") else type(kind.partition("[")[0], (), {})()


def received(function, arguments):
    """What a function gets for arguments, by its parameters."""
    others = {name: standing_in(kind) for name, kind in hints(function).items() if kind in entry.OBJECTS - {"Any"}}
    others |= arguments
    return entry.border(function.__wrapped__)(None, **others).arguments


def shape(value):
    """Values with their exact types; a path counts as its text."""
    if isinstance(value, Path):
        return shape(str(value))
    if isinstance(value, dict):
        return {key: shape(item) for key, item in value.items()} | {"": {type(key) for key in value}}
    if isinstance(value, list | tuple):
        return [type(value), *map(shape, value)]
    return type(value), value


FIELDS = {
    Benchmark: ("seed", "workers", "timeout", "sandbox", "wait"),
    Variation: tuple(
        each for each in inspect.signature(Variation).parameters if each not in ("angle_bits", "torque_bits", "dropout")
    ),
    EvaluationStudy: ("only", "recordings", "keep_going", "force"),
    SpreadStudy: ("seeds",),
    RobustnessStudy: ("budget", "minutes", "protocol", "only", "restarts", "from_list", "recordings"),
    ReliabilityStudy: ("draws", "more", "only"),
    TuningStudy: ("vary", "trials", "objective", "strict", "robust", "search_seed"),
    SweepStudy: ("values", "objective"),
    VerificationStudy: ("count", "strict", "protocol"),
}


@given(st.data())
@pytest.mark.parametrize("kind", FIELDS)
def test_the_fields_of_conditions_are_plain(kind, data):
    pairs = {name: data.draw(SPELLED[own], name) for name, own in hints(kind).items() if name in FIELDS[kind]}
    if "more" in pairs:  # the two exclude each other
        pairs.pop(data.draw(st.sampled_from(("draws", "more"))))
    plain, spelled = (kind(**{name: pair[which] for name, pair in pairs.items()}) for which in (0, 1))
    assert shape(vars(plain)) == shape(vars(spelled))


@settings(max_examples=20)  # each looks for a sandbox
@given(mapped(number), number, flag)
def test_stored_keys_do_not_depend_on_the_spelling(values, stiffness, sandbox):
    keys = []
    for which in (0, 1):
        bench = Benchmark("quick", plant_parameters={"m[1]": 50.0 + float(stiffness[0])}, sandbox=sandbox[which])
        pairing = bench.pairing(Controller(parameters=values[which]))
        keys.append((stored.keys(bench.rules, [CASE], pairing), pairing.restrictions))
    assert keys[0] == keys[1]


def test_a_pose_of_numpy_is_that_of_python():
    bench, pose = Benchmark("quick"), np.radians((45, -60))
    plain = bench.case_at((float(pose[0]), float(pose[1])), variation=Variation(phi_F=0.5, duration="0.01"))
    spelled = bench.case_at(pose, variation=Variation(phi_F=np.float64(0.5), duration=np.float32(0.01)))
    assert repr(spelled) == repr(plain)
    assert np.array_equal(bench.simulate(case=spelled).q_m, bench.simulate(case=plain).q_m)
    assert np.array_equal(bench.linearize(pose).A, bench.linearize(list(pose)).A)


REFUSED = {
    "a text as a number": lambda: Benchmark("quick", timeout="long"),
    "a complex number": lambda: Benchmark("quick", timeout=np.complex128(60.0)),
    "not a number": lambda: Benchmark("quick").robustness(minutes=float("nan")),
    "half a seed": lambda: Benchmark("quick", seed=np.float64(0.5)),
    "a pose of one angle": lambda: Benchmark("quick").case_at(np.array([0.5])),
    "a switch as a probability": lambda: Variation(dropout=True),
    "a switch as a mass": lambda: Benchmark("quick", plant_parameters={"m[1]": True}),
    "a switch of NumPy as a force": lambda: Variation(force=np.True_),
    "a pose in a set": lambda: Benchmark("quick").case_at({0.1, 0.2}),
    "a gain by name": lambda: Variation(gain={1: 2.0, 2: 1.0}),
    "delays as digits": lambda: Variation(delay="12"),
    "a pose of three angles": lambda: Benchmark("quick").case_at((0.1, 0.2, 0.3)),
    "a pose that is a number": lambda: Benchmark("quick").case_at(0.5),
    "an infinite pose": lambda: Benchmark("quick").case_at((np.inf, 0.0)),
    "an array of objects": lambda: Benchmark("quick").case_at(np.array([object(), object()])),
    "a matrix": lambda: Benchmark("quick").case_at(np.eye(2)),
    "a number as a folder": lambda: Benchmark("quick").evaluate(folder=3),
    "a number as a switch": lambda: Benchmark("quick").evaluate(force=2),
    "a number as a mapping": lambda: Controller(mapping=3),
    "a value of no variable": lambda: Controller(parameters={"K_p[1]": object()}),
    "an array of parameters": lambda: Benchmark("quick").sweep(values={"K_p[1]": np.eye(2)}),
    "a range that is a number": lambda: Benchmark("quick").tune(vary={"K_p[1]": 20.0}),
    "a range of another scale": lambda: Benchmark("quick").tune(vary={"K_p[1]": (20.0, 80.0, "linear")}),
    "a range of one number": lambda: Benchmark("quick").tune(vary={"K_p[1]": (20.0,)}),
    "a matrix as a value": lambda: Controller(parameters={"K_p": np.array([[45.0, 15.0]])}),
    "a number as a case": lambda: Benchmark("quick").simulate(case=3),
    "a mapping as a variation": lambda: Benchmark("quick").case_at((0.1, 0.2), variation={"gain": 1}),
    "a path as a certificate": lambda: Benchmark("quick").repeat("x.json"),
    "a number as a function": lambda: Benchmark("quick").evaluate(on_result=3),
    "a text to compare": lambda: orchestrator.compare("abc"),
    "numbers to compare": lambda: orchestrator.compare([1]),
    "nothing to compare": lambda: orchestrator.compare(None),
    "nothing to load": lambda: orchestrator.Evaluation.load(None),
    "no certificate to load": lambda: orchestrator.Verification.load(3),
    "no simulation to load": lambda: orchestrator.Simulation.load(None),
    "a date": lambda: Variation(force=np.datetime64("2026-01-01")),
    "a probability of 0": lambda: Benchmark("quick").reliability(probability=0),
    "a confidence of 1": lambda: Benchmark("quick").reliability(confidence=np.float32(1.0)),
    "a byte of memory": lambda: Benchmark("quick", memory_limit=1),
    "no workers": lambda: Benchmark("quick", workers=0),
    "no draws": lambda: Benchmark("quick").verify(count=0),
    "no start": lambda: Benchmark("quick").robustness(restarts=0),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_is_none_is_refused_in_one_sentence(what, monkeypatch):
    monkeypatch.setattr("orchestrator.study.engine.can_fence", lambda: False)
    message = str(refusal(REFUSED[what], kind=InputError))
    assert message.endswith(".") and "\n" not in message and len(message) < 200


def test_a_limit_that_no_process_keeps_and_no_workers_are_told_by_their_names():
    assert refusal(Benchmark, memory_limit=1).where == "memory_limit"
    problem = refusal(Benchmark, workers=0)
    assert problem.where == "workers" and "seed" not in str(problem)
    assert Benchmark(memory_limit=300e6).memory_limit == 300e6


@pytest.mark.parametrize(
    "change",
    [
        {"noise_power": -1e-12},  # the square root of it was a ValueError
        {"torque_limit": (35.0, -20.0)},
        {"delay": ("-0.001", "0")},
        {"sensor_delay": (0, -1)},
        {"jitter": "-1e-4"},
        {"chirp_frequencies": (-1.0, 5.0)},
        *({name: -0.5} for name in ("t_1", "t_2", "t_3", "t_4")),
    ],
    ids=lambda change: next(iter(change)),
)
def test_what_cannot_be_negative_is_refused_by_its_name(change):
    problem = refusal(Variation, **change)
    assert (problem.what, problem.where) == ("bad-number", next(iter(change)))
    assert Variation(gain=(-1.0, 1.0), force=-5.0, chirp_amplitude=(-1.0, 1.0))


def test_a_limit_may_be_infinite():
    """``simulate --torque-limit inf inf``, and the limit of an ideal loop given once more."""
    bench = Benchmark("quick")
    varied = bench.varied(bench.cases[0], Variation(torque_limit=np.array([np.inf, 35.0])))
    assert varied.scenario.drive.limit == (np.inf, 35.0)


def test_the_steps_of_the_torque_follow_its_limit():
    """Else a limit of 5 N.m lets 5.007 pass: the nearest step of the protocol's 35 N.m."""
    bench = Benchmark("quick")

    def quantum(*variations):
        case = bench.cases[0]
        for variation in variations:
            case = bench.varied(case, variation)
        return case.scenario.drive.quantum

    own, limited = Variation(duration=1), Variation(torque_limit=(5.0, 3.0))
    assert quantum() == quantum(own) == (70.0 / 4096, 40.0 / 4096)
    assert quantum(limited) == quantum(limited, own) == (10.0 / 4096, 6.0 / 4096)
    assert quantum(Variation(torque_limit=(np.inf, 3.0))) == (70.0 / 4096, 6.0 / 4096), "an infinite one has no steps"
    assert quantum(Variation(torque_limit=(np.inf, np.inf)), limited) == quantum(limited)
    eight = Variation(torque_bits=8)
    assert quantum(eight, limited) == quantum(limited, eight) == (10.0 / 256, 6.0 / 256)
    assert quantum(replace(limited, torque_bits=0)) == quantum(replace(limited, ideal=True)) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("method", "given", "near"),
    [
        ("reliability", {"probabilty": 0.1}, "probability"),
        ("verify", {"strickt": True}, "strict"),
        ("evaluate", {"onli": ""}, "only"),
    ],
)
def test_an_option_that_there_is_not_is_told_with_the_method_and_the_nearest(method, given, near):
    problem = refusal(getattr(Benchmark("quick"), method), **given)
    assert (problem.what, problem.where) == ("no-option", method) and near in problem.nearest
    assert f"Benchmark.{method} has no option" in str(problem)


def test_a_parameter_without_a_rule_fails_when_its_function_is_defined():
    def function(what: "set[int]"):
        """Has a parameter that nobody has thought of."""

    with pytest.raises(TypeError, match=r"set\[int\]"):
        entry.entered(function)
    assert api.entered is entry.entered
