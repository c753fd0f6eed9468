"""What a controller answers to given measurements, without a plant."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np

from ..fmi.port import WARNING, exchange
from ..fmi.slaves import Slave
from .controller import Remote, Steady, probed
from .master import exchange_failure
from .setup import Setup


def answers(
    slave: Slave | Remote,
    setup: Setup,
    steady: Steady,
    sample_time: Fraction,
    errors: np.ndarray,
    initial_error: float = 0.0,
    between: Callable[[int], object] = lambda _: None,
) -> np.ndarray:
    """Torques [N.m] of a controller at rest that measures ``q_m_ref - errors``; shapes (N, 2), errors in rad.

    During initialization it measures ``q_m_ref - initial_error``; ``between`` is called with the number of each sample
    before it. Raises :class:`~orchestrator.errors.FmuError` if a
    call fails.
    """
    q_m_ref = np.array(steady.q_m_ref)
    first = (steady.q_m_ref[0] - initial_error, steady.q_m_ref[1] - initial_error)
    step = float(sample_time)
    torques = np.empty_like(errors)
    with probed(slave, setup, steady, sample_time, len(errors) * step, first) as port:
        for k, measured in enumerate(q_m_ref - errors):
            between(k)
            port.input_values[:] = port.scale * (measured - port.offset)
            call, status = exchange(port, port.inputs.size, float(k * sample_time), step, True)
            if status > WARNING:
                raise exchange_failure(slave, call, status)
            torques[k] = port.output_scale * port.output_values
    return torques
