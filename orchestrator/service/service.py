"""What can be asked of the service, by a page or a program alike: who may see what, quotas, and each change."""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import anyio

from ..codec import from_json
from ..documents.commands import evaluate_command
from ..text import printable
from . import binding
from .borders import Refusal
from .comparing import compared
from .database import Changed, Database
from .files import BINDING, EVALUATION, ID, INTERFACE, QUICK, SHOWN, Files, new_id, plain_name
from .records import Interface, Person, Settings, State, Submission
from .runner import Runner

MAX_NAME = 120
"""Longest name that is kept of a file."""

MAX_COMPARED = 12
"""Runs in one comparison."""

MAX_COMPARING = 2
"""Comparisons of one person at a time."""

MOVED = "This run has changed in the meantime. Look at it again."
ABSENT = "There is no such run."


@dataclass
class Service:
    """A service that runs: its state, its folder, and what runs the jobs."""

    settings: Settings
    database: Database
    files: Files
    runner: Runner
    streams: Counter[str] = field(default_factory=Counter)
    uploads: Counter[str] = field(default_factory=Counter)
    comparisons: Counter[str] = field(default_factory=Counter)
    closing: bool = False
    comparing: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(2))

    def own(self, person: Person, id: str) -> Submission:
        """The run of ``person`` with this id. That of another one is not there, so that nobody learns of ids."""
        run = self.database.run(id) if ID.fullmatch(id) else None
        if run is None or run.owner != person.id:
            raise Refusal(404, ABSENT)
        return run

    def check_quota(self, person: Person, size: int = 0) -> None:
        """Refuse a run beyond what a person may have."""
        limits = self.settings.limits
        queued, disk = self.database.usage(person.id)
        if queued >= limits.queue:
            message = f"{queued} of your runs have not ended; {limits.queue} may wait. Cancel one, or wait for one."
            raise Refusal(429, message)
        if disk + size > limits.disk:
            message = (
                f"Your runs take {disk / 1e6:.0f} MB of the {limits.disk / 1e6:.0f} MB that you have. Delete some."
            )
            raise Refusal(507, message)

    @contextmanager
    def uploading(self, person: Person) -> Iterator[None]:
        """While an upload of ``person`` lasts. What is half uploaded is in no quota of the disk: there is a number of
        them instead."""
        if self.uploads[person.id] >= self.settings.limits.uploads:
            raise Refusal(429, f"{self.uploads[person.id]} of your uploads are under way. Wait for one of them.")
        self.uploads[person.id] += 1
        try:
            yield
        finally:
            self.uploads[person.id] -= 1

    async def accept(self, person: Person, name: str, pieces: AsyncIterator[bytes], text: str = "") -> Submission:
        """Take an upload, with the ``text`` of a mapping file if there is one; returns the run that waits."""
        self.check_quota(person)
        incoming = self.files.incoming()
        try:
            async for piece in pieces:
                incoming.add(piece)
            await anyio.to_thread.run_sync(incoming.settle)
            # Again, as others may have come in meanwhile. From here on nothing waits: the file is there with its row.
            self.check_quota(person, incoming.size)
            shown = printable(name).strip()[-MAX_NAME:] or "controller.fmu"
            sha256 = incoming.kept()
            run = Submission(
                new_id(), person.id, shown, plain_name(name), sha256, incoming.size, time.time(), binding=text
            )
            self.database.add_run(run, "received")
        finally:
            incoming.close()
        self.runner.wake()
        return run

    def bind(self, run: Submission, text: str) -> Submission:
        """Use another mapping file: a refused run begins again, of any other one a second run is made."""
        if run.state is State.REFUSED:
            return self._moved(lambda: self.runner.begin_anew(run, text))
        self.check_quota(Person(run.owner, ""), run.size)
        again = Submission(
            new_id(), run.owner, run.name, run.file_name, run.sha256, run.size, time.time(), binding=text
        )
        self.database.add_run(again, "received, with another binding")
        self.runner.wake()
        return again

    def bind_by_form(self, run: Submission, chosen: Mapping[str, str], given: Mapping[str, str]) -> Submission:
        """The same by what was chosen in the form."""
        interface = self.interface(run)
        if interface is None:
            raise Refusal(409, "The FMU has not been looked at yet, or cannot be opened.")
        return self.bind(run, binding.mapping_file(interface, chosen, given))

    def interface(self, run: Submission) -> Interface | None:
        """What the form is made of; None before the FMU was opened, or if it cannot be."""
        try:
            return from_json((self.files.run(run.id) / INTERFACE).read_bytes(), Interface)
        except (OSError, ValueError):
            return None

    def cancel(self, run: Submission) -> Submission:
        """End a run that has not ended."""
        if run.state.is_final:
            raise Refusal(409, "This run has ended already.")
        return self._moved(lambda: self.runner.cancel(run))

    def retry(self, run: Submission) -> Submission:
        """Begin again with a run that failed or was cancelled."""
        if run.state not in (State.FAILED, State.CANCELLED):
            raise Refusal(409, "Only a run that failed or was cancelled can begin again.")
        self.check_quota(Person(run.owner, ""))
        return self._moved(lambda: self.runner.retry(run))

    def _moved(self, change: Callable[[], Submission]) -> Submission:
        try:
            return change()
        except Changed:
            raise Refusal(409, MOVED) from None

    def remove(self, run: Submission) -> None:
        """Delete a run, and its FMU if it is in no other one."""
        self.runner.remove(run)

    def file(self, run: Submission, place: str, name: str) -> Path:
        """A file of an evaluation, by the folder and one of the names that are given out."""
        if place not in (QUICK, EVALUATION) or name not in SHOWN:
            raise Refusal(404, "There is no such file.")
        file = self.files.run(run.id) / place / name
        if not file.is_file():
            raise Refusal(404, "There is no such file yet.")
        return file

    def piece(self, run: Submission, *path: str) -> str:
        """A piece of a page that a job has written; empty if there is none yet."""
        try:
            return self.files.run(run.id).joinpath(*path).read_text(encoding="utf-8")
        except OSError:
            return ""

    def command(self, run: Submission) -> str:
        """The command that repeats a run."""
        return evaluate_command(
            run.file_name, BINDING if run.binding else "", Path(self.settings.conduct.protocol).name
        )

    async def compare(self, person: Person, ids: Sequence[str]) -> str:
        """Compare finished runs; returns the id of the comparison."""
        runs = [self.own(person, id) for id in dict.fromkeys(ids)]
        if not 2 <= len(runs) <= MAX_COMPARED:
            raise Refusal(400, f"Tick two to {MAX_COMPARED} finished runs to compare them.")
        if any(run.state is not State.FINISHED for run in runs):
            raise Refusal(409, "Only finished runs can be compared.")
        # The same runs are the same comparison: pressing twice makes no second one.
        id = hashlib.sha256(" ".join([person.id, *(run.id for run in runs)]).encode()).hexdigest()[:24]
        # Else one person could keep all others from comparing: a request goes on when its client has left.
        if self.comparisons[person.id] >= MAX_COMPARING:
            raise Refusal(429, "Comparisons of yours are under way. Wait for one of them.")
        self.comparisons[person.id] += 1
        try:
            async with self.comparing:
                await compared(self.files, id, [self.files.run(run.id) / EVALUATION for run in runs])
            # Deleted meanwhile: the page shows results that nobody has any more.
            if any(self.database.run(run.id) is None for run in runs):
                self.files.remove_comparison(id)
                raise Refusal(404, ABSENT)
            if self.database.comparison(id) is None:
                for old in self.database.add_comparison(id, person.id, [run.id for run in runs], time.time()):
                    self.files.remove_comparison(old)
        finally:
            self.comparisons[person.id] -= 1
        return id

    def comparison(self, person: Person, id: str) -> tuple[Submission, ...]:
        """The runs of a comparison that a person has made."""
        found = self.database.comparison(id) if ID.fullmatch(id) else None
        if found is None or found[0] != person.id:
            raise Refusal(404, "There is no such comparison.")
        return tuple(run for run in map(self.database.run, found[1]) if run is not None)
