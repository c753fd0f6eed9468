"""Processor time of this version beside another one: an evaluation and a search with the PID in C.

    git worktree add ../other 3ba3248
    python benchmarks/versions.py ../other
    python benchmarks/versions.py ../other --rounds 5 --budget 600

Both versions run with the packages of this interpreter, alternately; the first run of each, in which the compilers
work, does not count. Printed are the medians of the processor time of all processes [s], and their ratio. The exit
code is 1 where a ratio is above 0.60.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TARGET = 0.60
CONTROLLER = "DiagonalPID_C"


def used(checkout: Path, words: list[str]) -> float:
    """Processor time [s] of a command of a version."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    code = subprocess.run([sys.executable, *words], cwd=checkout, **quiet).returncode  # type: ignore[call-overload]
    if code not in (0, 1):
        raise SystemExit(f"{' '.join(words)} in {checkout} ended with {code}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="folder of the other version")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=400, help="simulations of the search (default: 400)")
    given = parser.parse_args()
    good = True
    with tempfile.TemporaryDirectory() as scratch:
        folders = {given.checkout: Path(scratch, "other"), ROOT: Path(scratch, "own")}
        for checkout, folder in folders.items():
            folder.mkdir()
            used(checkout, ["build_fmus.py", CONTROLLER, "--output-dir", str(folder)])
        for command in (["evaluate"], ["robustness", "--no-list", "--no-report", "--budget", str(given.budget)]):
            times: dict[Path, list[float]] = {checkout: [] for checkout in folders}
            for number in range(1 + given.rounds):
                for checkout, folder in folders.items():
                    words = ["-m", f"orchestrator.{command[0]}", str(folder / f"{CONTROLLER}.fmu"), *command[1:]]
                    taken = used(checkout, [*words, "--output-dir", str(folder / f"{command[0]}-{number}")])
                    times[checkout] += [taken] if number else []
            other, own = (statistics.median(times[checkout]) for checkout in folders)
            good &= own <= TARGET * other
            print(f"{command[0]}: {own:.1f} s, the other version {other:.1f} s, ratio {own / other:.2f}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
