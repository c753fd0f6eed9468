"""The same jobs on a Dask cluster: futures of an existing engine, no protocol of our own.

FMUs travel by content, once to each worker. Workers need this package installed, with the same code: another one is
refused before the first job. A job that is lost with its worker is run again elsewhere, which changes nothing, since a
result depends on its task alone. What comes back are bytes, decoded here like those of a local process.
"""

from __future__ import annotations

import gc
import logging
import platform
import queue
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from ..cache import cache_folder, code_hash, plant_hash
from ..codec import Malformed, NonNegative, Struct, pack, plain, unpack
from ..errors import BenchmarkError, EnvironmentFault, InputError
from ..fmi.archive import Archive, open_archive
from ..fmi.trace import Place
from ..text import printable
from ..version import __version__
from .job import Died, Done, Job, Limits, Outcome
from .messages import ErrorRecord, Failed, Finished, FmuFiles, Order, error_of, error_record
from .supervision import run_isolated

# Imports inside functions: Dask is optional.

WAIT = 60.0
"""Seconds to wait for the scheduler's and the workers' first words, and for the first worker."""

POLL_INTERVAL = 1.0
"""Seconds between two looks whether there is one, and whether the scheduler is still there."""

T = TypeVar("T")

logger = logging.getLogger(__name__)


class Identity(Struct, frozen=True):
    """What numbers depend on, and the two sides have to share: the package's version, the hashes of its code and of the
    plant's sources, the platform."""

    version: str
    code: str
    plant: str
    platform: str


class RemoteJob(Struct, frozen=True):
    """A job as it is sent to a worker of the cluster, with the identity of the client, which must be the worker's."""

    client: Identity
    order: Order
    time_limits: tuple[NonNegative, ...]
    longest_call: float
    limits: Limits
    largest: int
    sandbox: bool
    isolated: bool
    separate: bool


class RemoteAnswer(Struct, frozen=True):
    """Outcomes, results not decoded yet; or the error that came instead."""

    outcomes: tuple[Finished | Failed | Died, ...] = ()
    error: ErrorRecord | None = None


def identity() -> Identity:
    """Of this installation."""
    return Identity(__version__, code_hash(), plant_hash(), f"{platform.system()} {platform.machine()}")


def packed_identity() -> bytes:
    """What a worker is asked for."""
    return pack(identity())


def run(jobs: Sequence[Job], address: str, wait: float = WAIT) -> Generator[tuple[int, Outcome], None, None]:
    """Run ``jobs`` on the cluster whose scheduler is at ``address`` (``tcp://host:port``).

    Its scheduler and workers may keep silent for ``wait`` [s], the scheduler in mid-run, too (of workers it looks after
    itself); and as long it may be without workers. An address
    ``tls://host:port`` takes certificates from Dask's configuration.

    Yields (number of the job, outcome) as they come; closing the generator closes the client, with which the scheduler
    forgets what is left. Raises :class:`InputError` if Dask is not installed, the scheduler does not answer, or a
    worker lacks something that the job needs; :class:`EnvironmentFault` if the cluster has no worker or fails.
    """
    try:
        from distributed import Client
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError("A cluster needs Dask's package: pip install distributed", "no-dask") from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what matters is said below, in one sentence
    client: Any = None
    try:
        client = _within(wait, lambda: Client(address, timeout=wait))  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TypeError, TimeoutError) as problem:  # TypeError: no certificates for TLS
        reason = str(problem)
    if client is None:
        gc.collect()  # a failed client closes itself when it is collected: not while the next one holds the lock
        raise InputError(f"There is no Dask scheduler at {address}: {reason}.", "no-scheduler", address)
    with client:
        _check_workers(client, address, wait)
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
        finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        for future in futures:
            future.add_done_callback(finished.put)
        for _ in jobs:
            try:
                future = _next(finished, client, wait)
                number = futures[future]
                job = jobs[number]
                outcomes = _outcomes(_within(wait, future.result), job)
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


def _next(finished: queue.SimpleQueue[T], client: Any, wait: float) -> T:
    """What is ``finished`` next; :class:`TimeoutError` if the scheduler says nothing for ``wait`` [s] meanwhile."""
    while True:
        with suppress(queue.Empty):
            return finished.get(timeout=POLL_INTERVAL)
        _within(wait, client.nthreads)


