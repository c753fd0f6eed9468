"""Loading the compiled master loop before it is needed, for processes that others are forked from."""

from __future__ import annotations

import numpy as np

from ..exact_time import seconds
from ..fmi.port import unconnected
from ..jit import arithmetic_now
from . import closed_loop, serving
from .disturbances import ChirpSignal, PulseSignal
from .plan import make_plan
from .random_streams import dropped, noise
from .scenario import NO_DELAY, Noise


def warm_up() -> None:
    """Run the loop for zero samples: this loads (or once compiles) the machine code for the argument types.

    They have to be those of a simulation: the noise, for example, is read-only.
    """
    two, port = np.zeros(2), unconnected((), 2, (), 2)
    parts = closed_loop.Loop(
        first=0,
        samples=0,
        plan=make_plan(seconds("0.25e-3"), NO_DELAY, NO_DELAY),
        q_m_ref=two,
        u_m0=two,
        gain=two,
        limit=two,
        torque_quantum=two,
        angle_quantum=0.0,
        noise=noise(Noise(sigma=1.0), 1),
        dropped=dropped((0,), 0.0, 0),
        chirp=ChirpSignal(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        pulse=PulseSignal(0.0, 0.0, 0.0, 0.0),
        abort_distance=0.0,
    )
    record = closed_loop.SampleArrays(np.zeros((1, 4)), np.zeros((1, 2)), *(np.zeros((0, 2)) for _ in range(3)))
    closed_loop.run(port, port, parts, record)
    serving.warm_up()
    arithmetic_now()
