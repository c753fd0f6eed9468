"""The benchmark's cases for a tuning: a subset for the search, the whole protocol for the verdict.

Cases, measurements and the scorecard are the benchmark's own (orchestrator/benchmark); only the simulation is the
one of simulator.py, which needs no FMU. No FMU ever imports this package.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from controller_fmu.tuning.simulator import Course, Law, simulate
from orchestrator.benchmark import cases as case_list
from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.case import Case, Configuration
from orchestrator.benchmark.metrics import judge, named
from orchestrator.benchmark.results import CaseResult, Scorecard, rules
from orchestrator.benchmark.scorecard import score
from orchestrator.loop import random_streams, signals
from orchestrator.loop.trajectory import Ending, Status, Trajectory
from plant_fmu.flexible_manipulator import coefficients, equilibrium, integrator, kinematics
from plant_fmu.flexible_manipulator.parameters import NOMINAL

PAPER = protocols.load("paper")
STABLE_PRODUCT = 2.2
"""Largest product of substep and fastest rate at which the search integrates (Runge-Kutta's limit is 2.78)."""

Systems = Mapping[str, Sequence[str]]
"""Names of systems for "performance" and "stability"."""
LawOf = Callable[[tuple[float, float], tuple[float, float]], Law]
"""A controller: from q_m_ref [rad] and u_m0 [N.m] to its law."""


@dataclass(frozen=True)
class Experiment:
    """A case, ready to be simulated with any law."""

    case: Case
    course: Course
    q_m_ref: tuple[float, float]
    u_m0: tuple[float, float]
    substeps: int


def experiment(case: Case, exact: bool = True) -> Experiment:
    """The experiment of ``case``; one that is not ``exact`` takes as few substeps as are stable."""
    scenario = case.scenario
    values = dict(scenario.parameters)
    q_a = (values.pop("q_a_start[1]"), values.pop("q_a_start[2]"))
    arm, joints = coefficients.arm(values), (coefficients.joint(values, 1), coefficients.joint(values, 2))
    rest = equilibrium.solve(arm, joints, q_a)
    memory = np.zeros(integrator.STATE + integrator.STATE_SIZE)
    memory[0:2] = rest.u_m
    memory[6:12] = (*rest.q_m, *q_a, *kinematics.tcp(arm, *q_a))
    memory[integrator.STATE :] = integrator.state_at_rest(q_a, rest.q_m, arm, joints)
    T_s = float(scenario.sample_time)
    course = Course(
        memory=memory,
        samples=scenario.samples,
        gain=np.array(scenario.drive.gain),
        lag=np.array([int(delay / scenario.sample_time) for delay in scenario.drive.delay]),
        limit=np.array(scenario.drive.limit),
        torque_quantum=np.array(scenario.drive.quantum),
        angle_quantum=scenario.sensor.quantum,
        noise=random_streams.noise(scenario.sensor.noise, scenario.samples + 1),
        chirp=signals.chirp_signal(scenario.chirp),
        pulse=signals.pulse_signal(scenario.pulse),
    )
    if exact:
        substeps = math.ceil(T_s / integrator.longest_substep(joints) - 1e-9)
    else:
        rate = max(joint.alpha * joint.f_c / joint.j_m for joint in joints)
        substeps = math.ceil(T_s * rate / STABLE_PRODUCT)
    return Experiment(case, course, rest.q_m, rest.u_m, substeps)


def experiments(
    poses: Iterable[Configuration], tests: Sequence[str], systems: Systems, seed: int, shortened: bool = False
) -> list[Experiment]:
    """Experiments of the protocol ``paper`` at ``poses`` for the search, on substeps as long as are stable.

    Where ``shortened``, the force comes soon after the chirp and the simulation ends 4 s after it.
    """
    found = []
    for pose in poses:
        for test in (PAPER.test(name) for name in tests):
            for name in systems.get(test.systems, ()):
                system = case_list.system(PAPER, NOMINAL, seed, pose.index, name, test)
                case = case_list.case(PAPER, pose, system, test, seed)
                found.append(experiment(_shortened(case) if shortened else case, exact=False))
    return found


def _shortened(case: Case) -> Case:
    scenario = case.scenario
    begin = scenario.chirp.stop + 0.25
    end = begin + scenario.pulse.stop - scenario.pulse.start
    pulse = replace(scenario.pulse, start=begin, stop=end)
    return replace(case, scenario=replace(scenario, pulse=pulse, duration=Fraction(str(end)) + 4))


def whole_protocol(seed: int = 0) -> list[Experiment]:
    """Every case of the protocol ``paper``."""
    return [experiment(case) for case in case_list.cases(PAPER, NOMINAL, seed)]


def scattered_poses(count: int, seed: int) -> list[Configuration]:
    """Poses over the workspace [rad], one in each row and each column of a ``count`` x ``count`` grid."""
    stream = np.random.RandomState(seed)
    places = (np.stack([np.arange(count), stream.permutation(count)]) + stream.uniform(size=(2, count))) / count
    bounds = np.radians([PAPER.workspace.q_a1_deg, PAPER.workspace.q_a2_deg])
    q_a = bounds[:, :1] + places * (bounds[:, 1:] - bounds[:, :1])
    # Indices beyond the grid's give them draws of their own.
    return [Configuration(1000 * seed + k, float(q_a[0, k]), float(q_a[1, k])) for k in range(count)]


def trajectory(experiment: Experiment, law: Law) -> tuple[np.ndarray, np.ndarray]:
    """TCP positions [m], shape (N + 1, 2), and torques [N.m], shape (N, 2), for the N samples that were reached."""
    course, scenario = experiment.course, experiment.case.scenario
    X, torque = np.empty((course.samples + 1, 2)), np.empty((course.samples, 2))
    reached = simulate(
        course, law, float(scenario.sample_time), experiment.substeps, scenario.abort_distance, X, torque
    )
    return X[: reached + 1], torque[:reached]


def result(experiment: Experiment, law: Law) -> CaseResult:
    """Simulate an experiment and measure it."""
    X, torque = trajectory(experiment, law)
    time = np.arange(len(X)) * float(experiment.case.scenario.sample_time)
    finished = len(torque) == experiment.course.samples
    nothing = np.empty((0, 2))
    simulated = Trajectory(
        time=time,
        q_m=nothing,
        X=X,
        extra={},
        measured=nothing,
        command=nothing,
        torque=torque,
        q_m_ref=experiment.q_m_ref,
        u_m0=experiment.u_m0,
        ending=Ending(Status.DONE if finished else Status.UNSTABLE, float(time[-1])),
    )
    return named(experiment.case, judge(PAPER, experiment.case, simulated))


def evaluate(
    experiments: Sequence[Experiment], law_of: LawOf, threads: ThreadPoolExecutor | None = None
) -> list[CaseResult]:
    """Results of ``experiments`` with the controller ``law_of``; in ``threads``, as the simulator holds no lock."""

    def one(each: Experiment) -> CaseResult:
        return result(each, law_of(each.q_m_ref, each.u_m0))

    return list((threads.map if threads else map)(one, experiments))


def scorecard(results: Sequence[CaseResult]) -> Scorecard:
    """The benchmark's scorecard of ``results``."""
    return score(rules(PAPER), results)
