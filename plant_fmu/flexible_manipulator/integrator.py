"""Integration over one communication step: classical Runge-Kutta of fourth order with fixed substeps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from .coefficients import Arm, Joint, sticking
from .dynamics import accelerations
from .interface import VARIABLES
from .jit import compiled
from .kinematics import tcp

STATE = len(VARIABLES)
"""Where in the memory of :func:`advance` the state begins: behind the FMU's variables."""

STATE_SIZE = 8 + 1 + len(Arm._fields) + 2 * len(Joint._fields)
"""State, longest substep, constants: see :func:`state_at_rest`."""

MAX_SUBSTEP = 0.25e-3
"""Longest substep [s]: the benchmark's sample time."""

GENTLE = 0.5
"""Product of substep and fastest rate up to which the longest substep is taken; above it, half of that."""

MAX_STIFFNESS = 1.7
"""Largest product of substep and fastest rate, h lambda. Runge-Kutta's fourth order is stable up to 2.78; the
stiffest system of Table 1 has 1.69 at half of MAX_SUBSTEP, and what is stiffer gets shorter substeps."""

MIN_SUBSTEP = 0.25e-6
"""Shortest substep [s] that parameters may need: a thousandth of the benchmark's sample time."""

TINY = 2.2250738585072014e-308
"""Smallest normal number, in the place of a determinant that rounds to nothing."""

MOST_SUBSTEPS = 1e5
"""So many substeps a step may take: 12.5 s of the nominal system."""

INPUTS = 6
"""How many inputs the memory begins with."""


FAST = (("alpha", "s/rad"), ("f_c", "N.m"), ("f_d", "N.m.s/rad"), ("d", "N.m.s/rad"), ("j_m", "kg.m2"))
"""What makes a joint fast, with its units."""


def rates(arm: Arm, joints: tuple[Joint, Joint]) -> tuple[float, float]:
    """Upper bounds of the fastest rate of each joint [1/s], from the parameters alone.

    That of a motor whose friction (8) is linearised at zero speed, and that at which the gear's damping brings motor
    and link together, with the link's largest inverse inertia of all poses.
    """
    det = max(arm.det - arm.b * arm.b, TINY)
    inverses = arm.a_2 / det, (arm.a_1 + 2.0 * arm.b) / det
    first, second = (
        (sticking(own) + own.d * (own.per_n * own.per_n)) * own.per_j_m + own.d * inverse
        for own, inverse in zip(joints, inverses, strict=True)
    )
    return first, second


def longest_substep(arm: Arm, joints: tuple[Joint, Joint]) -> float:
    """Longest substep [s] for these parameters: by the faster of :func:`rates`, whatever the state is."""
    rate = max(rates(arm, joints))
    if rate * MAX_SUBSTEP <= GENTLE:
        return MAX_SUBSTEP
    return min(0.5 * MAX_SUBSTEP, MAX_STIFFNESS / rate)


def check_substep(table: Mapping[str, float], arm: Arm, joints: tuple[Joint, Joint]) -> None:
    """Raise ``ValueError`` if the parameters of ``table``, of which ``arm`` and ``joints`` are made, need a substep
    below MIN_SUBSTEP, with those that do."""
    substep = longest_substep(arm, joints)
    if substep >= MIN_SUBSTEP:
        return
    first, second = rates(arm, joints)
    axis = 2 if second > first else 1
    asked = ", ".join(f"{symbol}[{axis}] = {table[f'{symbol}[{axis}]']:g} {unit}" for symbol, unit in FAST)
    raise ValueError(f"{asked} refused: they need substeps of {substep:g} s, shorter than {MIN_SUBSTEP:g} s")


def state_at_rest(
    q_a: tuple[float, float], q_m: tuple[float, float], arm: Arm, joints: tuple[Joint, Joint]
) -> tuple[float, ...]:
    """What :func:`advance` finds in its memory from STATE on, for rest at link angles ``q_a`` and motor angles
    ``q_m`` [rad]: the state, the longest substep, the constants of arm and joints."""
    return (*q_a, *q_m, 0.0, 0.0, 0.0, 0.0, longest_substep(arm, joints), *arm, *joints[0], *joints[1])


