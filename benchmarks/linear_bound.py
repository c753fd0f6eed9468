"""What a linear controller can reach: lower bounds of B5 by convex optimization, for one known linear arm a pose.

    python benchmarks/linear_bound.py                docs/linear_bound.json and the table in
                                                     controller_fmu/robust_linear/README.md, for all poses of the
                                                     protocol ``strict``: some 45 s of processor time each; needs a C
                                                     compiler
    python benchmarks/linear_bound.py --poses 0 18   these poses, numbered as in ``strict``; others are kept
    python benchmarks/linear_bound.py --table        the table anew

The arm is the system ``compliant`` with gears of constant stiffness, those of ``k_high``, linearized with sliding
friction. A controller only measures the motor angles; its torque acts a sample later. Bounds of the largest TCP error
under the force, in the directions of the protocol ``strict``, of which the first ``HORIZON`` samples count:

any            any causal law, linear or not, without noise, within the torque limits: a linear program
linear         linear time-invariant laws, u = -Q y with a causal Q and the angles y that the force alone would cause
               (Youla's parametrization; over a finite horizon, every causal Q belongs to a controller). The cost of the
               measurement noise counts: the least weighted sum of B5, B1 and B2, eq. (14)
sensitive      of these, laws with |S| of each axis of at most ``SENSITIVITY``, with which an axis bears the gain of A1:
               what S does to some motions of finite length may be no more than that
yielding       of these, laws under which the tool yields to a decaying force at least as much as with motors that do
               not move, see :func:`yields`

The last three are second-order cone programs. Beside them: ``RobustLinearLQG`` on the same linear model and simulated
on an arm within the tolerances, and the linear arm with motors that do not move.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402
from scipy.integrate import quad  # noqa: E402
from scipy.linalg import expm, toeplitz  # noqa: E402
from scipy.optimize import linprog  # noqa: E402
from scipy.signal import fftconvolve  # noqa: E402
from scipy.special import erf  # noqa: E402

from benchmarks.cone_program import Ball, ConeProgram, Minimum, Size  # noqa: E402
from benchmarks.marked_tables import with_table  # noqa: E402
from orchestrator import Benchmark, Controller, LinearModel, Variation  # noqa: E402
from orchestrator.benchmark import loop_analysis  # noqa: E402
from orchestrator.benchmark.loop_analysis import StateSpace  # noqa: E402

DATA, PAGE = ROOT / "docs" / "linear_bound.json", ROOT / "controller_fmu" / "robust_linear" / "README.md"
MAKER = "benchmarks/linear_bound.py"
NAME = "RobustLinearLQG"

MEMBER = {"k_low[2]": 0.3e6}
"""Nominal parameters with which ``compliant`` is an arm within the tolerances whose gear 2 is linear."""
LINEAR = {"k_low[1]": 1.5e6, "k_low[2]": 0.3e6}
"""Those with which both gears are: gear 1 then has the stiffness that it has under a load beyond ``psi``."""
SYSTEM, TEST = "compliant", "disturbance_0"

HORIZON, STRIDE = 200, 4
"""Samples of a closed loop that a bound looks at, and every how many of them the error counts."""

FORCE, PULSE = 500.0, 2000
"""Size [N] and length [samples] of the force."""

DIRECTIONS = np.radians([0.0, 45.0, 90.0, 135.0])
UNITS = np.array([np.cos(DIRECTIONS), np.sin(DIRECTIONS)])
"""Directions of the force, shape (2, 4)."""

SIDES = np.radians(np.arange(0.0, 180.0, 15.0))
"""Normals of the polygon with 24 sides around a circle, in the linear program: its error is below 1 %."""

SENSITIVITY = 5.0 / 3.0
"""1 / (1 - 1 / 2.5): a Nyquist curve that is no closer to -1 bears the gain 2.5 of A1."""

RATES = (4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
"""Rates [1/s] of decay at which :func:`yields` is asked for."""

ROUNDS, EACH, EXCESS = 3, 4, 0.02
"""Rounds in which motions are added, motions an axis and round, and the share by which S may exceed its limit."""

NOISE_TIME = 8000
"""Samples of the test of B1 and B2."""

SHORT = Variation(duration=Fraction(2), chirp_amplitude=(0.0, 0.0), t_3=0.1, t_4=0.2, t_1=0.5, t_2=1.0)
"""Of a simulation: the force alone."""


@dataclass(frozen=True)
class Responses:
    """Impulse and step responses of a sampled arm; SI units, shapes (samples, outputs, inputs).

    Parameters
    ----------
    g, p : numpy.ndarray
        Of q_m [rad] and X [m] to an impulse of u_m [N.m].
    y, X : numpy.ndarray
        Of q_m [rad] and X [m] to a step of the force of 500 N in x and in z, with u_m at rest.
    """

    g: np.ndarray
    p: np.ndarray
    y: np.ndarray
    X: np.ndarray


def responses(model: LinearModel, samples: int) -> Responses:
    """The first ``samples`` samples of the :class:`Responses` of a sampled model."""
    pulse, force = np.zeros((samples, 4, 2)), np.zeros((samples, 4, 2))
    x, pushed = model.B[:, :2], np.zeros((len(model.A), 2))
    for k in range(1, samples):
        pushed = model.A @ pushed + FORCE * model.B[:, 4:]
        pulse[k], force[k] = model.C @ x, model.C @ pushed
        x = model.A @ x
    return Responses(pulse[:, :2], pulse[:, 2:], force[:, :2], force[:, 2:])


def any_law(own: Responses, direction: np.ndarray, lowest: np.ndarray, highest: np.ndarray) -> float:
    """The least peak of the TCP error [m] with any torques after the first sample, in [``lowest``, ``highest``] [N.m].

    ``direction`` is the force's unit vector. The error's norm is replaced by the largest projection on the normals
    ``SIDES``, which is smaller. The program is in micrometres, since its solver drops coefficients below 1e-9.
    """
    samples = len(own.p)
    checked = np.arange(STRIDE, samples, STRIDE)
    blocks = [[toeplitz(1e6 * own.p[:, c, a], np.zeros(samples))[checked, 1:] for a in (0, 1)] for c in (0, 1)]
    x, z = (np.hstack(each) for each in blocks)
    error = 1e6 * own.X[checked] @ direction
    rows, limits = [], []
    for side in SIDES:
        projected = math.cos(side) * x + math.sin(side) * z
        moved = error @ (math.cos(side), math.sin(side))
        for sign in (1.0, -1.0):
            rows.append(np.hstack([sign * projected, -np.ones((len(checked), 1))]))
            limits.append(-sign * moved)
    ranges = [(low, high) for low, high in zip(lowest, highest, strict=True) for _ in range(samples - 1)]
    cost = np.append(np.zeros(len(ranges)), 1.0)
    found = linprog(cost, np.vstack(rows), np.concatenate(limits), bounds=[*ranges, (0.0, None)])
    if found.status != 0:
        raise ArithmeticError(found.message)
    return 1e-6 * float(found.fun)


def largest_of(count: int) -> float:
    """Expected largest absolute value of ``count`` independent standard normal numbers."""
    return float(quad(lambda x: 1.0 - erf(x / math.sqrt(2.0)) ** count, 0.0, 12.0)[0])


class Laws:
    """The linear laws for one arm, as a cone program for Q.

    Its variables are the elements of Q, times the noise's standard deviation ``sigma`` [rad], those of torque 1 first;
    then B5 [mm]; then what the noise makes of both torques, as standard deviations [N.m]. B1 and B2 are at least
    ``largest_of`` the parts of the noise test as long as the horizon times these: the torque at the end of a part is
    the sum of what its own noise causes and what older noise does, and by Anderson's inequality the second never makes
    a small torque more likely.
    """

    def __init__(self, model: LinearModel, bench: Benchmark, samples: int = HORIZON) -> None:
        rules = bench.rules
        self.model, self.samples, self.own = model, samples, responses(model, samples)
        self.sigma = math.sqrt(rules.loop.noise_power / model.sample_time) if model.sample_time else 0.0
        self.elements = 4 * samples
        share = {name: own.weight / own.target for name, own in rules.criteria.items()}
        noise = largest_of(NOISE_TIME // samples)
        self.cost = np.zeros(self.elements + 3)
        self.cost[-3:] = 1e-3 * share["B5"], noise * share["B1"], noise * share["B2"]
        self.answers = np.empty((2, 2, 2, 2, samples))  # of error c to force d by one element (a, b) of Q [mm]
        for c, d, a, b in np.ndindex(2, 2, 2, 2):
            answer = -fftconvolve(self.own.p[:, c, a], self.own.y[:, b, d])[:samples]
            self.answers[c, d, a, b] = 1e3 * answer / self.sigma

    def program(self) -> ConeProgram:
        """Minimize the weighted sum of B5, B1 and B2 over all linear laws."""
        checked = np.arange(STRIDE, self.samples, STRIDE)
        rows = np.zeros((len(checked), 2, 2, 2, 2, self.samples))
        for place, k in enumerate(checked):
            rows[place, ..., : k + 1] = self.answers[..., k::-1]
        along = np.einsum("kcdn,dj->kjcn", rows.reshape(len(checked), 2, 2, -1), UNITS).reshape(-1, 2, self.elements)
        errors = 1e3 * np.einsum("kcd,dj->kjc", self.own.X[checked], UNITS).reshape(-1, 2)
        n = self.elements
        return ConeProgram(
            cost=self.cost,
            rows=np.pad(along, ((0, 0), (0, 0), (0, 3))),
            constants=errors,
            level=n,
            linear=np.zeros((0, n + 3)),
            offsets=np.zeros(0),
            sizes=[Size(self.part(axis), n + 1 + axis) for axis in (0, 1)],
        )

    def part(self, axis: int) -> slice:
        """Where the elements of Q for the torque of ``axis`` (0 or 1) are."""
        return slice(2 * axis * self.samples, 2 * (axis + 1) * self.samples)

    def sensitivity(self, elements: np.ndarray, axis: int) -> np.ndarray:
        """What S of ``axis`` does to motions of the torque: its matrix, lower triangular, shape (samples, samples)."""
        answer = np.zeros(self.samples)
        answer[0] = 1.0
        for b, own in enumerate(elements[self.part(axis)].reshape(2, -1)):
            answer -= fftconvolve(self.own.g[:, b, axis], own)[: self.samples] / self.sigma
        found: np.ndarray = toeplitz(answer, np.zeros(self.samples))
        return found

    def limit(self, axis: int, motion: np.ndarray) -> Ball:
        """That S of ``axis`` makes a ``motion`` at most ``SENSITIVITY`` times larger; shape (samples,)."""
        loops = [-fftconvolve(self.own.g[:, b, axis], motion)[: self.samples] / self.sigma for b in (0, 1)]
        moved = np.hstack([toeplitz(loop, np.zeros(self.samples)) for loop in loops])
        return Ball(self.part(axis), moved, motion, SENSITIVITY * float(np.linalg.norm(motion)))

    def insensitive(self, program: ConeProgram) -> Minimum:
        """The minimum with |S| of each axis at most ``SENSITIVITY``: motions that S makes largest are added until it
        exceeds that by no more than ``EXCESS``, or for ``ROUNDS``. Each minimum on the way is a lower one."""
        minimum = program.minimize()
        for _ in range(ROUNDS):
            before = len(program.balls)
            for axis in (0, 1):
                _, gains, motions = np.linalg.svd(self.sensitivity(minimum.x[: self.elements], axis))
                worst = motions[:EACH][gains[:EACH] > SENSITIVITY * (1.0 + EXCESS)]
                program.balls += [self.limit(axis, motion) for motion in worst]
            if len(program.balls) == before:
                break
            minimum = program.minimize()
        return minimum

    def yielding(self, program: ConeProgram) -> ConeProgram:
        """``program`` with the inequality of :func:`yields` at all ``RATES`` and directions of the force.

        Of the sum over all samples, those beyond the horizon are at most B5 each.
        """
        rows, offsets = [], []
        for rate in RATES:
            z = math.exp(rate * float(self.model.sample_time or 0.0))
            weights, unit = z ** -np.arange(self.samples), 1.0 - 1.0 / z
            sums = [fftconvolve(weights, each[::-1])[self.samples - 1 :] for each in self.answers.reshape(16, -1)]
            by_force = np.reshape(sums, (2, 2, self.elements))
            alone = 1e3 * np.einsum("k,kcd->cd", weights, self.own.X)
            still = 1e3 * FORCE * (1.0 - z**-PULSE) / unit * held_compliance(self.model, rate)
            for d in UNITS.T:
                row = np.append(np.einsum("c,cdn,d->n", d, by_force, d), [z**-self.samples / unit, 0.0, 0.0])
                rows.append(unit * row)
                offsets.append(unit * float(d @ (alone - still) @ d))
        return replace(program, linear=np.array(rows), offsets=np.array(offsets), balls=[])


def transfer(system: StateSpace, rate: float) -> np.ndarray:
    """The transfer matrix of a sampled system at z = exp(``rate`` T_s), ``rate`` [1/s] real."""
    z = math.exp(rate * float(system.T_s or 0.0))
    found: np.ndarray = system.C @ np.linalg.solve(z * np.eye(len(system.A)) - system.A, system.B) + system.D
    return found


def held_compliance(model: LinearModel, rate: float) -> np.ndarray:
    """From F [N] to X [m] at exp(``rate`` T_s), shape (2, 2), with torques that keep the motors where they are."""
    whole = transfer(model.matrices, rate)
    (G, Y), (P, X) = ((rows[:, :2], rows[:, 4:]) for rows in (whole[:2], whole[2:]))
    found: np.ndarray = X - P @ np.linalg.solve(G, Y)
    return found


def yields(model: LinearModel, closed: StateSpace) -> float:
    """How much further the tool goes with a decaying force than with motors that do not move: the least share.

    With E(s) from F to X, the least d' (E(s) - H(s)) d / d' H(s) d over the directions d and the real s > 0 of
    ``RATES``, H being E with motors that do not move. In continuous time it is positive for two controllers, one an
    axis, that are stable by themselves (integrators included): E - H = R' W R with W = (K + Z)^-1, the impedance Z of
    the motors, which is symmetric, and K = diag(k_1, k_2), which is real; det(K + Z) has no zero for s > 0 as the loop
    is stable, and is positive for large s; so k_i + Z_ii, whose zero would make it negative, stays positive, and so
    does W.
    """
    shares = []
    for rate in RATES:
        still, own = held_compliance(model, rate), transfer(closed, rate)[2:4, 4:6]
        shares += [float(d @ (own - still) @ d / (d @ still @ d)) for d in UNITS.T]
    return min(shares)


def peak(steps: np.ndarray) -> float:
    """B5 [mm] from the steps of X [m] with a force of 1 N in x and in z, shape (samples, 2, 2)."""
    return float(1e3 * FORCE * np.linalg.norm(steps @ UNITS, axis=1).max())


def held_peak(model: LinearModel) -> float:
    """B5 [mm] of a continuous model's arm with motors that do not move."""
    links = [0, 1, 4, 5]
    step = 1e-3
    A, F = model.A[np.ix_(links, links)], model.B[links, 4:]
    moved = expm(step * np.block([[A, F], [np.zeros((2, 6))]]))
    x, found = np.zeros((4, 2)), []
    for _ in range(500):
        x = moved[:4, :4] @ x + moved[:4, 4:]
        found.append(model.C[2:, links] @ x)
    return peak(np.array(found))


