"""Native access to an instantiated slave from the compiled loop: one exchange of values around one step.

FMI 1, 2 and 3 co-simulation differ in how a step is called. Model Exchange controllers are stepped here too, from event
to event: every sample is one, since inputs jump there, and between two of them the solver integrates if there is one. A
slave in another process is reached through two pipes, one write and one read per step: a controller that its process
serves as this one would, or a library of Windows in its host (:mod:`.host`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..jit import call_status, compiled, inlined
from .trace import CALL, NOBODY, SIDE

SET, STEP, GET = range(3)
"""Which FMI call failed."""

WARNING = 1
"""Highest FMI status that does not end a simulation."""

FATAL = 4
"""The FMI status after which no function of the library may be called, for any instance."""

TERMINATED, EARLY_RETURN, ENDLESS_EVENTS = 2**32, 2**32 + 1, 2**32 + 2
"""What stepping reports beyond the FMI statuses: the FMU asked to end the simulation, stopped short of the end of
the step, or goes on asking for another event iteration. No status an FMU can return is as large."""

EVENT_MODE = 2**32 + 4
"""The same of an FMU (FMI 3) that waits for event mode, though it was told that the master does not use it."""

LOST = 2**32 + 3
"""What stepping reports of a slave in another process that is gone, or sends what is no answer."""

ARITHMETIC_CHANGED = 2**33
"""The same of a host whose FMU has changed how it computes: this plus the word that :mod:`orchestrator.jit` reads."""

MAX_STATUS = ARITHMETIC_CHANGED + 2**16
"""No status is larger."""

CO_SIMULATION, CO_SIMULATION_3, EVENTS, EVENTS_3, REMOTE, HOSTED = range(6)
"""How a slave is stepped: doStep of FMI 1 and 2, doStep of FMI 3, events of FMI 2 and FMI 3 Model Exchange; in
another process; or in the host of a library."""

REQUESTS, ANSWERS = range(2)
"""Entries of ``Port.functions`` of a remote slave: descriptors of the pipes there and back. Its ``set_values`` and
``get_values`` are the C functions write and read."""

END, GO_ON, LEAVE = 0.0, 1.0, 2.0
"""First number of a request: terminate and end, step, or end at once."""

REQUEST_BYTES, ANSWER_BYTES = 24, 32
"""Sizes of a request (what to do, two signals) and of its answer (call, status, two signals), all float64."""

HOSTED_BYTES = 40
"""Size of a request to a host, which also holds the time and the step [s]."""

SET_TIME, ENTER_EVENTS, UPDATE, ENTER_CONTINUOUS, COMPLETED = range(5)
"""Functions of Model Exchange in ``Port.functions``."""

NEXT_EVENT, IN_EVENT_MODE, REACHED, STATE_EVENT = range(4)
"""Entries of ``Port.clock``: time of the next time event [s], 1 while the FMU is in event mode; and what a solver
reports: the time it has reached [s], 1 if a state event stopped it there."""

MAX_ITERATIONS = 1000
"""Event iterations at one time, after which an FMU is given up on."""


class Port(NamedTuple):
    """C functions by address, value references and value buffers of one slave.

    ``inputs`` and ``outputs`` are uint32 value references; a reference to an array stands for all its elements, and
    the value buffers (float64) hold the elements. If ``single`` is true, inputs or outputs are Float32 and pass
    through the buffers of that type. ``scale`` and ``offset`` turn a signal into an input value, scale (signal -
    offset), and ``output_scale`` an output value into a signal.
    """

    stepping: int
    with_sizes: bool
    """Whether get and set take the number of values beside the number of references, as in FMI 3."""
    instance: int
    set_values: int
    do_step: int
    """doStep, or in Model Exchange the solver, with the arguments of FMI 2's; 0 if there is nothing to solve."""
    get_values: int
    functions: np.ndarray
    """int64 addresses, shape (5,); 0 for a function that must not be called."""
    clock: np.ndarray
    """float64, shape (4,)."""
    info: np.ndarray
    """float64, shape (5,): memory for what an FMU reports through pointers, and for requests to another process."""
    inputs: np.ndarray
    input_values: np.ndarray
    outputs: np.ndarray
    output_values: np.ndarray
    single: tuple[bool, bool]
    input_singles: np.ndarray
    output_singles: np.ndarray
    offset: np.ndarray
    scale: np.ndarray
    output_scale: np.ndarray
    side: int
    trace: np.ndarray
    """Words of :class:`orchestrator.fmi.trace.Trace`: before each call it is noted there."""


def unconnected(inputs: Sequence[int], size_in: int, outputs: Sequence[int], size_out: int) -> Port:
    """A port with these value references and buffers of these sizes, but without functions; signals are values."""
    return Port(
        stepping=CO_SIMULATION,
        with_sizes=False,
        instance=0,
        set_values=0,
        do_step=0,
        get_values=0,
        functions=np.zeros(5, dtype=np.int64),
        clock=np.array([np.inf, 1.0, 0.0, 0.0]),
        info=np.zeros(5),
        inputs=np.array(inputs, dtype=np.uint32),
        input_values=np.zeros(size_in),
        outputs=np.array(outputs, dtype=np.uint32),
        output_values=np.zeros(size_out),
        single=(False, False),
        input_singles=np.zeros(size_in, dtype=np.float32),
        output_singles=np.zeros(size_out, dtype=np.float32),
        offset=np.zeros(2),
        scale=np.ones(2),
        output_scale=np.ones(2),
        side=NOBODY,
        trace=np.zeros(4, dtype=np.int64),
    )


