"""What a controller answers to given measurements, without a plant."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np

from ..fmi.port import WARNING, Port, exchange
from ..fmi.slaves import Slave
from .controller import Remote, Steady, probed, start_values
from .master import exchange_failure
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
