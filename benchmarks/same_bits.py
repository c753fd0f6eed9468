"""How many trajectories have other bits on another platform: closed loops in C, compiled for each and run here.

    python benchmarks/same_bits.py                   54 cases on all targets whose tools are installed (some minutes)
    python benchmarks/same_bits.py --cases 6 --duration 2 --targets gcc-O0,clang-O2

The cases are every test and every system of ``paper`` at one configuration, with each of three controllers. What a
target's program gives is compared with the master loop on this machine, which has the manipulator and the controllers
in C. Needs a C compiler; the exit code is 1 if a trajectory differs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from support.one_program import Program, answer, block_of, hash_of, program_input, write_program  # noqa: E402
from support.targets import TARGETS, Target, compile_program, run_program, wine_prefix  # noqa: E402
from support.tools import PRESENT  # noqa: E402

from controller_fmu.export.one_program import CONTROLLERS  # noqa: E402
from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.benchmark.case import Case  # noqa: E402


def cases_at(benchmark: Benchmark, configuration: int, longest: Fraction) -> list[Case]:
    """Every test with every system of the protocol at a configuration, none longer than ``longest`` [s]."""
    found = [case for case in benchmark.cases if case.configuration.index == configuration]
    return [replace(c, scenario=replace(c.scenario, duration=min(c.scenario.duration, longest))) for c in found]


def simulated(
    benchmark: Benchmark, program: Program, chosen: Sequence[tuple[str, Case]]
) -> tuple[list[list[float]], list[str], int]:
    """The program's numbers of the cases, the hashes of the master loop, and how many samples these have."""
    blocks, hashes, samples = [], [], 0
    for name, case in chosen:
        trajectory = benchmark.simulate(Controller(program.files[name]), case).trajectory
        blocks.append(block_of(program, name, benchmark, case))
        hashes.append(hash_of(trajectory, case.scenario))
        samples += len(trajectory.command)
    return blocks, hashes, samples


def differing(target: Target, program: Program, given: Path, wanted: Sequence[str]) -> int | None:
    """How many hashes differ on a target; None where the program can only be compiled."""
    product = compile_program(target, program.sources, program.folder, "program.exe")
    if target.runner is None:
        return None
    with wine_prefix() if "wine" in target.needs else nullcontext() as environment:
        lines = run_program(target, product, given, environment)
    return sum(answer(here).hash != there for here, there in zip(lines, wanted, strict=True))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=54, help="trajectories (default: %(default)s)")
    parser.add_argument("--configuration", type=int, default=7, help="of the protocol's grid (default: %(default)s)")
    parser.add_argument("--duration", type=Fraction, default=Fraction(26), help="at most [s] (default: %(default)s)")
    parser.add_argument("--targets", default=",".join(TARGETS), help="separated by commas (default: %(default)s)")
    given = parser.parse_args(arguments)
    benchmark = Benchmark(plant="native")
    every = product(CONTROLLERS, cases_at(benchmark, given.configuration, given.duration))
    chosen = list(every)[: given.cases]
    with tempfile.TemporaryDirectory() as scratch:
        program = write_program(Path(scratch))
        blocks, wanted, samples = simulated(benchmark, program, chosen)
        loops, other = program.folder / "loops.txt", 0
        loops.write_text(program_input(blocks))
        print(f"{len(blocks)} trajectories, {samples} samples", flush=True)
        for name in given.targets.split(","):
            target = TARGETS[name]
            missing = [tool for tool in target.needs if not PRESENT[tool]]
            if missing:
                print(f"{name:20} skipped: {', '.join(missing)} missing", flush=True)
                continue
            begin = time.monotonic()
            count = differing(target, program, loops, wanted)
            other += count or 0
            words = "compiled, not run" if count is None else f"{count} of {len(wanted)} differ"
            print(f"{name:20} {words} ({time.monotonic() - begin:.0f} s)", flush=True)
    return 1 if other else 0


if __name__ == "__main__":
    raise SystemExit(main())