def _within(seconds: float, ask: Callable[[], T]) -> T:
    """What ``ask`` returns or raises; :class:`TimeoutError` if it does neither in time, as where a server is silent."""
    answers: queue.SimpleQueue[tuple[T | None, BaseException | None]] = queue.SimpleQueue()

    def run() -> None:
        try:
            answers.put((ask(), None))
        except BaseException as problem:  # it is raised where it is waited for
            answers.put((None, problem))

    # A daemon: a scheduler that never answers must not keep the program from ending.
    threading.Thread(target=run, daemon=True).start()
    try:
        answer, problem = answers.get(timeout=seconds)
    except queue.Empty:
        raise TimeoutError(f"no answer within {seconds:g} s") from None
    if problem is not None:
        raise problem
    return answer  # type: ignore[return-value]  # one of the two is there


def _check_workers(client: Any, address: str, wait: float) -> None:
    """Wait for a worker, and refuse those whose numbers would be others."""
    deadline = time.monotonic() + wait
    told = False
    while True:
        try:
            identities = _within(wait, lambda: client.run(packed_identity, on_error="return"))
        except Exception as problem:  # whatever a worker without this package has to offer
            message = f"The workers of the cluster at {address} do not say who they are: {problem}."
            raise EnvironmentFault(message, "cluster") from problem
        if identities:
            break
        if time.monotonic() > deadline:
            raise EnvironmentFault(f"The cluster at {address} has had no worker for {wait:g} s.", "no-worker")
        if not told:
            logger.info("waiting for workers of the cluster at %s, %g s at most", address, wait)
        told = True
        time.sleep(POLL_INTERVAL)
    for worker, answer in identities.items():
        whose = f"The worker {worker} of the cluster at {address}"
        try:
            theirs = unpack(answer, Identity) if isinstance(answer, bytes) else None
        except Malformed:
            theirs = None
        if theirs is None:
            message = f"{whose} does not have this package, or another version: {printable(str(answer))[:200]}."
            raise InputError(message, "other-version", whose)
        _check_identity(theirs, whose)


def _check_identity(theirs: Identity, whose: str) -> None:
    for name, ours in plain(identity()).items():
        other = getattr(theirs, name)
        if other != ours:
            message = f"{whose} has another {name}, {other[:16]} and not {ours[:16]}: its numbers could be others."
            raise InputError(message, f"other-{name}", whose, other)


def _packed(job: Job) -> bytes:
    limits = job.time_limits, job.longest_call, job.limits, job.largest
    return pack(RemoteJob(identity(), job.order(), *limits, job.sandbox, job.isolated, job.separate))


def _run_remotely(packed: bytes, plant: bytes, controller: bytes) -> bytes:
    """On a worker: open the FMUs and run the job in processes of its own."""
    try:
        remote = unpack(packed, RemoteJob)
        _check_identity(remote.client, "The client")
        job = Job(
            _open(remote.order.plant, plant),
            _open(remote.order.controller, controller),
            remote.order.work,
            remote.order.tasks,
            remote.time_limits,
            lambda _, value: value,
            remote.largest,
            remote.limits,
            remote.sandbox,
            remote.isolated,
            separate=remote.separate,
            longest_call=remote.longest_call,
        )
        sent = (
            Finished(outcome.index, outcome.value, outcome.wall_time) if isinstance(outcome, Done) else outcome
            for outcome in run_isolated(job)
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
        archive = open_archive(file, files.library)
    if archive.sha256 != files.sha256:
        raise InputError(f"{files.name} has changed since it was opened.", "changed", files.name)
    # The file goes with the scratch folder; its bytes are needed should the worker's cache be deleted.
    return replace(archive, content=content)


def _outcomes(answer: object, job: Job) -> list[Outcome]:
    """What a worker sent, checked as if it came from a process here."""
    if not isinstance(answer, bytes):
        raise Malformed("not bytes")
    decoded = unpack(answer, RemoteAnswer)
    if decoded.error is not None:
        raise error_of(decoded.error)
    outcomes = [
        Done(sent.index, job.decode(sent.index, sent.value), sent.wall_time) if isinstance(sent, Finished) else sent
        for sent in decoded.outcomes
    ]
    # A worker may be another's machine: an answer that leaves a case out would be scored as if there were fewer.
    if [outcome.index for outcome in outcomes] != list(range(len(job.tasks))):
        raise Malformed("not one outcome per task")
    return outcomes


def _lost(index: int, problem: object) -> Died:
    return Died(index, False, f"its worker died repeatedly: {problem}", "", 0.0, Place(0, 0, ""), outside=True)
