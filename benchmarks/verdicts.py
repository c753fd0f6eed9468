"""Cases whose verdict by four windows, and in doubt by a longer simulation, is another than by the last two windows.

    python benchmarks/verdicts.py                                    the PID on ``paper``
    python benchmarks/verdicts.py FMU.fmu ... --protocol strict      other controllers

For each case: both verdicts, and the amplitudes [µm] in the last four windows before its own end, and before the later
one if it was simulated further. The last line of a controller counts the cases that were.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from msgspec import structs

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from orchestrator import Benchmark, Controller, Variation  # noqa: E402
from orchestrator.benchmark.one_pass import amplitudes  # noqa: E402
from orchestrator.benchmark.results import CaseResult  # noqa: E402
from orchestrator.benchmark.scorecard import kind  # noqa: E402


def by_case(bench: Benchmark, controller: Controller) -> dict[str, CaseResult]:
    """The results of all cases that a requirement is judged in."""
    cases = bench.evaluate(controller, recordings=False).cases
    return {case.id: case for case in cases if case.judged_until is not None}


def two_windows(result: CaseResult, bench: Benchmark) -> str:
    """The verdict on a result of :func:`at_own_end` by its last two windows alone."""
    last = structs.replace(result.measurements, limit_cycle_decay=None)
    return kind(structs.replace(result, measurements=last), bench.rules.stability)


def windows(bench: Benchmark, controller: Controller, id: str, until: float | None) -> str:
    """The amplitude in each of the last windows before ``until`` [s]."""
    limits, case = bench.rules.stability, bench.case(id)
    end = Fraction(until or 0.0)
    X = bench.simulate(controller, bench.varied(case, Variation(duration=end))).X
    samples = round(limits.limit_cycle_window / case.scenario.sample_time)
    starts = [len(X) - 1 - n * samples for n in range(limits.limit_cycle_windows, 0, -1)]
    sizes = [1e6 * float(amplitudes(X[begin : begin + samples + 1]).max()) for begin in starts]
    return f"{until:g} s: {', '.join(f'{size:.1f}' for size in sizes)} µm"


def at_own_end(protocol: str, folder: Path) -> Benchmark:
    """The same protocol without longer simulations."""
    file = folder / "own_end.toml"
    file.write_text(f'extends = "{protocol}"\nname = "own_end"\n[stability]\nlongest = 0.0\n', encoding="utf-8")
    return Benchmark(file)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("controllers", nargs="*", type=Path, metavar="FMU.fmu")
    parser.add_argument("--protocol", default="paper")
    options = parser.parse_args(arguments)
    controllers = [Controller(file) for file in options.controllers] or [Controller.built_in("DiagonalPID")]
    bench = Benchmark(options.protocol)
    with tempfile.TemporaryDirectory() as folder:
        own = at_own_end(options.protocol, Path(folder))
        for controller in controllers:
            before, after = by_case(own, controller), by_case(bench, controller)
            print(controller.archive.name)
            for id in sorted(before.keys() & after.keys()):
                old, new = two_windows(before[id], own), kind(after[id], bench.rules.stability)
                if old != new:
                    print(f"  {id}: {old} -> {new}")
                    for until in dict.fromkeys((before[id].judged_until, after[id].judged_until)):
                        print(f"    {windows(bench, controller, id, until)}")
            further = sum(after[id].judged_until != before[id].judged_until for id in before.keys() & after.keys())
            print(f"  {further} of {len(after)} cases were simulated further")
    return 0


if __name__ == "__main__":
    sys.exit(main())
