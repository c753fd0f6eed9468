"""Messages: what is sent arrives, and whatever else comes through a channel is refused."""

import math
import os
import socket
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.closed_loops import quiet

from orchestrator.benchmark import protocol
from orchestrator.benchmark.cases import cases
from orchestrator.codec import Malformed, pack
from orchestrator.documents.recording import OBSERVED, record
from orchestrator.errors import BenchmarkError, EnvironmentFault, FmuError, InputError
from orchestrator.execution.messages import (
    MAX_TEXT,
    OVERHEAD,
    Failed,
    Finished,
    FmuFiles,
    Garbage,
    Inbox,
    Loaded,
    Order,
    error_of,
    error_record,
    frame,
    read_frame,
    readable,
)
from orchestrator.loop.scenario import Recurrence
from orchestrator.loop.trajectory import Ending, Status, blank
from orchestrator.pairing import work
from plant_fmu.flexible_manipulator.parameters import NOMINAL

LARGEST = 1000


@pytest.mark.parametrize("seconds", [Fraction(1, 4000), Fraction(26), Fraction(60)])
def test_a_whole_trajectory_fits_into_the_largest_message(seconds):
    """With words of an ending as long as they come; and not much more fits."""
    scenario = quiet(seconds)
    rows = {name: shape[0] for name, shape in blank(scenario.samples).shapes[0].items()}
    assert set(rows.values()) == {scenario.samples, scenario.samples + 1}
    worst = replace(
        blank(scenario.samples, OBSERVED), ending=Ending(Status.ERROR, 60.0, "x" * MAX_TEXT, 2**53, "y" * 500)
    )
    size, largest = len(pack(worst)), work.largest_trajectory(scenario)
    assert size <= largest <= size + (1 << 16)
    assert work.trajectory(scenario.samples, OBSERVED, pack(worst)).shapes == worst.shapes


@pytest.mark.parametrize("name", [*blank(2).shapes[0], *OBSERVED])
@pytest.mark.parametrize("shape", [(), (3,), (2, 2), (3, 2), (3, 3), (4, 2), (0, 2)])
def test_a_signal_of_another_size_is_refused(name, shape):
    found = blank(2, OBSERVED)
    expected = {**found.shapes[0], **found.shapes[1]}[name]
    other = {name: np.zeros(shape)}
    sent = pack(replace(found, extra=found.extra | other) if name in OBSERVED else replace(found, **other))
    if shape == expected:
        assert work.trajectory(2, OBSERVED, sent).shapes == found.shapes
    else:
        with pytest.raises(Malformed):
            work.trajectory(2, OBSERVED, sent)


@pytest.mark.parametrize(
    "other", [{}, {"again": Recurrence(1e-9, 10**9)}, {"id": "c99.other"}, {"roles": ()}, {"duration": 1e300}]
)
def test_a_recording_of_another_case_than_asked_for_is_refused(other):
    """For each coming of a force a report has a place: one that told of 10^9 filled the memory of whoever wrote it."""
    (case, *_), roles = cases(protocol.load("quick"), NOMINAL, 0), ("example",)
    samples = case.scenario.samples
    sent = record(case, roles, replace(blank(samples, OBSERVED), time=np.arange(samples + 1)))
    sent = replace(sent, about=msgspec.structs.replace(sent.about, **other))
    if not other:
        assert work.recording(case, roles, pack(sent)).about == sent.about
    else:
        with pytest.raises(Malformed, match="another case"):
            work.recording(case, roles, pack(sent))


@pytest.mark.parametrize("extra", [{}, dict.fromkeys((*OBSERVED, "X"), np.zeros(3)), dict.fromkeys("ab", np.zeros(3))])
def test_other_outputs_than_asked_for_are_refused(extra):
    with pytest.raises(Malformed):
        work.trajectory(2, OBSERVED, pack(replace(blank(2), extra=extra)))


@contextmanager
def channel(*pieces: bytes):
    """An inbox, and a function that sends to it."""
    near, far = socket.socketpair()
    with near, far:
        for piece in pieces:
            far.sendall(piece)
        yield Inbox(near.fileno(), LARGEST), far


