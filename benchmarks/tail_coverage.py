"""How often the intervals of peaks over threshold cover the truth, for distributions whose tail is known.

    python benchmarks/tail_coverage.py                   200 samples of 1000 draws of each (a minute)
    python benchmarks/tail_coverage.py --draws 400       of the smallest sample that has a tail

Two figures at 95 % confidence: the value that one draw of 200 exceeds, and a probability of one draw in 5,000. The
tails are exponential (exponential, Gumbel), heavy (Pareto), and light (normal, beta), where a threshold at a tenth of
the draws is still far from the limit that the method rests on. The last one has a second mode, far beyond all others,
that one draw in 5,000 hits.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy import stats

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from orchestrator.benchmark.tail import tail  # noqa: E402

SAMPLES, CONFIDENCE, PROBABILITY, RARE = 200, 0.95, 1.0 / 200.0, 1.0 / 5000.0

KNOWN = {
    "exponential": stats.expon(),
    "Gumbel": stats.gumbel_r(80.0, 5.0),
    "Pareto": stats.genpareto(0.25),
    "normal": stats.norm(10.0, 1.0),
    "beta": stats.beta(2.0, 4.0),
}

FAR = 1e3
"""The second mode of a mixture with the normal distribution above, and that no other draw comes near."""


def covered(name: str, draws: int) -> tuple[float, float]:
    """The share of samples whose intervals contain the return level, and the exceedance probability."""
    known, counts = KNOWN[name], np.zeros(2)
    level, target = known.isf(PROBABILITY), known.isf(RARE)
    for seed in range(SAMPLES):
        found = tail(known.rvs(draws, random_state=seed).tolist(), float(target), PROBABILITY, CONFIDENCE)
        assert found is not None and found.level is not None and found.exceedance is not None
        counts += [
            found.level.low <= level <= found.level.high,
            found.exceedance.low <= RARE <= found.exceedance.high,
        ]
    return tuple(counts / SAMPLES)


def covered_mode(draws: int) -> tuple[float, int]:
    """Of samples that the second mode was in none of: the share whose interval contains its probability; and how many
    these are."""
    inside = tried = 0
    for seed in range(SAMPLES):
        stream = np.random.RandomState(seed)
        values = KNOWN["normal"].rvs(draws, random_state=stream)
        if stream.uniform(size=draws).min() < RARE:
            continue
        found = tail(values.tolist(), FAR / 2.0, PROBABILITY, CONFIDENCE)
        assert found is not None and found.exceedance is not None
        tried += 1
        inside += found.exceedance.low <= RARE <= found.exceedance.high
    return inside / tried, tried


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Measure how often the intervals of a tail cover the truth.")
    parser.add_argument("--draws", type=int, default=1000, help="of each sample (default: 1000)")
    options = parser.parse_args()
    for name in KNOWN:
        level, exceedance = covered(name, options.draws)
        print(f"{name:12} return level {100.0 * level:.0f} %, exceedance {100.0 * exceedance:.0f} %", flush=True)
    share, tried = covered_mode(options.draws)
    print(f"second mode  exceedance {100.0 * share:.0f} % of the {tried} samples that none of its draws is in")


if __name__ == "__main__":
    main()
