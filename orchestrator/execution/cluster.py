"""The same jobs on a Dask cluster: futures of an existing engine, no protocol of our own.

FMUs travel by content, once to each worker. Workers need this package installed, with the same code: another one is
refused before the first job. A job that is lost with its worker is run again elsewhere, which changes nothing, since a
result depends on its task alone. What comes back are bytes, decoded here like those of a local process.
"""

from __future__ import annotations

import gc
import logging
import tempfile
import time
from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import __version__
from ..cache import cache_folder, code_hash
from ..codec import Malformed, Struct, pack, unpack
from ..errors import BenchmarkError, EnvironmentFault, InputError
from ..fmi.archive import Archive, open_archive
from ..fmi.trace import Place
from .job import Died, Done, Job, Limits, Outcome
from .messages import ErrorRecord, Failed, Finished, FmuFiles, Order, error_of, error_record
from .supervision import run_isolated

CONNECT_TIME = 15.0
"""Seconds to wait for the scheduler."""

WORKER_TIME = 60.0
"""Seconds to wait for the first worker."""

LOOK = 1.0
"""Seconds between two looks whether there is one."""

logger = logging.getLogger(__name__)


class RemoteJob(Struct, frozen=True):
    """A job as it is sent to a worker of the cluster, with the code of the client, which the worker must have, too."""

    code: str
    order: Order
    limits: Limits
    largest: int
    sandbox: bool


class RemoteAnswer(Struct, frozen=True):
    """Outcomes, results not decoded yet; or the error that came instead."""

    outcomes: tuple[Finished | Failed | Died, ...] = ()
    error: ErrorRecord | None = None


def code_identity() -> str:
    """Version and hash of the code that results depend on, and that the two sides have to share."""
    return f"{__version__}, code {code_hash()[:12]}"


def run(jobs: Sequence[Job], address: str) -> Generator[tuple[int, Outcome], None, None]:
    """Run ``jobs`` on the cluster whose scheduler is at ``address`` (``tcp://host:port``).

    Yields (number of the job, outcome) as they come; closing the generator closes the client, with which the scheduler
    forgets what is left. Raises :class:`InputError` if Dask is not installed, the scheduler does not answer, or a
    worker lacks something that the job needs; :class:`EnvironmentFault` if the cluster has no worker or fails.
    """
    try:
        from distributed import Client, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError("A cluster needs Dask's package: pip install distributed", "no-dask") from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what matters is said below, in one sentence
    client: Any = None
    try:
        client = Client(address, timeout=CONNECT_TIME)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as problem:
        reason = str(problem)
    if client is None:
        gc.collect()  # a failed client closes itself when it is collected: not while the next one holds the lock
        raise InputError(f"There is no Dask scheduler at {address}: {reason}.", "no-scheduler", address)
    with client:
        _check_workers(client, address)
        archives = {archive.sha256: archive for job in jobs for archive in (job.plant, job.controller)}
        # As tasks and not as scattered data: the scheduler makes them anew where the worker that held them is lost.
        contents = {
            sha256: client.submit(bytes, archive.content or archive.file.read_bytes(), pure=False)
            for sha256, archive in archives.items()
        }
        futures = {
            client.submit(
                _run_remotely, _packed(job), contents[job.plant.sha256], contents[job.controller.sha256], pure=False
            ): number
            for number, job in enumerate(jobs)
        }
        for future in as_completed(list(futures)):  # type: ignore[no-untyped-call]
            number = futures[future]
            job = jobs[number]
            try:
                outcomes = _outcomes(future.result(), job)
            except KilledWorker as problem:
                outcomes = [_lost(index, problem) for index in range(len(job.tasks))]
            except BenchmarkError as problem:
                problem.args = (f"A worker of the cluster at {address} cannot run a job: {problem}",)
                raise
            except Exception as problem:  # whatever a worker or the network has to offer
                reason = str(problem).strip().split("\n")[0] or type(problem).__name__
                message = f"The cluster at {address} could not run a job: {reason}. What is finished is kept: do the "
                message += "same again. Workers need this package in the same version."
                raise EnvironmentFault(message, "cluster") from problem
            for outcome in outcomes:
                yield number, outcome


def _check_workers(client: Any, address: str) -> None:
    """Wait for a worker, and refuse those with other code: their numbers would be others."""
    deadline = time.monotonic() + WORKER_TIME
    while True:
        try:
            found: dict[str, str | Exception] = client.run(code_identity, on_error="return")
        except Exception as problem:  # whatever a worker without this package has to offer
            message = f"The workers of the cluster at {address} do not say which code they have: {problem}."
            raise EnvironmentFault(message, "cluster") from problem
        if found:
            break
        if time.monotonic() > deadline:
            raise EnvironmentFault(f"The cluster at {address} has had no worker for {WORKER_TIME:g} s.", "no-worker")
        logger.info("waiting for workers of the cluster at %s", address)
        time.sleep(LOOK)
    for worker, code in found.items():
        _check_code(code, f"The worker {worker} of the cluster at {address}")


def _check_code(code: str | Exception, whose: str) -> None:
    if code != code_identity():
        found = f"version {code}" if isinstance(code, str) else f"another version or none ({code})"
        message = f"{whose} has {found}, not {code_identity()}: its numbers would not be comparable."
        raise InputError(message, "other-code", whose, code)


def _packed(job: Job) -> bytes:
    return pack(RemoteJob(code_identity(), job.order(), job.limits, job.largest, job.sandbox))


def _run_remotely(packed: bytes, plant: bytes, controller: bytes) -> bytes:
    """On a worker: open the FMUs and run the job in processes of its own."""
    try:
        remote = unpack(packed, RemoteJob)
        _check_code(remote.code, "The client")
        job = Job(
            _open(remote.order.plant, plant),
            _open(remote.order.controller, controller),
            remote.order.work,
            remote.order.tasks,
            remote.order.time_limits,
            lambda _, value: value,
            remote.largest,
            remote.limits,
            remote.sandbox,
        )
        sent = (
            Finished(found.index, found.value, found.wall_time) if isinstance(found, Done) else found
            for found in run_isolated(job)
        )
        return pack(RemoteAnswer(tuple(sent)))
    except BenchmarkError as error:
        return pack(RemoteAnswer(error=error_record(error)))


def _open(files: FmuFiles, content: bytes) -> Archive:
    folder = cache_folder() / "received"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        file = Path(scratch) / Path(files.name).name
        file.write_bytes(content)
        archive = open_archive(file)
    if archive.sha256 != files.sha256:
        raise InputError(f"{files.name} has changed since it was opened.", "changed", files.name)
    return replace(archive, content=content)


def _outcomes(answer: object, job: Job) -> list[Outcome]:
    """What a worker sent, checked as if it came from a process here."""
    if not isinstance(answer, bytes):
        raise Malformed("not bytes")
    decoded = unpack(answer, RemoteAnswer)
    if decoded.error is not None:
        raise error_of(decoded.error)
    found = [
        Done(sent.index, job.decode(sent.index, sent.value), sent.wall_time) if isinstance(sent, Finished) else sent
        for sent in decoded.outcomes
    ]
    if [outcome.index for outcome in found] != list(range(len(job.tasks))):
        raise Malformed("not one outcome per task")
    return found


def _lost(index: int, problem: object) -> Died:
    return Died(index, False, f"its worker died repeatedly: {problem}", "", 0.0, Place(0, 0, ""), outside=True)
