"""The master loop: the one place where time advances. See docs/timing.md for the contract it keeps.

At sample k, time t_k = k T_s: measure q_m (noise, delay, quantization), step the controller over one sample, take its
torque (gain, saturation, quantization), or the former one if the sample is dropped, and step the plant to t_k+1 in the
parts of the plan, each driven by the torque that has arrived by then and by the disturbances at its beginning.

The recorded samples serve as the delay lines: what acts now is what was recorded some samples ago.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..exact_time import seconds
from ..fmi.port import GET, WARNING, Port, exchange, unconnected
from ..fmi.trace import SAMPLE
from ..jit import arithmetic, arithmetic_now, compiled
from . import serving
from .random_streams import dropped, noise
from .scenario import NO_DELAY, ChirpSignal, Noise, Plan, PulseSignal, make_plan
from .signals import amplify, chirp, pulse, quantize, saturate

MAX_PHYSICAL_TORQUE = 1e12
"""A torque [N.m] beyond any physical one; a controller that asks for more has failed, not saturated."""

FINISHED, DIVERGED, ABSURD_TORQUE, PLANT_FAILED, CONTROLLER_FAILED, ARITHMETIC_CHANGED = range(6)
"""Why the loop ended."""


class Loop(NamedTuple):
    """What stands between the two slaves; arrays of shape (2,) hold one value per axis."""

    first: int
    """The sample it begins at: 0, or the end of a loop that goes on."""
    samples: int
    plan: Plan
    q_m_ref: np.ndarray
    u_m0: np.ndarray
    gain: np.ndarray
    limit: np.ndarray
    torque_quantum: np.ndarray
    angle_quantum: float
    noise: np.ndarray
    """Measurement noise [rad], shape (samples + 1, 2)."""
    dropped: np.ndarray
    """Whether the torques of a sample are lost, bool, shape (samples,)."""
    chirp: ChirpSignal
    pulse: PulseSignal
    abort_distance: float


class SampleArrays(NamedTuple):
    """Arrays that the loop fills; row k belongs to time t_k."""

    outputs: np.ndarray
    """Plant outputs, shape (samples + 1, outputs): q_m, X, and whatever else was asked for."""
    measured: np.ndarray
    """Angles as they left the sensor, before delay and quantization, shape (samples + 1, 2) [rad]."""
    given: np.ndarray
    """Angles as the controller was given them, delayed and quantized, shape (samples, 2) [rad]."""
    command: np.ndarray
    """Torques as the controller asked for them, shape (samples, 2) [N.m]."""
    torque: np.ndarray
    """Torques as they leave for the drive: amplified, saturated, quantized; in a dropped sample, those of the one
    before; shape (samples, 2) [N.m]."""


class Exit(NamedTuple):
    """Why and where a loop ended: the reason, the sample, the FMI call and its status, warnings counted."""

    reason: int
    sample: int
    call: int
    status: int
    warnings: int


@compiled
def run(plant: Port, controller: Port, loop: Loop, record: SampleArrays) -> Exit:
    """Simulate the closed loop from its first sample on; fills ``record`` and returns an :class:`Exit`.

    The plant's inputs are u_m, u_d, F, two each; its outputs begin with q_m and X. Initial plant outputs stand in
    row 0 of ``record.outputs``; of a loop that goes on, all rows before its first sample.
    """
    plan = loop.plan
    rows, parts = plan.step.shape
    T_s = plan.interval / plan.denominator
    x_0, z_0 = record.outputs[0, 2], record.outputs[0, 3]
    # Squares are compared: a square root in each sample would decide nothing else.
    reach = loop.abort_distance * loop.abort_distance
    u = plant.input_values
    warnings = 0

    for k in range(loop.first, loop.samples):
        controller.trace[SAMPLE] = k
        for i in range(2):
            taken = k - plan.sensor_lag[i]
            y = quantize(record.measured[taken, i] if taken >= 0 else loop.q_m_ref[i], loop.angle_quantum)
            record.given[k, i] = y
            controller.input_values[i] = controller.scale[i] * (y - controller.offset[i])
        # From integers, never as a sum: 104,000 additions of 0.25 ms are 3e-11 s
        # off, and a chirp or a force would begin a sample early or late.
        t = k * plan.interval / plan.denominator
        call, status = exchange(controller, controller.inputs.size, t, T_s, True)
        if status > WARNING:
            return Exit(CONTROLLER_FAILED, k, call, status, warnings)
        warnings += status
        # A controller that sets the rounding mode or flushes denormals would
        # change the plant's numbers too, which run in the same thread.
        changed = arithmetic()
        if changed != 0:
            return Exit(ARITHMETIC_CHANGED, k, call, changed, warnings)

        for i in range(2):
            asked = controller.output_scale[i] * controller.output_values[i]
            record.command[k, i] = asked
            # Written so that NaN fails as well. The saturation behind it would hide both.
            if not abs(asked) <= MAX_PHYSICAL_TORQUE:
                return Exit(ABSURD_TORQUE, k, GET, 0, warnings)
            if loop.dropped[k]:
                # As a drive does that hears nothing: it holds what it had.
                record.torque[k, i] = record.torque[k - 1, i] if k > 0 else loop.u_m0[i]
            else:
                # The gain is that of the loop, so it acts on the command, before the limit, which is the drive's.
                torque = amplify(asked, loop.u_m0[i], loop.gain[i])
                record.torque[k, i] = quantize(saturate(torque, loop.limit[i]), loop.torque_quantum[i])

        row = k % rows
        for part in range(parts):
            t = (k * plan.interval + plan.offset[row, part]) / plan.denominator
            # At the first step the inputs were never set.
            changed = 2 if k + part == 0 else 0
            for i in range(2):
                arrived = k - plan.drive_lag[row, part, i]
                torque = record.torque[arrived, i] if arrived >= 0 else loop.u_m0[i]
                if torque != u[i]:
                    u[i] = torque
                    changed = 2
            u_d1, u_d2 = chirp(loop.chirp, t)
            if u_d1 != u[2] or u_d2 != u[3]:
                u[2], u[3] = u_d1, u_d2
                changed = 4
            F_x, F_z = pulse(loop.pulse, t)
            if F_x != u[4] or F_z != u[5]:
                u[4], u[5] = F_x, F_z
                changed = 6
            # A crossing into the plant costs more than its values do: none if nothing has changed, else one for all.
            read = part == parts - 1 or plan.sample_part[row, 0] == part or plan.sample_part[row, 1] == part
            call, status = exchange(plant, changed, t, plan.step[row, part], read)
            if status > WARNING:
                return Exit(PLANT_FAILED, k, call, status, warnings)
            warnings += status
            for i in range(2):
                if plan.sample_part[row, i] == part:
                    # Not at t_k+1 but where the part ends: a delay of 0.3 samples is measured there, not interpolated.
                    record.measured[k + 1, i] = plant.output_values[i] + loop.noise[k + 1, i]

        for i in range(plant.output_values.size):
            record.outputs[k + 1, i] = plant.output_values[i]
        dx, dz = plant.output_values[2] - x_0, plant.output_values[3] - z_0
        # NaN fails this comparison, too.
        if not dx * dx + dz * dz <= reach:
            return Exit(DIVERGED, k + 1, 0, 0, warnings)
    controller.trace[SAMPLE] = loop.samples
    return Exit(FINISHED, loop.samples, 0, 0, warnings)


def warm_up() -> None:
    """Run the loop for zero samples: this loads (or once compiles) the machine code for the argument types, before
    other processes are forked from this one.

    They have to be those of a simulation: the noise, for example, is read-only.
    """
    two, port = np.zeros(2), unconnected((), 2, (), 2)
    parts = Loop(
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
    record = SampleArrays(np.zeros((1, 4)), np.zeros((1, 2)), *(np.zeros((0, 2)) for _ in range(3)))
    run(port, port, parts, record)
    serving.warm_up()
    arithmetic_now()