@compiled
def unpack(c):
    """The constants in :func:`state_at_rest`: ``(Arm, Joint 1, Joint 2)``."""
    return (
        Arm(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]),
        Joint(c[8], c[9], c[10], c[11], c[12], c[13], c[14], c[15], c[16], c[17], c[18], c[19], c[20], c[21]),
        Joint(c[22], c[23], c[24], c[25], c[26], c[27], c[28], c[29], c[30], c[31], c[32], c[33], c[34], c[35]),
    )


@compiled
def derivative(arm, joint_1, joint_2, x, tau_1, tau_2, F_x, F_z):
    """Time derivative of the state ``x``, see :func:`advance`."""
    a = accelerations(arm, joint_1, joint_2, x, tau_1, tau_2, F_x, F_z)
    return (x[4], x[5], x[6], x[7], a[0], a[1], a[2], a[3])


@compiled
def along(x, h, dx):
    """``x + h dx`` for tuples of eight floats."""
    return (
        x[0] + h * dx[0],
        x[1] + h * dx[1],
        x[2] + h * dx[2],
        x[3] + h * dx[3],
        x[4] + h * dx[4],
        x[5] + h * dx[5],
        x[6] + h * dx[6],
        x[7] + h * dx[7],
    )


@compiled
def advance(memory, step):
    """Advance the system in ``memory`` in place by ``step`` [s] >= 0 with the inputs held.

    ``memory`` is one float64 array, since an array crosses into machine code at the price of one number. It
    begins with the FMU's variables by value reference, of which the inputs u_m, u_d, F are read and the outputs
    q_m, q_a, X written. At STATE stand link angles, motor angles [rad], link speeds, motor speeds [rad/s], then
    the longest substep and the constants.
    """
    x = memory[STATE:]
    arm, joint_1, joint_2 = unpack(x[9:])
    tau_1 = joint_1.gamma * memory[0] + memory[2]
    tau_2 = joint_2.gamma * memory[1] + memory[3]
    F_x, F_z = memory[4], memory[5]
    y = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7])
    # A step of two substeps must not become one of three because its size was rounded up.
    substeps = math.ceil(step / x[8] * (1.0 - 1e-9))
    h = step / max(substeps, 1)
    for _ in range(substeps):
        k_1 = derivative(arm, joint_1, joint_2, y, tau_1, tau_2, F_x, F_z)
        k_2 = derivative(arm, joint_1, joint_2, along(y, 0.5 * h, k_1), tau_1, tau_2, F_x, F_z)
        k_3 = derivative(arm, joint_1, joint_2, along(y, 0.5 * h, k_2), tau_1, tau_2, F_x, F_z)
        k_4 = derivative(arm, joint_1, joint_2, along(y, h, k_3), tau_1, tau_2, F_x, F_z)
        slope = along(along(along(k_1, 2.0, k_2), 2.0, k_3), 1.0, k_4)
        y = along(y, h / 6.0, slope)
    x[0], x[1], x[2], x[3] = y[0], y[1], y[2], y[3]
    x[4], x[5], x[6], x[7] = y[4], y[5], y[6], y[7]
    memory[6], memory[7], memory[8], memory[9] = y[2], y[3], y[0], y[1]
    memory[10], memory[11] = tcp(arm, y[0], y[1])


@compiled
def do_step(memory, _time, step):
    """:func:`advance` in the form of FMI's doStep; False if there is something in the way, see :func:`obstacle`."""
    substep = memory[STATE + 8]
    if not (step >= 0.0 and substep > 0.0 and step / substep * (1.0 - 1e-9) <= MOST_SUBSTEPS):
        return False
    for i in range(INPUTS):
        if not math.isfinite(memory[i]):
            return False
    advance(memory, step)
    return True


def obstacle(memory: Sequence[float], time: float, step: float) -> str:
    """What was in the way of :func:`do_step`."""
    for variable, value in zip(VARIABLES[:INPUTS], memory, strict=False):
        if not math.isfinite(value):
            return f"{variable.name} = {value:g} {variable.unit} refused: it must be finite"
    what = f"step of {step!r} s at t = {time!r} s refused"
    if not memory[STATE + 8] > 0.0:
        return f"{what}: the plant has not been initialized"
    if not 0.0 <= step < math.inf:
        return f"{what}: it must be finite and not negative"
    return f"{what}: it needs {step / memory[STATE + 8]:.0f} substeps, more than {MOST_SUBSTEPS:.0f}"
