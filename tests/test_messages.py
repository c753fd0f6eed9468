"""What a child process may send to its parent: results as every Python writes them, and nothing else."""

from __future__ import annotations

import copyreg
import os
import pickle
from fractions import Fraction
from multiprocessing import Pipe

import numpy as np
import pytest

from orchestrator.cosim.trajectory import Ending, Status
from orchestrator.errors import FmuError
from orchestrator.execution.job import Failed, Finished
from orchestrator.execution.messages import Garbage, Inbox, send


class Reduced:
    """Pickles as a call of ``function`` with ``arguments``."""

    def __init__(self, function, *arguments):
        self._call = (function, arguments)

    def __reduce__(self):
        return self._call


def received(message):
    """``message`` after its way through a pipe."""
    reader, writer = Pipe(duplex=False)
    with reader, writer:
        send(writer, message)
        inbox = Inbox(reader.fileno())
        assert inbox.receive()
        (found,) = inbox.messages()
    return found


def test_outcomes_arrive():
    values = {"time": Fraction(1, 4000), "torque": np.arange(4.0).reshape(2, 2), "last": np.float64(0.1)}
    found = received(Finished(3, values, 0.5))
    assert (found.index, found.wall_time) == (3, 0.5) and found.value["time"] == Fraction(1, 4000)
    np.testing.assert_array_equal(found.value["torque"], values["torque"])
    assert received(Ending(Status.DONE, 1.0)) == Ending(Status.DONE, 1.0)
    assert str(received(Failed(0, FmuError("it failed", "fmi2DoStep", ("why",)), 0.1)).error) == "it failed\n  why"


def test_what_others_have_registered_with_pickle_plays_no_part(monkeypatch):
    """Dask registers a way to pickle every exception, wherever it is imported."""
    monkeypatch.setitem(copyreg.dispatch_table, FmuError, lambda error: (os.getcwd, ()))
    assert str(received(Failed(0, FmuError("it failed"), 0.1)).error) == "it failed"


def test_members_of_enumerations_as_python_3_11_0_to_3_11_3_write_them():
    """Debian 12 has such a Python."""
    assert received(Reduced(getattr, Status, "DONE")) is Status.DONE


@pytest.mark.parametrize(
    "message",
    [
        Reduced(os.getcwd),
        Reduced(getattr, Status, "__class__"),
        Reduced(getattr, Ending, "__init__"),
        Reduced(getattr, Reduced(getattr, Status, "DONE"), "title"),
        Reduced(eval, "1 + 1"),
        os.system,
        Reduced,
    ],
    ids=lambda message: str(getattr(message, "_call", message)),
)
def test_nothing_else_is_made(message):
    with pytest.raises(Garbage, match="has no place in a message"):
        received(message)


def test_what_is_no_message_is_refused():
    reader, writer = os.pipe()
    os.write(writer, b"\x00\x00\x00\x05hello")
    inbox = Inbox(reader)
    assert inbox.receive()
    with pytest.raises(Garbage):
        list(inbox.messages())
    os.close(writer)
    os.close(reader)


def test_a_message_in_pieces_is_awaited():
    reader, writer = os.pipe()
    whole = pickle.dumps("goodbye")
    frame = len(whole).to_bytes(4, "big") + whole
    inbox = Inbox(reader)
    for piece in (frame[:2], frame[2:7]):
        os.write(writer, piece)
        assert inbox.receive() and list(inbox.messages()) == []
    os.write(writer, frame[7:])
    assert inbox.receive() and list(inbox.messages()) == ["goodbye"]
    os.close(writer)
    assert not inbox.receive()
    os.close(reader)
