"""Linear stability over the uncertainty: what has to hold before a simulation is worth its time.

The loop is linearized at rest for the protocol's extreme systems, with the changes of the tests of A1 (gain) and A2
(delay), and with an effective viscous friction anywhere between none and that of a motor that friction (8) holds,
alpha f_c: a limit cycle chooses its friction by its amplitude, and a dither changes it for everybody. The search looks
at the corners of that range and at one place inside; the tests look at a grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from controller_fmu.lqg import flexible_manipulator_lqg as model
from controller_fmu.tuning.problem import PAPER, LawOf, experiment
from controller_fmu.tuning.simulator import Law
from orchestrator.benchmark import cases
from orchestrator.benchmark.case import Configuration
from plant_fmu.flexible_manipulator import integrator
from plant_fmu.flexible_manipulator.dynamics import inertia
from plant_fmu.flexible_manipulator.parameters import NOMINAL

SYSTEMS = ("compliant", "slippery")
TESTS = ("gain_1", "gain_2", "delay_1", "delay_2")
FRICTIONS = ((0.001, 0.001), (20.0, 14.0), (0.001, 14.0), (20.0, 0.001), (1.0, 1.0))
"""Effective viscous friction of the motors [N.m.s/rad]: from viscous alone to the slope alpha f_c of `sticky`."""


@dataclass(frozen=True)
class LinearPlant:
    """A sampled linear plant: x+ = A x + B u, q_m = x[2:4], torques amplified by ``gain`` and ``lag`` samples late."""

    q_m_ref: tuple[float, float]
    u_m0: tuple[float, float]
    A: np.ndarray
    B: np.ndarray
    gain: tuple[float, float]
    lag: tuple[int, int]


def linear_plants(
    poses: Iterable[Configuration], frictions: Sequence[tuple[float, float]] = FRICTIONS
) -> list[LinearPlant]:
    """The linearized plants at ``poses``, for every system and test of the module's lists, and all ``frictions``."""
    found = []
    for pose in poses:
        for system_name in SYSTEMS:
            for test in (PAPER.test(name) for name in TESTS):
                system = cases.system(PAPER, NOMINAL, 0, pose.index, system_name, test)
                at = experiment(cases.case(PAPER, pose, system, test, 0))
                T_s = float(at.case.scenario.sample_time)
                for friction in frictions:
                    A, B = model.discretize(*_linearized(at.course.memory, friction), T_s)
                    gain, lag = at.course.gain.tolist(), at.course.lag.tolist()
                    found.append(LinearPlant(at.q_m_ref, at.u_m0, A, B, (gain[0], gain[1]), (lag[0], lag[1])))
    return found


def decay_rates(plants: Iterable[LinearPlant], law_of: LawOf) -> np.ndarray:
    """How fast each closed loop's slowest mode decays [1/s]; negative for an unstable loop."""
    laws: dict[tuple[float, ...], Law] = {}
    T_s = float(PAPER.sample_time)
    loops: dict[int, list[np.ndarray]] = {}
    for plant in plants:
        at = (*plant.q_m_ref, *plant.u_m0)
        if at not in laws:
            laws[at] = law_of(plant.q_m_ref, plant.u_m0)
        loop = _closed(plant, laws[at].matrix)
        loops.setdefault(len(loop), []).append(loop)
    radii = [np.abs(np.linalg.eigvals(np.stack(group))).max(axis=1) for group in loops.values()]
    rates: np.ndarray = -np.log(np.concatenate(radii)) / T_s
    return rates


def shortfall(rates: np.ndarray, wanted: float = 0.25) -> float:
    """By how much the ``rates`` miss the ``wanted`` one [1/s], summed; a hopeless loop counts 10."""
    return float(np.sum(np.clip(wanted - rates, 0.0, 10.0)))


def _linearized(memory: np.ndarray, friction: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """dx/dt = A x + B u of the plant at rest in ``memory``; x as in flexible_manipulator_lqg.linearize."""
    x = memory[integrator.STATE :]
    arm, *joints = integrator.unpack(x[9:])
    deltas = [x[i] - x[2 + i] / joints[i].n for i in (0, 1)]
    slopes = [joints[i].k_1 + 3.0 * joints[i].k_3 * min(abs(deltas[i]), joints[i].psi) ** 2 for i in (0, 1)]
    J_11, J_12, J_22 = inertia(arm, math.sin(x[1]))
    A, B = model.flexible_joints(
        links=np.array([[J_11, J_12], [J_12, J_22]]),
        motors=[joint.j_m for joint in joints],
        ratios=[joint.n for joint in joints],
        stiffness=slopes,
        damping=[joint.d for joint in joints],
        friction=friction,
        torque_gain=[joint.gamma for joint in joints],
    )
    return A, B[:, :2]


def _closed(plant: LinearPlant, law: np.ndarray) -> np.ndarray:
    """The loop's matrix; its state: plant, the law's z, and the commands on their way to each motor, latest first."""
    states = len(law) - 4
    first = (8 + states, 8 + states + plant.lag[0])
    loop = np.zeros((first[1] + plant.lag[1],) * 2)
    loop[:8, :8] = plant.A
    law_inputs = np.zeros((len(law), len(loop)))
    law_inputs[:states, 8 : 8 + states] = np.eye(states)
    for i in (0, 1):
        loop[:8, first[i] + plant.lag[i] - 1] += plant.gain[i] * plant.B[:, i]
        law_inputs[states + i, first[i]] = 1.0
        law_inputs[states + 2 + i, 2 + i] = 1.0
        for place in range(first[i] + 1, first[i] + plant.lag[i]):
            loop[place, place - 1] = 1.0
    after = law @ law_inputs
    loop[8 : 8 + states] = after[:states]
    loop[list(first)] = after[states : states + 2]
    return loop
