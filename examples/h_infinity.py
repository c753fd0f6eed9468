"""An H-infinity design from the linear model to the scorecard: a discrete-time controller for each pose of a protocol.

    python examples/h_infinity.py quick        (or paper; needs slycot, the extra design)

The generalized plant has the weights of the LQG of docs/design.md. Its inputs are a torque on the motors, a force on
the tool, a drift of the torque and noise of the sensors; its outputs are the tool's position and speed, the motor
angles and the torques. The controller holds the H-infinity norm from the first to the second below GAMMA. SLICOT's
routine SB10DD computes it from two Riccati equations.
"""

import sys
from pathlib import Path

import numpy as np
from slycot import sb10dd

from orchestrator import Benchmark, Controller, Evaluation, LinearModel, controller_from_state_space

T_S = 0.25e-3  # [s]
GAMMA = 8.0
"""Bound of the norm. With 6, one of the 18 controllers for `paper` is unstable by itself: its torque would run away
while the drive is at its limit."""

TORQUE, FORCE, DRIFT, NOISE = 0.5, 5.0, 5e-4, 2.2e-4
"""Torque on the motors [N.m], force on the tool [N], drift of the torque [N.m a sample], noise of the angles [rad]."""

TOOL, SPEED, ANGLE, EFFORT = 1e3, 1e2, 10.0, (0.12, 0.32)
"""Weights of the tool's position [1/m] and speed [s/m], of the motor angles [1/rad], of the torques [1/(N.m)]."""

FORGETTING = 0.01
"""Rate at which the drift forgets [1/s]: a pole on the unit circle that no torque moves has no solution."""


def generalized_plant(model: LinearModel) -> tuple[np.ndarray, ...]:
    """A, B, C, D with the inputs (disturbances, u_m) and the outputs (what is held small, e = q_m_ref - q_m).

    The states are those of ``model``, which has n, and the drifting torque; B has 8 + 2 columns, C 8 + 2 rows.
    """
    n, zero, one = len(model.A), np.zeros, np.eye(2)
    u_m, u_d, F = np.split(model.B, 3, axis=1)
    q_m, X = np.split(model.C, 2)
    speed = np.roll(X, 4, axis=1)  # the links' speeds stand four places behind their angles
    effort = np.diag(EFFORT)
    A = np.block([[model.A, u_d], [zero((2, n)), (1.0 - FORGETTING * T_S) * one]])
    B = np.block(
        [[TORQUE * u_d, FORCE * F, zero((n, 4)), u_m], [zero((2, 4)), DRIFT * one, zero((2, 2)), zero((2, 2))]]
    )
    C = np.block(
        [
            [TOOL * X, zero((2, 2))],
            [SPEED * speed, zero((2, 2))],
            [ANGLE * q_m, zero((2, 2))],
            [zero((2, n)), effort],  # to cancel the drift costs nothing
            [-q_m, zero((2, 2))],
        ]
    )
    D = np.block([[zero((6, 10))], [zero((2, 8)), effort], [zero((2, 6)), NOISE * one, zero((2, 2))]])
    return A, B, C, D


def h_infinity(model: LinearModel) -> tuple[np.ndarray, ...]:
    """A, B, C, D of the controller from e to u_m - u_m0, with as many states as the generalized plant."""
    A, B, C, D = generalized_plant(model)
    return sb10dd(len(A), B.shape[1], len(C), 2, 2, GAMMA, A, B, C, D)[1:5]


def design(bench: Benchmark, out: Path) -> Path:
    """The FMU ``out`` of the controllers for all poses of the protocol; the nearest one is used."""
    poses = sorted({(case.configuration.q_a1, case.configuration.q_a2) for case in bench.cases})
    models = [bench.linearize(q_a, "nominal", friction="sliding") for q_a in poses]
    matrices = (np.array(of_all_poses) for of_all_poses in zip(*map(h_infinity, models), strict=True))
    return controller_from_state_space(*matrices, T_S, out=out, points=[model.at.q_m for model in models])


def main(protocol: str) -> Evaluation:
    """Design, look at the margins of one pose, and evaluate."""
    bench = Benchmark(protocol)
    file = design(bench, Path("h_infinity.fmu"))
    loop = bench.linear_loop(file, (0.3, -0.9), friction="sliding")
    for axis, margins in enumerate(loop.margins, start=1):
        print(
            f"axis {axis}: gain {margins.gain:.2f}, delay {1e3 * margins.delay:.2f} ms, |S| {margins.sensitivity:.2f}"
        )
    return bench.evaluate(Controller(file), recordings=False)


if __name__ == "__main__":
    print(main(*sys.argv[1:] or ["quick"]))
