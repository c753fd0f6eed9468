"""The codec: what it writes it reads again, and what it reads is of the type asked for or refused."""

import dataclasses
import math
import subprocess
import sys
from fractions import Fraction

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import inspect

from orchestrator.benchmark import protocol
from orchestrator.benchmark.case import Test as Experiment
from orchestrator.benchmark.results import Measurements
from orchestrator.codec import Malformed, Struct, convert, from_json, pack, plain, to_json, unpack
from orchestrator.conformance import dynamic
from orchestrator.documents.results import Results
from orchestrator.exact_time import seconds
from orchestrator.execution import messages
from orchestrator.pairing import work

assert work and dynamic and messages, "imported for the types they define"


def subclasses(kind: type) -> list[type]:
    return [found for own in kind.__subclasses__() for found in (own, *subclasses(own))]


STRUCTS = sorted(subclasses(Struct), key=lambda kind: (kind.__module__, kind.__name__))
IDS = [f"{kind.__module__.removeprefix('orchestrator.')}.{kind.__name__}" for kind in STRUCTS]


SIMPLE = {
    inspect.BoolType: st.booleans(),
    inspect.BytesType: st.binary(max_size=4),
    inspect.NoneType: st.none(),
    inspect.StrType: st.text(st.characters(codec="utf-8"), max_size=5),
}


def values(of: inspect.Type) -> st.SearchStrategy:
    """Values of a type, as msgspec describes it."""
    match of:
        case inspect.StructType() | inspect.DataclassType():
            return st.builds(of.cls, **{field.name: values(field.type) for field in of.fields})
        case inspect.FloatType():
            low, high = (math.nextafter(0.0, 1.0) if of.gt is not None else of.ge), of.le
            return st.floats(low, high, allow_nan=False, allow_infinity=low is None)
        case inspect.IntType():
            return st.integers(-(2**63) if of.ge is None else of.ge, 2**63 - 1 if of.le is None else of.le)
        case inspect.LiteralType():
            return st.sampled_from(of.values)
        case inspect.EnumType():
            return st.sampled_from(list(of.cls))
        case inspect.UnionType():
            return st.one_of(*map(values, of.types))
        case inspect.VarTupleType():
            return st.lists(values(of.item_type), max_size=2).map(tuple)
        case inspect.TupleType():
            return st.tuples(*map(values, of.item_types))
        case inspect.DictType():
            return st.dictionaries(values(of.key_type), values(of.value_type), max_size=2)
        case inspect.CustomType(cls=np.ndarray):
            return st.lists(st.floats(), max_size=3).map(np.array)
        case inspect.CustomType(cls=cls) if cls is Fraction:
            return st.fractions(max_denominator=10**9, min_value=-(10**9), max_value=10**9)
    return SIMPLE[type(of)]


@pytest.mark.parametrize("kind", STRUCTS, ids=IDS)
@settings(max_examples=5)
@given(data=st.data())
def test_what_is_packed_is_unpacked(kind, data):
    value = data.draw(values(inspect.type_info(kind)))
    packed = pack(value)
    assert pack(unpack(packed, kind)) == packed
    if b"<f8" not in packed:  # arrays do not compare
        assert unpack(packed, kind) == value


@pytest.mark.parametrize("kind", [protocol.Protocol, Results])
@settings(max_examples=5)
@given(data=st.data())
def test_files_say_what_was_written(kind, data):
    value = data.draw(values(inspect.type_info(kind)))
    assert from_json(to_json(value), kind) == value
    assert convert(plain(value), kind) == value


@pytest.mark.parametrize("kind", STRUCTS, ids=IDS)
@settings(max_examples=1)
@given(data=st.data())
def test_other_keys_and_other_types_are_refused(kind, data):
    whole = plain(data.draw(values(inspect.type_info(kind))))
    wrong = [{**whole, "surplus": 1}, [whole], None, 1]
    for field in inspect.type_info(kind).fields:
        wrong.append({**whole, field.name: [[[[]]]]})
        if field.required:
            wrong.append({name: value for name, value in whole.items() if name != field.name})
    for one in wrong:
        with pytest.raises(Malformed):
            unpack(msgspec.msgpack.encode(one), kind)


@given(junk=st.binary(max_size=200))
def test_no_bytes_do_any_harm(junk):
    for kind in (messages.Order, work.CaseTask, Results):
        with pytest.raises(Malformed):
            unpack(junk, kind)
        with pytest.raises(Malformed):
            from_json(junk, kind)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, -1.0, "1", True])
def test_figures_are_finite_and_not_negative(number):
    with pytest.raises(Malformed):
        unpack(msgspec.msgpack.encode({"B5": number}), Measurements)


@pytest.mark.parametrize(
    "text", ["1e300000000", "1e-101", "1/0", "nan", "inf", "soon", "", "1" * 51, "1e1e1", {}, True, None]
)
def test_times_are_bounded_fractions(text):
    with pytest.raises(Malformed):
        convert({"name": "x", "systems": "y", "duration": text}, Experiment)


@given(time=st.fractions(max_denominator=10**9, min_value=-(10**9), max_value=10**9))
def test_times_are_exact(time):
    assert seconds(str(time)) == time
    assert convert({"name": "x", "systems": "y", "duration": str(time)}, Experiment).duration == time


@dataclasses.dataclass(frozen=True)
class Holder:
    """A type with an array."""

    array: np.ndarray


@pytest.mark.parametrize("array", [np.zeros((0, 2)), np.arange(6.0).reshape(3, 2).T, np.float32([1.5, math.nan])])
def test_arrays_keep_shape_and_numbers(array):
    found = unpack(pack(Holder(array)), Holder).array
    assert found.dtype == array.dtype
    np.testing.assert_array_equal(found, array)


WRONG_ARRAYS = [
    *(["<f8", shape, bytes(8)] for shape in ([2], 1, [1.0])),
    *(["<f8", shape, b""] for shape in ([-1], [2**50, 0], [2**40, 2**40])),
    *(["|O", [1], bytes(8)], ["<f8", [1], "text"], ["<f8", [1]], [[], [1], bytes(8)], {"a": 1}, 7),
]


@pytest.mark.parametrize("wrong", WRONG_ARRAYS, ids=repr)
def test_other_arrays_are_refused(wrong):
    with pytest.raises(Malformed):
        unpack(msgspec.msgpack.encode({"array": wrong}), Holder)


TWO_THREADS = """
import threading, time
from orchestrator.codec import Struct, convert

def slow():
    begun.set()
    time.sleep(0.2)
    return int

class Inner(Struct):
    x: "slow()"

class Outer(Struct):
    inner: Inner

begun = threading.Event()
other = threading.Thread(target=convert, args=({"inner": {"x": 1}}, Outer))
other.start()
begun.wait()
print(convert({"inner": {"x": 1}}, Outer).inner.x)
other.join()
"""
"""A type is used while another thread is looking up its fields for the first time."""


def test_two_threads_use_a_type_for_the_first_time() -> None:
    """In a process of its own, which msgspec alone would crash."""
    finished = subprocess.run([sys.executable, "-c", TWO_THREADS], capture_output=True, text=True, check=False)
    assert (finished.returncode, finished.stdout) == (0, "1\n"), finished.stderr
