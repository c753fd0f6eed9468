"""The same jobs on a Dask cluster: futures of an existing engine, no protocol of our own.

FMUs travel by content, once to each worker. Workers need this package installed and nothing else; a job that is lost
with its worker is run again elsewhere, which changes nothing, since a result depends on its case alone.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..cosim.archive import Archive, open_archive
from ..cosim.trace import Place
from ..errors import BenchmarkError, InputError
from ..folders import cache_folder
from .host import run_hosted
from .job import Died, Job, Outcome

CONNECT_TIME = 15.0
"""Seconds to wait for the scheduler."""


def run(jobs: Sequence[Job], address: str) -> Generator[tuple[int, Outcome], None, None]:
    """Run ``jobs`` on the cluster whose scheduler is at ``address`` (``tcp://host:port``).

    Yields (number of the job, outcome) as they come; closing the generator closes the client, with which the scheduler
    forgets what is left. Raises :class:`InputError` where Dask is not installed, the scheduler does not answer, or a
    worker lacks something that the job needs.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError("--scheduler needs Dask: pip install 'distributed'.") from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what matters is told below, in one sentence
    try:
        client = Client(address, timeout=CONNECT_TIME)
    except (OSError, ValueError, TimeoutError) as problem:
        raise InputError(f"There is no Dask scheduler at {address}: {problem}.") from problem
    with client:
        files = {archive.sha256: archive.file for job in jobs for archive in (job.plant, job.controller)}
        # As tasks and not as scattered data: the scheduler makes them anew where the worker that held them is lost.
        contents = {sha256: client.submit(_content, file.read_bytes(), pure=False) for sha256, file in files.items()}
        futures = {
            client.submit(
                _run_remotely,
                _without_paths(job),
                contents[job.plant.sha256],
                contents[job.controller.sha256],
                pure=False,
            ): number
            for number, job in enumerate(jobs)
        }
        for future in as_completed(list(futures)):
            number = futures[future]
            try:
                outcomes = future.result()
            except KilledWorker as problem:
                outcomes = [_lost(index, problem) for index in range(len(jobs[number].tasks))]
            except InputError as problem:
                raise InputError(f"A worker of the cluster at {address} cannot run a job: {problem}") from problem
            except BenchmarkError:
                raise
            except Exception as problem:  # whatever a worker or the network has to offer
                reason = str(problem).strip().split("\n")[0] or type(problem).__name__
                raise BenchmarkError(
                    f"The cluster at {address} could not run a job: {reason}. What is finished is kept: run the "
                    "same command again. Workers need this package in the same version."
                ) from problem
            for outcome in outcomes:
                yield number, outcome


def _content(data: bytes) -> bytes:
    return data


def _without_paths(job: Job) -> Job:
    """``job`` without what only this machine knows; the worker opens the FMUs from their contents."""
    nowhere = Path()
    return replace(job, plant=replace(job.plant, folder=nowhere), controller=replace(job.controller, folder=nowhere))


def _run_remotely(job: Job, plant: bytes, controller: bytes) -> list[Outcome]:
    """On a worker: open the FMUs and let a host run the job, since a worker may have no multiprocessing children."""
    return run_hosted(replace(job, plant=_open(job.plant, plant), controller=_open(job.controller, controller)))


def _open(archive: Archive, content: bytes) -> Archive:
    folder = cache_folder() / "received"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        file = Path(scratch) / archive.name
        file.write_bytes(content)
        return replace(archive, folder=open_archive(file).folder)


def _lost(index: int, problem: Any) -> Died:
    return Died(index, False, f"its worker died repeatedly: {problem}", "", 0.0, Place(0, 0, ""), outside=True)
