"""What this version costs beside another one, with the PID in C: a simulation, `evaluate --quick` and `evaluate`.

    git worktree add ../other c323655
    python benchmarks/versions.py ../other
    python benchmarks/versions.py ../other --rounds 15 --most 1.0

Both versions run with the packages of this interpreter, alternately; the first run of each, in which the compilers
work, does not count. Printed are the medians of the ratios of processor time, of all processes, and of wall time. The
exit code is 1 where the ratio of processor time is above 1.03: others' use of the machine is in the wall time.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONTROLLER = "DiagonalPID_C"
COMMANDS = (("simulate",), ("evaluate", "--quick"), ("evaluate",))


def used(checkout: Path, folder: Path, words: list[str]) -> tuple[float, float]:
    """Processor and wall time [s] of a command of a version, in a folder."""
    # A version whose machine code of modules may not be kept would be compiled in each run.
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": {**kept, "PYTHONPATH": str(checkout)}}
    code = subprocess.run([sys.executable, *words], cwd=folder, **quiet).returncode  # type: ignore[call-overload]
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if code not in (0, 1):
        raise SystemExit(f"{' '.join(words)} of {checkout} ended with {code}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="folder of the other version")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--most", type=float, default=1.03, help="ratio of processor time allowed (default: 1.03)")
    given = parser.parse_args()
    good, checkouts = True, (given.checkout.resolve(), ROOT)
    with tempfile.TemporaryDirectory() as scratch:
        used(ROOT, Path(scratch), [str(ROOT / "build_fmus.py"), CONTROLLER, "--output-dir", scratch])
        for command in COMMANDS:
            ratios = []
            for turn in range(1 + given.rounds):
                times = []
                for number, checkout in enumerate(checkouts):
                    folder = Path(scratch, f"{number}-{'-'.join(command)}-{turn}")
                    folder.mkdir()
                    words = ["-m", f"orchestrator.{command[0]}", str(Path(scratch, f"{CONTROLLER}.fmu"))]
                    times.append(used(checkout, folder, [*words, *command[1:]]))
                (other, other_wall), (own, own_wall) = times
                ratios += [(own / other, own_wall / other_wall)] if turn else []
            processor, wall = map(statistics.median, zip(*ratios, strict=True))
            good &= processor <= given.most
            print(f"{' '.join(command)}: processor time {processor:.3f}, wall time {wall:.3f}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
