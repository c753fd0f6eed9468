"""How long a controller computes: the wall time of every step, with the measurements of a simulation at its inputs."""

from __future__ import annotations

import ctypes
import time
from dataclasses import replace

import numpy as np

from ..fmi.connectors import PLANT, bind
from ..fmi.port import GET, WARNING, Port, exchange
from ..fmi.slaves import Slave
from ..jit import call_status, compiled
from .computing import MANY, ComputingTime
from .controller import Steady, prepared
from .master import exchange_failure, simulate
from .scenario import Scenario
from .setup import Setup

FEW = 20
"""Steps that tell how many are worth their time."""

ENOUGH = 0.1
"""Time [s] that the timed steps may take together; a few are timed in any case."""

NANOSECOND = 1e-9


def computing_time(plant: Slave, controller: Slave, setup: Setup, scenario: Scenario) -> ComputingTime:
    """Time the controller's steps over the beginning of ``scenario``.

    Raises :class:`~orchestrator.errors.FmuError` if a call fails.
    """
    few = _times(plant, controller, setup, scenario, FEW)
    many = int(min(MANY, ENOUGH / max(float(np.median(few)), NANOSECOND)))
    times = few if many <= FEW else _times(plant, controller, setup, scenario, many)
    median, most, largest = np.percentile(times, (50, 99, 100)).tolist()
    return ComputingTime(len(times), median, most, largest)


def _times(plant: Slave, controller: Slave, setup: Setup, scenario: Scenario, steps: int) -> np.ndarray:
    """Wall times [s] of the first ``steps``, or as many as there are. The loop is simulated first, and the controller
    then stepped alone, so that nothing of the plant lies between two readings of the clock."""
    sample_time = scenario.sample_time
    duration = min(scenario.duration, steps * sample_time)
    q_a = [variable.name for variable in bind(plant.archive.description, PLANT, "The plant")["q_a"].variables]
    found = simulate(plant, controller, replace(scenario, duration=duration), setup, q_a)
    measured = np.ascontiguousarray(found.measured[:steps])  # one at least, even if the loop ends at once
    steady = Steady(found.q_m_ref, found.u_m0, (float(found.extra[q_a[0]][0]), float(found.extra[q_a[1]][0])))
    times, stamps = np.zeros(len(measured)), np.zeros(4, dtype=np.int64)
    read_clock = ctypes.cast(ctypes.CDLL(None).clock_gettime, ctypes.c_void_p).value or 0
    with prepared(controller, setup, steady, sample_time, float(duration)) as port:
        step = float(sample_time)
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
