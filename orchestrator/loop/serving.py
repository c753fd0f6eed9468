"""The other side of a loop whose controller is in another process: q_m comes in, u_m goes out, nothing else."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..fmi.port import ANSWER_BYTES, GO_ON, LOST, REQUEST_BYTES, Port, c_function, exchange, unconnected
from ..jit import call_status, compiled


class Channel(NamedTuple):
    """Descriptors of the two pipes, and the addresses of the C functions read and write."""

    requests: int
    answers: int
    read: int
    write: int


def channel(requests: int, answers: int) -> Channel:
    """The channel of two pipes."""
    return Channel(requests, answers, c_function("read"), c_function("write"))


@compiled
def serve(port: Port, channel: Channel, interval: int, denominator: int, fields: np.ndarray) -> float:
    """Answer requests for steps of ``interval / denominator`` [s] until one wants something else, which is returned;
    NaN if there is nobody any more, LOST if the controller's library was in a process that is gone. ``fields`` is
    memory for four float64."""
    at = fields.ctypes.data
    k = 0
    while call_status(channel.read, (channel.requests, at, np.int64(REQUEST_BYTES))) == REQUEST_BYTES:
        if fields[0] != GO_ON:
            return float(fields[0])
        for i in range(2):
            port.input_values[i] = port.scale[i] * (fields[1 + i] - port.offset[i])
        t = k * interval / denominator
        call, status = exchange(port, port.inputs.size, t, interval / denominator, True)
        if status == LOST:
            return float(LOST)
        fields[0], fields[1] = call, status
        for i in range(2):
            fields[2 + i] = port.output_scale[i] * port.output_values[i]
        if call_status(channel.write, (channel.answers, at, np.int64(ANSWER_BYTES))) != ANSWER_BYTES:
            break
        k += 1
    return np.nan


def warm_up() -> None:
    """Load the machine code, or once compile it."""
    serve(unconnected((), 2, (), 2), channel(-1, -1), 1, 4000, np.zeros(4))