def c_function(name: str) -> int:
    """Address of a function of the C library."""
    return ctypes.cast(getattr(ctypes.CDLL(None), name), ctypes.c_void_p).value or 0


@inlined
def exchange(port: Port, count: int, time: float, step: float, read: bool) -> tuple[int, int]:
    """Write the first ``count`` inputs, advance by ``step`` [s] from ``time`` [s], read the outputs if ``read``.

    Returns the last call made (SET, STEP or GET) and its status; a status above WARNING ends the exchange.
    """
    # Before each call: a crash leaves no other witness of whose code it was.
    port.trace[SIDE] = port.side
    if port.stepping == REMOTE:
        return _exchange_remote(port, np.int64(REQUEST_BYTES))
    if port.stepping == HOSTED:
        port.info[3], port.info[4] = time, step
        return _exchange_remote(port, np.int64(HOSTED_BYTES))
    if port.stepping == EVENTS or port.stepping == EVENTS_3:
        return _exchange_events(port, count, time, step, read)
    written = _write(port, count) if count > 0 else 0
    if written > WARNING:
        return SET, written
    port.trace[CALL] = 1 + STEP
    if port.stepping == CO_SIMULATION:
        stepped = call_status(port.do_step, (port.instance, time, step, np.int32(1)))
    else:
        stepped = _do_step_3(port, time, step)
    if stepped > WARNING:
        return STEP, stepped
    got = _read(port) if read else 0
    return GET, max(written, stepped, got)


@inlined
def _exchange_remote(port: Port, size: np.int64) -> tuple[int, int]:
    """A controller's process knows the time, as it counts the steps; a host is told."""
    port.trace[CALL] = 1 + STEP
    at, fields = port.info.ctypes.data, port.info
    fields[0], fields[1], fields[2] = GO_ON, port.input_values[0], port.input_values[1]
    if call_status(port.set_values, (port.functions[REQUESTS], at, size)) != size:
        return STEP, LOST
    if call_status(port.get_values, (port.functions[ANSWERS], at, np.int64(ANSWER_BYTES))) != ANSWER_BYTES:
        return STEP, LOST
    # The answer comes from a process that the controller may have taken over:
    # NaN and numbers that no int holds fail both comparisons.
    if not (SET <= fields[0] <= GET and 0.0 <= fields[1] <= MAX_STATUS):
        return STEP, LOST
    port.output_values[0], port.output_values[1] = fields[2], fields[3]
    return int(fields[0]), int(fields[1])


@inlined
def _write(port: Port, count: int) -> int:
    port.trace[CALL] = 1 + SET
    references, values = port.inputs.ctypes.data, port.input_values.ctypes.data
    if port.single[0]:
        for i in range(port.input_values.size):
            port.input_singles[i] = port.input_values[i]
        values = port.input_singles.ctypes.data
    if port.with_sizes:
        size = np.int64(port.input_values.size)
        return call_status(port.set_values, (port.instance, references, np.int64(count), values, size))
    return call_status(port.set_values, (port.instance, references, np.int64(count), values))


@inlined
def _read(port: Port) -> int:
    port.trace[CALL] = 1 + GET
    # What an FMU does not write, though it reports success, is not a number: it was the value of the sample before.
    port.output_values[:] = np.nan
    references, values = port.outputs.ctypes.data, port.output_values.ctypes.data
    if port.single[1]:
        port.output_singles[:] = np.nan
        values = port.output_singles.ctypes.data
    count = np.int64(port.outputs.size)
    if port.with_sizes:
        size = np.int64(port.output_values.size)
        status = call_status(port.get_values, (port.instance, references, count, values, size))
    else:
        status = call_status(port.get_values, (port.instance, references, count, values))
    if port.single[1]:
        for i in range(port.output_values.size):
            port.output_values[i] = port.output_singles[i]
    return status


@inlined
def _do_step_3(port: Port, time: float, step: float) -> int:
    """fmi3DoStep with its outputs eventHandlingNeeded, terminateSimulation, earlyReturn, lastSuccessfulTime."""
    flags = port.info.view(np.uint8)
    flags[:3] = 0
    port.info[1] = time + step
    at = port.info.ctypes.data
    # Of fmi3DoStep's outputs three are one byte, fmi3Boolean being C's
    # bool; the last, at 8 bytes, must be aligned for a double.
    status = call_status(port.do_step, (port.instance, time, step, np.uint8(1), at, at + 1, at + 2, at + 8))
    if status > WARNING:
        return status
    if flags[1]:
        return TERMINATED
    # Told that event mode is not used, an FMU handles its events itself. One that waits for them all the same would be
    # evaluated as a controller that never computes: with its start torques it had B1 of 0.002 N.m.
    if flags[0]:
        return EVENT_MODE
    # Either says so: the flag, or a lastSuccessfulTime before the end. The tolerance is for the FMU's time arithmetic.
    if flags[2] or port.info[1] < time + step * (1.0 - 1e-6):
        return EARLY_RETURN
    return status


