"""What can be asked of the service, by a page or a program alike: who may see what, quotas, and each change."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import anyio

from ..benchmark import draws
from ..codec import from_json
from ..documents.commands import evaluate_command
from ..documents.files import VERIFICATION
from ..errors import BenchmarkError
from ..text import printable
from . import binding, rounds
from .borders import Refusal
from .comparing import compared
from .database import Changed, Database
from .files import BINDING, DRAWN, EVALUATION, ID, INTERFACE, QUICK, SHOWN, Files, is_file, new_id, packed, plain_name
from .records import HandIn, Interface, Person, Round, Settings, State, Submission
from .runner import Runner

MAX_NAME = 120
"""Longest name that is kept of a file."""

MAX_PIECE = 1 << 20
"""Longest piece of a page [bytes] that is shown: each page is in memory as a whole until its reader has it."""

MAX_COMPARED = 12
"""Runs in one comparison."""

MAX_COMPARING = 2
"""Comparisons and archives of one person at a time."""

LONGEST_ROUND = 10 * 366 * 86400.0
"""How far the close of a round may be [s]."""

LOOK_EVERY = 1.0
"""Seconds between two looks whether a round has reached its date."""

MOVED = "This run has changed in the meantime. Look at it again."
ABSENT = "There is no such run."
CLOSED = "This round is closed: what counts in it stays as it is."

logger = logging.getLogger(__name__)

T = TypeVar("T")


@dataclass
class Service:
    """A service that runs: its state, its folder, and what runs the jobs."""

    settings: Settings
    database: Database
    files: Files
    runner: Runner
    streams: Counter[str] = field(default_factory=Counter)
    uploads: Counter[str] = field(default_factory=Counter)
    forms: Counter[str] = field(default_factory=Counter)
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
        queued, count, disk = self.database.usage(person.id)
        if queued >= limits.queue:
            message = f"{queued} of your runs have not ended; {limits.queue} may wait. Cancel one, or wait for one."
            raise Refusal(429, message)
        if count >= limits.runs:
            raise Refusal(507, f"You have {count} runs, and may have {limits.runs}. Delete some.")
        if disk + size > limits.disk:
            message = (
                f"Your runs take {disk / 1e6:.0f} MB of the {limits.disk / 1e6:.0f} MB that you have. Delete some."
            )
            raise Refusal(507, message)

    def may_follow(self, person: str) -> bool:
        """Whether one more request of somebody may wait for news: each takes one of the service's connections."""
        return self.streams[person] < self.settings.limits.streams

    def following(self, person: str) -> AbstractContextManager[None]:
        """While a request of somebody waits for news."""
        return _counted(self.streams, person)

    def uploading(self, person: Person) -> AbstractContextManager[None]:
        """While an upload of ``person`` lasts. What is half uploaded is in no quota of the disk: there is a number of
        them instead."""
        if self.uploads[person.id] >= self.settings.limits.uploads:
            raise Refusal(429, f"{self.uploads[person.id]} of your uploads are under way. Wait for one of them.")
        return _counted(self.uploads, person.id)

    def sending(self, person: Person) -> AbstractContextManager[None]:
        """While ``person`` sends something else, which is in memory until it is whole: hundreds of bindings would
        fill it."""
        if self.forms[person.id] >= self.settings.limits.forms:
            raise Refusal(429, f"{self.forms[person.id]} requests of yours are on their way. Wait for one of them.")
        return _counted(self.forms, person.id)

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
            id, size, sha256 = new_id(), len(text.encode()), incoming.kept()
            run = Submission(id, person.id, shown, plain_name(name), sha256, incoming.size, self._now(), bound=size)
            self._add(run, "received", text)
        finally:
            incoming.close()
        self.runner.wake()
        return run

    def _now(self) -> float:
        """The time of what is handed in: not before the round was opened, though the clock was set back since."""
        return max(time.time(), *(round.opened for round in self.database.rounds() if round.closed is None), 0.0)

    def _add(self, run: Submission, text: str, binding: str) -> None:
        try:
            self.database.add_run(run, text, binding)
        except (Changed, BenchmarkError) as problem:
            # Without a row it would be in nobody's quota: while the database was locked, each upload stayed.
            if not self.database.is_used(run.sha256):
                self.files.remove_fmu(run.sha256)
            if isinstance(problem, BenchmarkError):
                raise
            # --remove is another process
            raise Refusal(401, "You have been removed from this service.") from None

    def bind(self, run: Submission, text: str) -> Submission:
        """Use another mapping file: a refused run begins again, of any other one a second run is made."""
        if self.database.run(run.id) is None:  # deleted while the binding was on its way
            raise Refusal(404, ABSENT)
        anew = run.state is State.REFUSED
        self.check_quota(Person(run.owner, ""), 0 if anew else run.size)
        if anew:
            return self._moved(lambda: self.runner.begin_anew(run, text))
        id, size = new_id(), len(text.encode())
        again = Submission(id, run.owner, run.name, run.file_name, run.sha256, run.size, self._now(), bound=size)
        self._add(again, "received, with another binding", text)
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
        file = self.files.run(run.id) / INTERFACE
        try:
            return from_json(file.read_bytes(), Interface) if file.stat().st_size <= MAX_PIECE else None
        except (OSError, ValueError):
            return None

    def cancel(self, run: Submission) -> Submission:
        """End a run that has not ended."""
        if run.state.is_final:
            raise Refusal(409, "This run has ended already.")
        if run.state is State.VERIFYING:
            raise Refusal(409, "This run counts in a round that is closed. Delete it to take it out of the table.")
        return self._moved(lambda: self.runner.cancel(run))

    def retry(self, run: Submission) -> Submission:
        """Begin again with a run that failed or was cancelled."""
        if run.state not in (State.FAILED, State.CANCELLED):
            raise Refusal(409, "Only a run that failed or was cancelled can begin again.")
        if run.round:
            raise Refusal(409, "This run counts in a round that is closed: an organizer can have it verified again.")
        self.check_quota(Person(run.owner, ""))
        return self._moved(lambda: self.runner.retry(run))

    def _moved(self, change: Callable[[], T], sentence: str = MOVED) -> T:
        try:
            return change()
        except Changed:
            raise Refusal(409, sentence) from None

    def remove(self, run: Submission) -> None:
        """Delete a run, and its FMU if it is in no other one."""
        self.runner.remove(run)

    def file(self, run: Submission, place: str, name: str) -> Path:
        """A file of an evaluation, by the folder and one of the names that are given out."""
        if place not in (QUICK, EVALUATION) or name not in SHOWN:
            raise Refusal(404, "There is no such file.")
        file = self.files.run(run.id) / place / name
        if not is_file(file):
            raise Refusal(404, "There is no such file yet.")
        return file

    def piece(self, run: Submission, *path: str) -> str:
        """A piece of a page that a job has written; empty if there is none yet, a sentence if it cannot be shown."""
        file = self.files.run(run.id).joinpath(*path)
        try:
            if file.stat().st_size > MAX_PIECE:
                return "<p>This is too long to be shown here.</p>"
            return file.read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""
        except (OSError, ValueError):  # a damaged one is no text
            return "<p>What stands here cannot be read on the service's machine. Tell who runs the service.</p>"

    def command(self, run: Submission) -> str:
        """The command that repeats what is shown of a run: its evaluation, or until that has ended the quick one."""
        conduct = self.settings.conduct
        protocol = conduct.protocol if run.is_evaluated else conduct.quick_protocol
        return evaluate_command(run.file_name, BINDING if run.bound else "", Path(protocol).name)

    async def compare(self, person: Person, ids: Sequence[str]) -> str:
        """Compare finished runs; returns the id of the comparison."""
        ids = list(dict.fromkeys(ids))
        if not 2 <= len(ids) <= MAX_COMPARED:
            raise Refusal(400, f"Tick two to {MAX_COMPARED} finished runs to compare them.")
        runs = [self.own(person, id) for id in ids]
        if any(run.state is not State.FINISHED for run in runs):
            raise Refusal(409, "Only finished runs can be compared.")
        # The same runs are the same comparison: pressing twice makes no second one.
        id = hashlib.sha256(" ".join([person.id, *(run.id for run in runs)]).encode()).hexdigest()[:24]
        with self._making(person):
            async with self.comparing:
                await compared(self.files, id, [self.files.run(run.id) / EVALUATION for run in runs])
            # Deleted meanwhile: the page shows results that nobody has any more.
            if any(self.database.run(run.id) is None for run in runs):
                self.files.remove_comparison(id)
                raise Refusal(404, ABSENT)
            if self.database.comparison(id) is None:
                for old in self.database.add_comparison(id, person.id, [run.id for run in runs], time.time()):
                    self.files.remove_comparison(old)
        return id

    def _making(self, person: Person) -> AbstractContextManager[None]:
        """While a comparison or an archive is made for ``person``, two at a time of all. Else one person could keep all
        others from theirs: a request goes on when its client has left."""
        if self.comparisons[person.id] >= MAX_COMPARING:
            raise Refusal(429, "Comparisons or archives of yours are being made. Wait for one of them.")
        return _counted(self.comparisons, person.id)

    def comparison(self, person: Person, id: str) -> tuple[Submission, ...]:
        """The runs of a comparison that a person has made."""
        found = self.database.comparison(id) if ID.fullmatch(id) else None
        if found is None or found[0] != person.id:
            raise Refusal(404, "There is no such comparison.")
        return tuple(run for run in map(self.database.run, found[1]) if run is not None)

    # Rounds

    def round(self, id: str) -> Round:
        """The round with this id."""
        found = self.database.round(id) if ID.fullmatch(id) else None
        if found is None:
            raise Refusal(404, "There is no such round.")
        return found

    def open_round(self, person: Person, name: str, closes: str) -> Round:
        """Open a round until ``closes`` (ISO 8601, UTC if it names no zone)."""
        _check_organizer(person)
        # A run that was handed in while the clock was ahead is not handed in to this round.
        shown, now = printable(name).strip()[:MAX_NAME], max(time.time(), self.database.latest() + 1e-3)
        if not shown:
            raise Refusal(400, "A round needs a name.")
        end = draws.moment(closes).timestamp()
        if not now < end < now + LONGEST_ROUND:
            sentence = "A round closes in the future, within ten years, and after all that was handed in before it."
            raise Refusal(400, f"{sentence} Times are in UTC.")
        round = Round(new_id(), shown, now, end)
        try:
            self.database.add_round(round)
        except Changed:
            raise Refusal(409, "Another round is open. Close it first.") from None
        self.runner.wake()
        return round

    def choose(self, person: Person, round: Round, run: Submission) -> None:
        """Have a run count for its owner in a round that is open."""
        if round.closed is not None or time.time() >= round.closes:
            raise Refusal(409, CLOSED)
        if not self.database.is_handed_in(round, run.id):
            raise Refusal(409, "What counts is a finished run with a V that was handed in since the round was opened.")
        try:
            self.database.choose(round.id, HandIn(person.id, run.id))
        except Changed:
            raise Refusal(409, CLOSED) from None

    def counted(self, round: Round) -> dict[str, Submission]:
        """What counts in a round that is open, by its owner, if it were closed now."""
        return rounds.counted(self.database.entries(round.id), self.database.may_count(round))

    def close_round(self, person: Person, round: Round) -> Round:
        """Close a round before its date."""
        _check_organizer(person)
        if self.runner.is_storing(time.time()):
            raise Refusal(503, "The outcome of a run is being stored, and may count. Close the round in a moment.")
        return self._moved(lambda: self._close(round), CLOSED)

    def _close(self, round: Round) -> Round:
        """Close a round; raises :class:`.Changed` if it is closed already, or a run is another by now."""
        # The bits are of this moment, and stored with all that they are for: killed before that, nobody has seen them,
        # and killed after that, they stay.
        names = {person.id: person.name for person in self.database.people()}
        bits = draws.fresh().value
        closed, entries, changes = rounds.closed(round, self.counted(round), names, bits, time.time())
        self.database.close_round(closed, entries, changes)
        self.runner.wake()
        return closed

    async def keep_dates(self) -> None:
        """Close rounds at their dates, also those that passed while no service ran, until it is cancelled."""
        while True:
            try:
                for round in self.database.rounds():
                    # What had finished counts, though it was not stored before the date.
                    if (
                        round.closed is None
                        and round.closes <= time.time()
                        and not self.runner.is_storing(round.closes)
                    ):
                        self._close(round)
            except (Changed, BenchmarkError) as problem:
                # A run was deleted in between, or the disk is full: it is tried again.
                logger.warning("A round cannot be closed yet: %s", problem)
            except Exception:  # a mistake of ours, which must not keep rounds open for ever
                logger.exception("A round cannot be closed yet.")
            await asyncio.sleep(LOOK_EVERY)

    def verify_again(self, person: Person, round: Round) -> None:
        """Begin again with the verifications of a round that failed by faults of this machine, with the same draws."""
        _check_organizer(person)
        failed = [run for run in self.database.in_round(round.id) if run.state is State.FAILED]
        if not failed:
            raise Refusal(409, "No verification of this round has failed by a fault of this machine.")
        for run in failed:
            self._moved(lambda run=run: self.runner.retry(run))  # type: ignore[misc]

    async def certificates(self, person: Person, round: Round) -> bytes:
        """All certificates of a round that is final as a zip archive, each called by the id of its run."""
        runs = self.database.in_round(round.id)
        if rounds.phase(round, runs) != "final":
            raise Refusal(409, "There are certificates when all runs of a round that is closed are verified.")
        verified = [run for run in runs if run.drawn_cost is not None]
        files = {f"{run.id}.json": self.files.run(run.id) / DRAWN / VERIFICATION for run in verified}
        # Beside this thread: many large ones take a while.
        with self._making(person):
            async with self.comparing:
                return await anyio.to_thread.run_sync(packed, files)


@contextmanager
def _counted(under_way: Counter[str], person: str) -> Iterator[None]:
    """While one more thing of ``person`` is ``under_way``."""
    under_way[person] += 1
    try:
        yield
    finally:
        under_way[person] -= 1


def _check_organizer(person: Person) -> None:
    if not person.organizer:
        raise Refusal(403, "Only an organizer may do this.")
