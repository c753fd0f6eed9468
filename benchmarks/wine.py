"""What a controller for Windows costs under Wine, against the same controller compiled for this machine.

    python benchmarks/wine.py controller.fmu
    python benchmarks/wine.py controller.fmu --exchanges 100000

The FMU has a library for Windows (win64) and sources; Wine and a C compiler are needed. Printed are, for an exchange
(write, step, read), the wall time and the processor time of the master's process in microseconds, the time that the
library takes to load, and whether the torques are equal. With ``--protocol quick`` the protocol is evaluated both ways,
on one process, and the files of cases are compared.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

import numpy as np  # noqa: E402

from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.library import SOURCE, WINE, LibraryKind  # noqa: E402
from orchestrator.fmi.port import Port, exchange  # noqa: E402
from orchestrator.fmi.slaves import load  # noqa: E402
from orchestrator.jit import compiled  # noqa: E402
from orchestrator.loop.controller import Steady, prepared  # noqa: E402
from orchestrator.loop.setup import Setup  # noqa: E402

STEP = 0.25e-3
AT_REST = Steady((0.1, 0.2), (1.0, 2.0), (0.1, 0.2))


@compiled
def many(port: Port, first: int, count: int) -> int:
    """So many exchanges in a row; the sum of their statuses."""
    total = 0
    for k in range(first, first + count):
        total += exchange(port, port.inputs.size, k * STEP, STEP, True)[1]
    return total


def exchanges(file: Path, library: LibraryKind, count: int) -> np.ndarray:
    """Print what they cost; the last torques [N.m]."""
    archive, begin = open_archive(file, library), time.perf_counter()
    slave = load(archive)
    started = time.perf_counter() - begin
    with prepared(slave, Setup(), AT_REST, Fraction(1, 4000), 2 * count * STEP) as port:
        many(port, 0, 100)
        wall, own = time.perf_counter(), time.process_time()
        assert many(port, 100, count) == 0, "a call failed"
        wall, own = (time.perf_counter() - wall) / count * 1e6, (time.process_time() - own) / count * 1e6
        text = f"{wall:.2f} µs per exchange, {own:.2f} µs of the master's processor time"
        print(f"{library}: {text}, {started:.2f} s to load")
        return port.output_values.copy()


def evaluation(file: Path, library: LibraryKind, protocol: str, folder: Path) -> bytes:
    """Print what it takes; the contents of its file of cases."""
    begin = time.perf_counter()
    Benchmark(protocol, workers=1).evaluate(
        Controller(file, library=library), folder=folder / library, recordings=False
    )
    print(f"{library}: {time.perf_counter() - begin:.1f} s for the protocol {protocol} on one process")
    return (folder / library / "cases.csv").read_bytes()


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--exchanges", type=int, default=50_000)
    parser.add_argument("--protocol")
    given = parser.parse_args()
    torques = [exchanges(given.file, library, given.exchanges) for library in (SOURCE, WINE)]
    print("equal torques" if np.array_equal(*torques) else "other torques")
    if given.protocol:
        with tempfile.TemporaryDirectory() as folder:
            files = [evaluation(given.file, library, given.protocol, Path(folder)) for library in (SOURCE, WINE)]
        print("equal cases" if files[0] == files[1] else "other cases")


if __name__ == "__main__":
    main()
