"""Simulate again what a run's report shows in full. A case is deterministic, so this is the very one evaluated."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from .cosim.controller import Setup
from .cosim.master import simulate
from .cosim.slaves import Slave
from .execution import pool
from .execution.evaluation import GROUP_SIZE, START_TIME, Bench
from .execution.job import Finished
from .report import recording
from .report.recording import Recording
from .report.selection import Shown
from .report.trajectory_files import OBSERVED


def record_shown(wanted: Sequence[Shown], bench: Bench, workers: int, folder: Path) -> None:
    """Simulate ``wanted`` on ``workers`` processes and keep what the report needs of it in ``folder``.

    What fails before its first sample, or takes its process with it, is left out: its status stands in the results.
    """
    count = max(workers, math.ceil(len(wanted) / GROUP_SIZE))
    groups = [group for first in range(count) if (group := wanted[first::count])]
    work = functools.partial(_recorded, bench.setup)
    jobs = [bench.job(group, [shown.case.scenario for shown in group], work, START_TIME) for group in groups]
    found: dict[Shown, Recording] = {}
    with closing(pool.run(jobs, workers)) as outcomes:
        for number, outcome in outcomes:
            if isinstance(outcome, Finished):
                found[groups[number][outcome.index]] = outcome.value
    recording.save([found[shown] for shown in wanted if shown in found], folder)


def _recorded(setup: Setup, plant: Slave, controller: Slave, shown: Shown) -> Recording:
    trajectory = simulate(plant, controller, shown.case.scenario, setup, OBSERVED)
    return recording.record(shown.case, shown.roles, trajectory)
