"""Simulate again what a run's report shows in full. A case is deterministic, so this is the very one evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .errors import BenchmarkError
from .execution.evaluation import Bench, simulate_isolated
from .report import recording
from .report.recording import Recording
from .report.selection import Shown
from .report.trajectory_files import OBSERVED


def record_shown(wanted: Sequence[Shown], bench: Bench, workers: int, folder: Path) -> None:
    """Simulate ``wanted`` on ``workers`` processes and keep what the report needs of it in ``folder``.

    What fails before its first sample is left out: its status stands in the results.
    """

    def simulated(shown: Shown) -> Recording | None:
        try:
            trajectory = simulate_isolated(shown.case.scenario, bench, OBSERVED)
        except BenchmarkError:
            return None
        return recording.record(shown.case, shown.roles, trajectory)

    threads = ThreadPoolExecutor(workers)
    try:
        found = [entry for entry in threads.map(simulated, wanted) if entry is not None]
    finally:
        threads.shutdown(cancel_futures=True)
    recording.save(found, folder)
