"""Loading the compiled master loop before it is needed, for processes that others are forked from."""

from __future__ import annotations

import numpy as np

from ..exact_time import seconds
from ..fmi.port import Port
from . import closed_loop
from .plan import make_plan
from .scenario import NO_DELAY
from .signals import ChirpSignal, PulseSignal


def warm_up() -> None:
    """Run the loop for zero samples: this loads (or once compiles) the machine code for the argument types."""
    two, none = np.zeros(2), np.zeros(0, dtype=np.uint32)
    single = np.zeros(2, dtype=np.float32)
    port = Port(
        stepping=0,
        with_sizes=False,
        instance=0,
        set_values=0,
        do_step=0,
        get_values=0,
        functions=np.zeros(5, dtype=np.int64),
        clock=two,
        info=np.zeros(4),
        inputs=none,
        input_values=two,
        outputs=none,
        output_values=two,
        single=(False, False),
        input_singles=single,
        output_singles=single,
        offset=two,
        scale=two,
        output_scale=two,
        side=0,
        trace=np.zeros(4, dtype=np.int64),
    )
    parts = closed_loop.Loop(
        samples=0,
        plan=make_plan(seconds("0.25e-3"), NO_DELAY, NO_DELAY),
        q_m_ref=two,
        u_m0=two,
        gain=two,
        limit=two,
        torque_quantum=two,
        angle_quantum=0.0,
        noise=np.zeros((1, 2)),
        chirp=ChirpSignal(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        pulse=PulseSignal(0.0, 0.0, 0.0, 0.0),
        abort_distance=0.0,
    )
    record = closed_loop.Record(np.zeros((1, 4)), np.zeros((1, 2)), np.zeros((0, 2)), np.zeros((0, 2)))
    closed_loop.run(port, port, parts, record)