def received(data: bytes) -> list:
    """The messages in ``data``."""
    with channel(data) as (inbox, _):
        assert inbox.receive()
        return list(inbox.messages())


@given(index=st.integers(0, 2**53), value=st.binary(max_size=LARGEST), wall_time=st.floats(0.0, 1e300))
def test_messages_arrive(index, value, wall_time):
    sent = [Loaded(), Finished(index, value, wall_time), Failed(index, error_record(FmuError("x", "call")), wall_time)]
    assert received(b"".join(map(frame, sent))) == sent


ERRORS = [
    FmuError("it failed", "fmi2DoStep", ("why", "and where")),
    InputError("no such", "no-case", "file", "value", ("near", "nearer")),
    EnvironmentFault("no disk", "disk"),
    BenchmarkError("otherwise"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_errors_keep_type_words_and_fields_and_fit_into_a_message(error):
    """Words of FMUs may be long, and of characters that cannot be sent."""
    found = error_of(error_record(error))
    assert (type(found), str(found), vars(found)) == (type(error), str(error), vars(error))
    huge = "\N{GRINNING FACE}\ud800" * 10**6
    loud = type(error)(huge)
    loud.log = loud.nearest = (huge,) * 1000
    loud.call = loud.what = loud.value = huge
    assert len(frame(Failed(0, error_record(loud), 0.1))) < OVERHEAD


FINISHED = {"type": "Finished", "index": 0, "value": b"", "wall_time": 0.0}
FAILED = {"type": "Failed", "index": 0, "error": {"kind": "other", "message": "x"}, "wall_time": 0.0}
WRONG = [
    *(b"hello", b"", b"\x91" * 900, pack(None), pack(["Loaded"]), pack({"type": "Order"})),
    *(pack(FINISHED | change) for change in ({"index": -1}, {"index": 2**60}, {"index": 0.5}, {"value": "text"})),
    *(pack(FINISHED | {"wall_time": time}) for time in (math.nan, math.inf, -1.0, "1")),
    *(pack({"type": "Loaded", "more": 1}), pack({"type": "Finished", "index": 0, "value": b""})),
    pack(FAILED).replace(b"\xa1x", b"\xa3\xed\xa0\x80"),  # a lone surrogate
    pack(FAILED | {"error": {"kind": "SystemExit", "message": "x"}}),
]


@pytest.mark.parametrize("message", WRONG, ids=lambda data: repr(data[:40]))
def test_what_is_no_message_is_refused(message):
    with pytest.raises(Garbage):
        received(len(message).to_bytes(4, "big") + message)


@pytest.mark.parametrize("length", [LARGEST + OVERHEAD + 1, 2**31, 2**32 - 1])
def test_a_length_beyond_the_limit_is_refused_before_anything_is_waited_for(length):
    with pytest.raises(Garbage):
        received(length.to_bytes(4, "big"))


def test_a_message_in_pieces_is_waited_for():
    whole = frame(Finished(1, b"x", 0.5))
    with channel() as (inbox, far):
        for piece in (whole[:2], whole[2:7], whole[7:-1]):
            far.sendall(piece)
            assert inbox.receive() and list(inbox.messages()) == []
        far.sendall(whole[-1:])
        assert inbox.receive() and list(inbox.messages()) == [Finished(1, b"x", 0.5)]
        far.close()
        assert not inbox.receive()


def test_an_order_arrives_and_one_that_is_cut_short_does_not():
    files = FmuFiles("x.fmu", "0" * 64, "/nowhere")
    order = Order(files, files, "module:function", (b"task",))
    near, far = socket.socketpair()
    with near, far:
        far.sendall(frame(order) + frame(order)[:-1])
        far.shutdown(socket.SHUT_WR)
        assert read_frame(near.fileno(), Order) == order
        with pytest.raises(EOFError):
            read_frame(near.fileno(), Order)


def test_readable_is_what_can_be_read():
    silent, one = os.pipe()
    closed, other = os.pipe()
    os.close(other)
    try:
        assert readable((silent, closed), 10.0) == {closed}
        assert readable((silent,), -1.0) == set()
    finally:
        for descriptor in (silent, one, closed):
            os.close(descriptor)
