"""The cross-entropy method in the Gymnasium environment: six gains of a linear policy, from those of the paper's PID.

    python examples/train_policy.py            (needs the extra gymnasium, and a C compiler for the FMU)

Each generation draws candidates from a normal distribution of the logarithms of the gains, and simulates each in the
same episodes: a force on the tool, at three poses, with arms and noise that are drawn from the seed. The mean and the
deviation of the best quarter are the next distribution. The best candidate is saved as trained.npz and becomes an FMU,
trained.fmu, and its V in the protocol quick is printed beside that of the first one. learning.svg shows the return of
each generation.
"""

import argparse
import math
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from matplotlib.figure import Figure

import orchestrator.gym
from orchestrator import Benchmark, Controller, Variation, controller_from_mlp

START = np.array([45.0, 15.0, 1.5, 0.5, 30.0, 10.0])
"""The paper's gains, two axes each: of the error [N.m/rad], its derivative [N.m.s/rad], its integral [N.m/(rad.s)]."""

POSES = ((0.0, -0.5), (0.5, -1.2), (1.0, -0.8))
"""Angles of the links [rad]; none of them is a pose of the protocol quick."""

PUSH = Variation(force=500.0, phi_F=-0.5 * math.pi, t_1=0.1, t_2=0.6, duration=Fraction(2))
"""A force [N] down, from t_1 to t_2 [s], and nothing else."""

SPREAD = 0.3
"""Standard deviation of the logarithms in the first generation."""

LEAST = 0.02
"""The smallest one in any generation, so that the search does not stop."""


class Generation(NamedTuple):
    """The returns [mm.s] of a generation: the best, the mean of the elite, and the mean of all."""

    best: float
    elite: float
    mean: float


def episodes(bench: Benchmark) -> list[Any]:
    """The cases that a candidate is tried in, the same for all."""
    still = Variation(undisturbed=True)
    cases = []
    for number, pose in enumerate(POSES):
        case = bench.case_at(pose, system=f"random_{number + 1}", test="disturbance")
        cases.append(bench.varied(bench.varied(case, still), PUSH))
    return cases


def weights(gains: np.ndarray) -> dict[str, Any]:
    """The policy as a network of one layer: its inputs are e, v, s and q_m_ref, two axes each."""
    blocks = [np.diag(gains[place : place + 2]) for place in (0, 2, 4)]
    return {"W1": np.hstack([*blocks, np.zeros((2, 2))]), "b1": np.zeros(2)}


def total(env: gymnasium.Env[Any, Any], gains: np.ndarray, cases: list[Any]) -> float:
    """The sum of the returns of a candidate over the ``cases`` [mm.s]."""
    policy, sum_of_returns = weights(gains), 0.0
    for case in cases:
        (observation, _), done = env.reset(options={"case": case}), False
        while not done:
            action = policy["W1"] @ observation + policy["b1"]
            observation, reward, terminated, truncated, _ = env.step(action)
            sum_of_returns, done = sum_of_returns + float(reward), terminated or truncated
    return sum_of_returns


def train(generations: int, population: int, seed: int = 0) -> tuple[np.ndarray, list[Generation]]:
    """The best gains of all generations, and how the returns went."""
    random = np.random.default_rng(seed)
    cases = episodes(Benchmark("quick", seed=seed + 1))
    env = gymnasium.make(orchestrator.gym.ID, protocol="quick")
    mean, spread = np.log(START), np.full(len(START), SPREAD)
    best, record, history = START, total(env, START, cases), []
    for number in range(generations):
        drawn = mean + spread * random.normal(size=(population, len(START)))
        returns = np.array([total(env, np.exp(logarithms), cases) for logarithms in drawn])
        order = np.argsort(-returns)
        elite = drawn[order[: max(2, population // 4)]]
        mean, spread = elite.mean(axis=0), np.maximum(elite.std(axis=0), LEAST)
        if returns[order[0]] > record:
            best, record = np.exp(drawn[order[0]]), float(returns[order[0]])
        history.append(Generation(record, float(returns[order[: len(elite)]].mean()), float(returns.mean())))
        print(f"generation {number + 1}: best {record:.2f} mm.s, mean {history[-1].mean:.2f} mm.s")
    env.close()
    return best, history


def draw(history: list[Generation], file: Path) -> None:
    """The learning curve."""
    figure = Figure(figsize=(5.0, 3.2), layout="constrained")
    axes = figure.subplots()
    for name in Generation._fields:
        values = [getattr(generation, name) for generation in history]
        axes.plot(range(1, len(history) + 1), values, marker="o", label=name)
    axes.set(xlabel="generation", ylabel="return [mm.s]")
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(file, metadata={"Date": None})


def main(generations: int, population: int, folder: Path) -> tuple[np.ndarray, list[Generation]]:
    """Train, draw the learning curve, and evaluate the first and the best policy as FMUs."""
    folder.mkdir(parents=True, exist_ok=True)
    gains, history = train(generations, population)
    draw(history, folder / "learning.svg")
    np.savez(folder / "trained.npz", activation="tanh", **weights(gains))
    for name, candidate in (("first", START), ("trained", gains)):
        file = controller_from_mlp({**weights(candidate), "activation": "tanh"}, out=folder / f"{name}.fmu")
        evaluation = Benchmark("quick").evaluate(Controller(file), recordings=False)
        failing = [name for name, entry in evaluation.requirements.items() if entry.passed is False]
        verdict = f"{', '.join(failing)} not met" if failing else "A1 to A3 met"
        cost = math.nan if evaluation.cost is None else evaluation.cost
        print(f"{name}: gains {np.round(candidate, 2).tolist()}, V = {cost:.1f} on quick, {verdict}")
    return gains, history


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Search for a policy by the cross-entropy method.")
    parser.add_argument("--generations", type=int, default=10)
    parser.add_argument("--population", type=int, default=16)
    parser.add_argument("--output-dir", type=Path, default=Path("trained"))
    given = parser.parse_args()
    main(given.generations, given.population, given.output_dir)
