"""What the plant's number of substeps changes: each criterion with one or two substeps per sample, and with sixteen.

    python benchmarks/substeps.py DiagonalPID_C RobustLQG          on ``paper`` (some minutes)
    python benchmarks/substeps.py DiagonalPID_C --protocol quick

Needs a C compiler. A copy of the packages, in which the longest substep is a sixteenth of the sample time, makes the
second evaluation. For each criterion the two values, their relative difference, and the largest relative difference
of a single case are printed; then V.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from orchestrator import Evaluation  # noqa: E402

COPIED = ("orchestrator", "plant_fmu", "controller_fmu", "build_fmus.py")
LENGTH = "0.25e-3"
SOURCES = ("plant_fmu/flexible_manipulator/integrator.py", "plant_fmu/native/integrator.h")


def refined(folder: Path, substeps: int) -> Path:
    """A copy of the packages whose plant takes so many substeps in each sample."""
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, folder)
    for name in SOURCES:
        text, count = re.subn(rf"MAX_SUBSTEP = {LENGTH}", rf"\g<0> / {substeps}", (folder / name).read_text("utf-8"))
        assert count == 1, name
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def evaluation(packages: Path, name: str, protocol: str, folder: Path) -> Evaluation:
    """That of a built-in controller by the packages in a folder."""
    build = [sys.executable, "build_fmus.py", name, "--output-dir", str(folder)]
    subprocess.run(build, cwd=packages, check=True, stdout=subprocess.DEVNULL)
    words = [sys.executable, "-m", "orchestrator.evaluate", str(folder / f"{name}.fmu"), "--protocol", protocol]
    subprocess.run([*words, "--output-dir", str(folder)], cwd=packages, check=True, stdout=subprocess.DEVNULL)
    return Evaluation.load(folder)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("controllers", nargs="+", metavar="NAME")
    parser.add_argument("--protocol", default="paper", metavar="NAME")
    parser.add_argument("--substeps", type=int, default=16)
    given = parser.parse_args()
    for name in given.controllers:
        with tempfile.TemporaryDirectory() as scratch:
            copy, here, there = (Path(scratch, part) for part in ("copy", "here", "there"))
            for folder in (copy, here, there):
                folder.mkdir()
            own = evaluation(ROOT, name, given.protocol, here)
            fine = evaluation(refined(copy, given.substeps), name, given.protocol, there)
        print(f"{name}: V = {own.cost!r}; {given.substeps} substeps: {fine.cost!r}, {own.cost / fine.cost - 1:+.1e}")
        for criterion, found in own.criteria.items():
            exact = fine.criteria[criterion].value
            pairs = [
                (getattr(one.measurements, criterion), getattr(other.measurements, criterion))
                for one, other in zip(own.cases, fine.cases, strict=True)
            ]
            largest = max(abs(one / other - 1.0) for one, other in pairs if one is not None and other)
            print(f"  {criterion} {found.value:.6g} {exact:.6g} {found.value / exact - 1:+.1e}, one case {largest:.1e}")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
