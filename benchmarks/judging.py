"""What reading the figures off a trajectory costs: compiled passes, beside those of NumPy.

    python benchmarks/judging.py              26 s of white noise as positions and torques
    python benchmarks/judging.py --rounds 50

The exit code is 1 if the two differ in any bit. The strongest frequency, which decides nothing, is in neither.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from benchmarks.common import measure, median  # noqa: E402
from orchestrator.benchmark.one_pass import COSINES, SINES, Places, amplitudes, scan  # noqa: E402

SAMPLES, RATE = 104_000, 4000
PLACES = Places(end=SAMPLES + 1, chirp=RATE // 2, force=10 * RATE, release=21 * RATE // 2 + 1, rest=25 * RATE)
STARTS = np.array([SAMPLES - 3 * n * RATE for n in (4, 3, 2, 1)])
SETTLING, RECOVERY = 0.1e-3, 50e-6
U_M0 = 3.0, -2.0

Figures = list[float]


def compiled(X: np.ndarray, torque: np.ndarray) -> Figures:
    """The figures by :func:`scan` and :func:`amplitudes`."""
    found = scan(X, torque, U_M0, PLACES, SETTLING, RECOVERY)
    errors = found.force_error, found.chirp_error, found.rest_error, found.settling, found.recovery
    windows = np.split(X, STARTS)[1:]
    return [*found.noise, *found.torque, *errors, *(float(value) for each in windows for value in amplitudes(each))]


def by_numpy(X: np.ndarray, torque: np.ndarray) -> Figures:
    """The same figures, each by itself."""
    offset = X - X[0]
    error = np.sqrt(offset[:, 0] * offset[:, 0] + offset[:, 1] * offset[:, 1])
    noise = np.max(np.abs(torque - U_M0), axis=0)
    largest = np.max(np.abs(torque), axis=0)
    parts = error[PLACES.force :], error[PLACES.chirp : PLACES.force], error[PLACES.rest :]
    numbers = np.arange(len(error))
    last = [np.flatnonzero((numbers >= PLACES.release) & (error >= limit))[-1] for limit in (SETTLING, RECOVERY)]
    windows = np.split(X, STARTS)[1:]
    sizes = [
        0.5 * np.ptp(cosine * (window[:, 0] - window[0, 0]) + sine * (window[:, 1] - window[0, 1]))
        for window in windows
        for cosine, sine in zip(COSINES, SINES, strict=True)
    ]
    return [float(value) for value in (*noise, *largest, *map(np.max, parts), *last, *sizes)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=20, help="how often each runs (default: 20)")
    rounds = parser.parse_args(arguments).rounds
    stream = np.random.RandomState(1)
    X, torque = 1e-3 * stream.standard_normal((SAMPLES + 1, 4))[:, 2:], stream.standard_normal((SAMPLES, 2))

    def timed(read: Callable[[np.ndarray, np.ndarray], Figures]) -> Callable[[], float]:
        def run() -> float:
            begin = time.perf_counter()
            read(X, torque)
            return 1e6 * (time.perf_counter() - begin) / SAMPLES

        return run

    ways = {"NumPy": by_numpy, "compiled": compiled}
    results = measure({name: timed(read) for name, read in ways.items()}, rounds)
    for name in ways:
        each = median(results, lambda times, name=name: times[name])
        print(f"{each:8.4f} µs per sample, {1e-3 * each * SAMPLES:7.2f} ms for 26 s   {name}")
    same = compiled(X, torque) == by_numpy(X, torque)
    print("both give the same bits" if same else "THE FIGURES DIFFER")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