def simulated(bench: Benchmark, controller: Controller, pose: tuple[float, float]) -> float:
    """B5 [mm] of a controller, the largest of all directions of the force."""
    errors = []
    for direction in DIRECTIONS.tolist():
        case = bench.varied(bench.case_at(pose, SYSTEM, TEST), replace(SHORT, phi_F=direction))
        found = bench.simulate(controller, case).trajectory
        errors.append(float(found.tcp_error[found.time >= case.scenario.pulse.start].max()))
    return 1e3 * max(errors)


def linear_arm(bench: Benchmark, pose: tuple[float, float], sampled: bool = True) -> LinearModel:
    """The arm of the bounds at a pose [rad]."""
    return bench.linearize(pose, SYSTEM, test=TEST, sampled=sampled, friction="sliding")


def at_pose(bench: Benchmark, member: Benchmark, controller: Controller, pose: tuple[float, float]) -> dict[str, Any]:
    """All figures at a pose [rad]: errors in mm, and the least share of V_k of B5, B1 and B2 together."""
    model = linear_arm(bench, pose)
    loop = bench.linear_loop(controller, pose, SYSTEM, test=TEST, friction="sliding")
    steps = np.stack([loop_analysis.step(loop.closed, 4 + axis, PULSE)[:, 2:4] for axis in (0, 1)], axis=2)
    room, at_rest = np.array(bench.rules.loop.torque_limit), np.array(model.at.u_m)
    laws = Laws(model, bench)
    limits = -room - at_rest, room - at_rest
    minima = {}
    minima["linear"] = laws.program().minimize()
    minima["sensitive"] = laws.insensitive(laws.program())
    minima["yielding"] = laws.insensitive(laws.yielding(laws.program()))
    return {
        "pose": [round(math.degrees(angle), 6) for angle in pose],
        "simulated": simulated(member, controller, pose),
        "loop": peak(steps),
        "sensitivity": [axis.sensitivity for axis in loop.margins],
        "yields": yields(model, loop.closed),
        "held": held_peak(linear_arm(bench, pose, sampled=False)),
        "any": 1e3 * max(any_law(laws.own, direction, *limits) for direction in UNITS.T),
        **{name: {"B5": found.x[-3], "V": found.bound} for name, found in minima.items()},
    }


