"""A controller without a plant: what it answers to given measurements, and how long each of its steps takes."""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import numpy as np

from ..fmi.connectors import PLANT, bind
from ..fmi.port import GET, WARNING, Port, exchange
from ..fmi.slaves import Slave
from ..jit import call_status, compiled
from . import behaviour
from .behaviour import NANOSECOND, ComputingTime
from .controller import Remote, Steady, probed, start_values
from .master import exchange_failure, simulate
from .scenario import Scenario
from .setup import Setup, controller_binding


def answers(
    slave: Slave | Remote,
    setup: Setup,
    steady: Steady,
    sample_time: Fraction,
    errors: np.ndarray,
    initial_error: float = 0.0,
    between: Callable[[int], object] = lambda _: None,
    *,
    after_reset: bool = False,
) -> np.ndarray:
    """Torques [N.m] of a controller at rest that measures ``q_m_ref - errors``; shapes (N, 2), errors in rad.

    During initialization it measures ``q_m_ref - initial_error``; ``between`` is called with the number of each sample
    before it. The torques ``after_reset`` are those of an instance that has answered once before and was reset.
    Raises :class:`~orchestrator.errors.FmuError` if a call fails.
    """
    q_m, step = np.array(steady.q_m_ref), float(sample_time)
    first = (steady.q_m_ref[0] - initial_error, steady.q_m_ref[1] - initial_error)

    def answered(port: Port) -> np.ndarray:
        torques = np.empty_like(errors)
        for k, measured in enumerate(q_m - errors):
            between(k)
            port.input_values[:] = port.scale * (measured - port.offset)
            call, status = exchange(port, port.inputs.size, float(k * sample_time), step, True)
            if status > WARNING:
                raise exchange_failure(slave, call, status)
            torques[k] = port.output_scale * port.output_values
        return torques

    with probed(slave, setup, steady, sample_time, len(errors) * step, first) as port:
        if after_reset and isinstance(slave, Slave):
            answered(port)  # without steps in between, an FMU that resets nothing would have nothing to forget
            slave.reset()
            binding = controller_binding(slave.archive, setup)
            slave.initialize(*start_values(slave.archive, binding, setup, steady, sample_time, first))
        return answered(port)


def computing_time(plant: Slave, controller: Slave, setup: Setup, scenario: Scenario) -> ComputingTime:
    """Time the controller's steps over the beginning of ``scenario``. The loop is simulated first, and the controller
    then stepped alone, so that nothing of the plant lies between two readings of the clock.

    Raises :class:`~orchestrator.errors.FmuError` if a call fails.
    """
    sample_time = scenario.sample_time
    q_a = [variable.name for variable in bind(plant.archive.description, PLANT, "The plant")["q_a"].variables]

    def times(steps: int) -> np.ndarray:
        duration = min(scenario.duration, steps * sample_time)
        trajectory = simulate(plant, controller, replace(scenario, duration=duration), setup, q_a)
        measured = trajectory.measured[:steps]  # one at least, even if the loop ends at once
        steady = Steady(
            trajectory.q_m_ref,
            trajectory.u_m0,
            (float(trajectory.extra[q_a[0]][0]), float(trajectory.extra[q_a[1]][0])),
        )
        return step_times(controller, setup, steady, sample_time, measured)

    return behaviour.computing_time(times)


def step_times(
    controller: Slave, setup: Setup, steady: Steady, sample_time: Fraction, measured: np.ndarray
) -> np.ndarray:
    """Wall times [s] of the steps of one instance that is given the angles ``measured`` [rad], shape (N, 2).

    Raises :class:`~orchestrator.errors.FmuError` if a call fails.
    """
    measured = np.ascontiguousarray(measured)
    times, stamps = np.zeros(len(measured)), np.zeros(4, dtype=np.int64)
    # Called from machine code, so that between two readings lies the exchange alone, and nothing of the interpreter.
    read_clock = ctypes.cast(ctypes.CDLL(None).clock_gettime, ctypes.c_void_p).value or 0
    step = float(sample_time)
    with probed(controller, setup, steady, sample_time, len(measured) * step) as port:
        call, status = _timed(port, measured, step, read_clock, np.int32(time.CLOCK_MONOTONIC), stamps, times)
        if status > WARNING:
            raise exchange_failure(controller, call, status)
    return times


@compiled
def _timed(
    port: Port,
    measured: np.ndarray,
    step: float,
    read_clock: int,
    clock: np.int32,
    stamps: np.ndarray,
    times: np.ndarray,
) -> tuple[int, int]:
    """Fill ``times`` [s], one exchange for every row of ``measured``; returns the last call and its status.

    ``stamps`` is memory for two readings of the clock: seconds and nanoseconds.
    """
    call, status = GET, 0
    for k in range(measured.shape[0]):
        for i in range(port.input_values.size):
            port.input_values[i] = port.scale[i] * (measured[k, i] - port.offset[i])
        call_status(read_clock, (clock, stamps.ctypes.data))
        call, status = exchange(port, port.inputs.size, k * step, step, True)
        call_status(read_clock, (clock, stamps.ctypes.data + 16))
        times[k] = (stamps[2] - stamps[0]) + NANOSECOND * (stamps[3] - stamps[1])
        if status > WARNING:
            break
    return call, status