@compiled
def _exchange_events(port: Port, count: int, time: float, step: float, read: bool) -> tuple[int, int]:
    """Model Exchange: an event at ``time``, in which inputs are written and what is due happens, then on from there."""
    tolerance = 1e-6 * step
    port.trace[CALL] = 1 + STEP
    # An FMU may miss its own event if the time is a rounding error early.
    due = port.clock[NEXT_EVENT] <= time + tolerance
    now = max(time, port.clock[NEXT_EVENT]) if due else time
    status = call_status(port.functions[SET_TIME], (port.instance, now))
    if status <= WARNING and port.clock[IN_EVENT_MODE] == 0.0:
        status = call_status(port.functions[ENTER_EVENTS], (port.instance,))
    if status > WARNING:
        return STEP, status
    written = _write(port, count) if count > 0 else 0
    if written > WARNING:
        return SET, written
    port.trace[CALL] = 1 + STEP
    stepped = _handle_event(port)
    if stepped <= WARNING:
        stepped = max(stepped, _advance(port, time, time + step, tolerance))
    if stepped > WARNING:
        return STEP, stepped
    got = _read(port) if read else 0
    return GET, max(written, stepped, got)


@compiled
def _advance(port: Port, time: float, end: float, tolerance: float) -> int:
    """From event to event; one at ``end`` is left to the next sample, whose inputs it is to see."""
    worst, stalled = 0, 0
    while time < end - tolerance:
        begin = time
        status, time, event = _integrate(port, time, min(end, max(time, port.clock[NEXT_EVENT])), tolerance)
        stalled = 0 if time > begin else stalled + 1
        if stalled > MAX_ITERATIONS:  # its next event is always now, or past
            return ENDLESS_EVENTS
        if status <= WARNING and (event or time < end - tolerance):
            status = call_status(port.functions[ENTER_EVENTS], (port.instance,))
            if status <= WARNING:
                status = _handle_event(port)
        if status > WARNING:
            return status
        worst = max(worst, status)
    return worst


@compiled
def _integrate(port: Port, time: float, goal: float, tolerance: float) -> tuple[int, float, bool]:
    """Continuous time up to ``goal`` or a state event: the status, the time reached, and whether an event is wanted."""
    event = False
    # CVode refuses an interval of next to nothing ("tout too close to t0").
    if port.do_step != 0 and goal > time + tolerance:
        status = call_status(port.do_step, (port.instance, time, goal - time, np.int32(1)))
        if status > WARNING:
            return status, time, False
        goal, event = port.clock[REACHED], port.clock[STATE_EVENT] > 0.0
    status = call_status(port.functions[SET_TIME], (port.instance, goal))
    # FMI 2.0 and 3.0: the call may be left out where completedIntegratorStepNotNeeded is
    # true, or needsCompletedIntegratorStep false.
    if status > WARNING or port.functions[COMPLETED] == 0:
        return status, goal, event
    port.info[:] = 0.0
    at = port.info.ctypes.data
    if port.stepping == EVENTS:
        status = call_status(port.functions[COMPLETED], (port.instance, np.int32(1), at, at + 4))
    else:
        status = call_status(port.functions[COMPLETED], (port.instance, np.uint8(1), at, at + 1))
    return TERMINATED if status <= WARNING and _flag(port, 1) else status, goal, event or _flag(port, 0)


@inlined
def _flag(port: Port, number: int) -> bool:
    """A Boolean that a Model Exchange FMU has written into ``info``: an int in FMI 2, a byte in FMI 3."""
    if port.stepping == EVENTS:
        return bool(port.info.view(np.int32)[number] != 0)
    return bool(port.info.view(np.uint8)[number] != 0)


@compiled
def _handle_event(port: Port) -> int:
    """Event iteration until the FMU is content; leaves event mode and notes the time of the next event."""
    worst = 0
    # FMI leaves the number of event iterations open; an FMU that always asks for another one would hang the loop.
    for _ in range(MAX_ITERATIONS):
        # As in struct fmi2EventInfo: five flags (update needed, terminate, ..., next event defined) and the next event.
        port.info[:] = 0.0
        at = port.info.ctypes.data
        if port.stepping == EVENTS:
            status = call_status(port.functions[UPDATE], (port.instance, at))
        else:
            status = call_status(port.functions[UPDATE], (port.instance, at, at + 1, at + 2, at + 3, at + 4, at + 24))
        if status > WARNING:
            return status
        if _flag(port, 1):
            return TERMINATED
        worst = max(worst, status)
        if not _flag(port, 0):
            port.clock[NEXT_EVENT] = port.info[3] if _flag(port, 4) else np.inf
            port.clock[IN_EVENT_MODE] = 0.0
            return max(worst, call_status(port.functions[ENTER_CONTINUOUS], (port.instance,)))
    return ENDLESS_EVENTS