HEAD = (
    "| pose | simulated | linear model | motors held | any law | linear | and \\|S\\| ≤ 5/3 | and yielding |\n"
    + 8 * "|---"
    + "|\n"
)


def table(poses: list[Mapping[str, Any]], bench: Benchmark) -> str:
    """B5 [mm] at each pose and as a mean, and what it makes of V; for the last three, with B1 and B2."""
    rule = bench.rules.criteria["B5"]
    share = 1e-3 * rule.weight / rule.target
    lines, cells = [HEAD], []
    for found in poses:
        own = [found[name] for name in ("simulated", "loop", "held", "any")]
        own += [found[name]["B5"] for name in ("linear", "sensitive", "yielding")]
        first, second = found["pose"]
        lines.append(f"| {first:g}°, {second:g}° | {' | '.join(f'{value:.1f}' for value in own)} |\n")
        cells.append(own)
    means = np.mean(cells, axis=0)
    costs = [share * mean for mean in means[:4]]
    costs += [float(np.mean([found[name]["V"] for found in poses])) for name in ("linear", "sensitive", "yielding")]
    lines.append(f"| mean | {' | '.join(f'**{value:.1f}**' for value in means)} |\n")
    lines.append(f"| of V | {' | '.join(f'{value:.1f}' for value in costs)} |\n")
    return "".join(lines)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--table", action="store_true", help="write the table of docs/linear_bound.json")
    parser.add_argument("--poses", nargs="+", type=int, metavar="NUMBER", help="poses of strict (default: all)")
    given = parser.parse_args()
    bench, member = (Benchmark("strict", plant_parameters=own) for own in (LINEAR, MEMBER))
    kept = json.loads(DATA.read_text(encoding="utf-8")) if DATA.exists() else {}
    poses = {case.configuration.index: (case.configuration.q_a1, case.configuration.q_a2) for case in bench.cases}
    for index in [] if given.table else given.poses or poses:
        kept[str(index)] = at_pose(bench, member, Controller.built_in(NAME), poses[index])
        kept = dict(sorted(kept.items(), key=lambda entry: int(entry[0])))
        DATA.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        print(f"pose {index}: {json.dumps(kept[str(index)])}", flush=True)
    made = table(list(kept.values()), bench)
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8"), made, MAKER), encoding="utf-8")


if __name__ == "__main__":
    main()
