"""What it costs that a controller logs: from its step, and from three threads at once while its step waits for them.

    python benchmarks/log_messages.py
    python benchmarks/log_messages.py --rounds 9

Needs a C compiler. In every round each controller is simulated once, one after the other in one process; a ratio is
that of a controller which logs to the same one that does not, within a round, in processor time of all threads. The
medians over the rounds are printed. The exit code is 1 where three threads that log cost more than twice as much as
three threads that do not.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from hostile.fmus import Fault, hostile_fmu  # noqa: E402

from benchmarks.common import Contender, measure, median  # noqa: E402
from orchestrator.benchmark import cases as case_list  # noqa: E402
from orchestrator.benchmark import protocol as protocols  # noqa: E402
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.loop.trajectory import Status  # noqa: E402
from orchestrator.pairing.built_in import (  # noqa: E402
    FMUS,
    NATIVE,
    built_in,  # noqa: E402
)
from plant_fmu.flexible_manipulator.parameters import NOMINAL  # noqa: E402

TARGET = 2.0

STATUS = {0: "OK", 1: "warning"}

CHATS = [(0, 20, 0), (0, 20, 1), (0, 2000, 0), (0, 2000, 1), (3, 1, 0), (3, 1, 1), (3, 20, 0), (3, 20, 1)]
"""Threads (0: the step itself), messages of each in a step, and their status."""


def contender(plant: Slave, folder: Path, threads: int, messages: int, status: int) -> Contender:
    """Simulates a controller that logs; microseconds of processor time per sample."""
    scenario = case_list.cases(protocols.load("quick"), NOMINAL, 0)[0].scenario
    controller = load(open_archive(hostile_fmu(folder, Fault(f"chat:{threads}:{messages}:{status}", "step", 0.0))))

    def run() -> float:
        begin = time.process_time()
        trajectory = simulate(plant, controller, scenario)
        assert trajectory.ending.status is Status.DONE, trajectory.ending.message
        return (time.process_time() - begin) / scenario.samples * 1e6

    return run


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and tell whether the target is met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    rounds = parser.parse_args(arguments).rounds
    with tempfile.TemporaryDirectory() as folder:
        plant = load(open_archive(built_in(FMUS[NATIVE])))
        chats = [(0, 0, 0), (3, 0, 0), *CHATS]
        results = measure({str(chat): contender(plant, Path(folder), *chat) for chat in chats}, rounds)
    missed = False
    for chat in CHATS:
        threads, messages, status = chat
        silent = str((threads, 0, 0))
        ratio = median(results, lambda times, chat=chat, silent=silent: times[str(chat)] / times[silent])
        taken = median(results, lambda times, chat=chat: times[str(chat)])
        who = f"{threads} threads" if threads else "the step"
        print(f"{who}, {messages} messages each, {STATUS[status]:8}: {taken:8.2f} us a sample, {ratio:.2f} of silent")
        missed |= threads > 0 and messages == 1 and ratio > TARGET
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
