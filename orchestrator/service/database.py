"""The one file of state: people, sessions, runs with their history, comparisons and rounds. Each method is one
transaction.

It is used by one thread. Other processes may read and write beside it, such as a command that invites somebody.
"""

from __future__ import annotations

import os
import sqlite3
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import astuple, fields
from pathlib import Path

from ..errors import EnvironmentFault, InputError
from .files import FULL, NO_ROOM, is_empty
from .records import FINAL, HandIn, Person, Round, Stage, State, Submission

FORM = 6
"""Of the tables. A version that changes them reads this number."""

LEAST = 100_000
"""What a run counts in a quota at the least [bytes]: of runs that are cancelled at once, with an FMU of some bytes,
there would else be no end."""

MAX_COMPARISONS = 20
"""Comparisons that are kept of each person: their pages are in no quota of the disk."""

MAX_SESSIONS = 20
"""Browsers of one person: whoever comes in by a key again and again has else a row for each time."""

MAX_HISTORY = 200
"""Lines that are kept of a run's history: it can be cancelled and begun again for ever."""

FREED = 2000
"""Pages [4 kB] of the file that are given back at a time, for which everybody waits."""

MAX_ROWS = 500
"""Lines of the table."""

BUSY = 5.0
"""Seconds that a transaction of a command waits for another process."""

SHARED = 1 << 16
"""Bytes, and more than the file -shm takes at a time."""

LOCKED = "locked-database"
"""Code of the error when that was too short."""

STAY = """
CREATE TRIGGER bits_stay BEFORE UPDATE OF id, name, opened, closes, closed, bits ON rounds WHEN OLD.bits <> ''
BEGIN SELECT RAISE(ABORT, 'drawn already'); END
"""
"""Keeps a round that is closed as it is."""

TABLES = f"""
CREATE TABLE people (
    id TEXT PRIMARY KEY, name TEXT NOT NULL UNIQUE, key TEXT NOT NULL, created REAL NOT NULL,
    organizer INTEGER NOT NULL, served REAL NOT NULL DEFAULT 0
) STRICT;
CREATE TABLE sessions (
    key TEXT PRIMARY KEY, person TEXT NOT NULL REFERENCES people ON DELETE CASCADE, until REAL NOT NULL
) STRICT;
CREATE TABLE runs (
    id TEXT PRIMARY KEY, owner TEXT NOT NULL REFERENCES people ON DELETE CASCADE, name TEXT NOT NULL,
    file_name TEXT NOT NULL, sha256 TEXT NOT NULL, size INTEGER NOT NULL, created REAL NOT NULL, state TEXT NOT NULL,
    running INTEGER NOT NULL, attempts INTEGER NOT NULL, interruptions INTEGER NOT NULL, not_before REAL NOT NULL,
    started REAL NOT NULL, finished REAL NOT NULL, reason TEXT NOT NULL, bound INTEGER NOT NULL, verdict TEXT NOT NULL,
    quick_cost REAL, cost REAL, holds INTEGER, remark TEXT NOT NULL, disk INTEGER NOT NULL, revision INTEGER NOT NULL,
    round TEXT NOT NULL, drawn_cost REAL, drawn_holds INTEGER, drawn_remark TEXT NOT NULL, deviations TEXT NOT NULL,
    seal INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE INDEX runs_by_owner ON runs (owner, created);
CREATE INDEX runs_by_state ON runs (state);
CREATE INDEX runs_by_file ON runs (sha256);
CREATE TABLE bindings (run TEXT PRIMARY KEY REFERENCES runs ON DELETE CASCADE, text TEXT NOT NULL) STRICT;
CREATE TABLE history (
    run TEXT NOT NULL REFERENCES runs ON DELETE CASCADE, at REAL NOT NULL, text TEXT NOT NULL
) STRICT;
CREATE INDEX history_by_run ON history (run, at);
CREATE TABLE comparisons (
    id TEXT PRIMARY KEY, owner TEXT NOT NULL REFERENCES people ON DELETE CASCADE, runs TEXT NOT NULL,
    created REAL NOT NULL
) STRICT;
CREATE TABLE rounds (
    id TEXT PRIMARY KEY, name TEXT NOT NULL, opened REAL NOT NULL, closes REAL NOT NULL, closed REAL,
    bits TEXT NOT NULL, seal INTEGER NOT NULL DEFAULT 0
) STRICT;
{STAY.strip()};
CREATE TABLE entries (
    round TEXT NOT NULL REFERENCES rounds ON DELETE CASCADE, owner TEXT NOT NULL, run TEXT NOT NULL,
    person TEXT NOT NULL, name TEXT NOT NULL, seal INTEGER NOT NULL DEFAULT 0, PRIMARY KEY (round, owner)
) STRICT;
CREATE TABLE protocols (stage TEXT PRIMARY KEY, name TEXT NOT NULL, contents TEXT NOT NULL) STRICT;
CREATE TABLE form (number INTEGER NOT NULL) STRICT;
"""

COLUMNS = ", ".join(field.name for field in fields(Submission))
MARKS = ", ".join("?" for _ in fields(Submission))
ROUND = ", ".join(field.name for field in fields(Round))
HANDED_IN = "state = 'finished' AND cost IS NOT NULL AND round = '' AND created >= ? AND created < ?"
ENTRY = ", ".join(("round", *(field.name for field in fields(HandIn))))

SEALED: Mapping[str, str] = {"runs": COLUMNS, "rounds": ROUND, "entries": ENTRY}
"""The tables whose rows have a checksum, and what it is of: all that a place and its draws follow from."""


def _sealing(table: str) -> str:
    """Keeps a checksum of rows as they are stored. SQLite has none: one bit of V that was another went into the table,
    one of a round's bits into the draws, and ``integrity_check`` said "ok"."""
    return f"UPDATE {table} SET seal = seal({SEALED[table]})"


UPGRADES: Mapping[int, Sequence[str]] = {
    4: (
        "ALTER TABLE people ADD COLUMN served REAL NOT NULL DEFAULT 0",
        "UPDATE people SET served = COALESCE((SELECT MAX(started) FROM runs WHERE owner = people.id), 0)",
        "ALTER TABLE runs ADD COLUMN seal INTEGER NOT NULL DEFAULT 0",
        _sealing("runs"),
    ),
    5: (
        "DROP TRIGGER bits_stay",
        STAY,
        *(f"ALTER TABLE {table} ADD COLUMN seal INTEGER NOT NULL DEFAULT 0" for table in ("rounds", "entries")),
        *map(_sealing, ("rounds", "entries")),
    ),
}
"""What makes the tables of an earlier form those of the next one."""

FINALS = ", ".join(f"'{state.value}'" for state in FINAL)

HELD: Mapping[Stage, str] = {
    "evaluating": "cost IS NOT NULL OR state = 'evaluating'",
    "verifying": "round <> '' AND state <> 'finished'",
}
"""The runs for which a stage must keep its protocol: those of one table, and those of one round."""


class Changed(Exception):
    """The run or round is not what it was when the change was decided, or is no more."""


class Database:
    """The state of the service in the SQLite file ``file``. Its tables are made if it ``may_begin`` and has none.

    Those of an earlier form are upgraded. It waits ``patience`` [s] for another process. Raises :class:`InputError` for
    a file of another version, and for one without tables that may not begin; :class:`EnvironmentFault` for one that
    cannot be opened. A method raises :class:`EnvironmentFault` if the disk is full or the file locked; nothing has
    changed then.
    """

    def __init__(self, file: Path, patience: float = BUSY, may_begin: bool = True) -> None:
        self._file = file
        try:
            # The thread that makes it need not be the one that uses it; only one does.
            self._connection = sqlite3.connect(file, timeout=patience, isolation_level=None, check_same_thread=False)
            # Before anything is written: an empty file is to stay what it is. A copy of one had made its tables, and
            # the next start removed all runs and FMUs, which no row named.
            if not self._has_tables() and not (may_begin and is_empty(file.parent)):
                message = f"{file} has no tables of a service. Put a whole copy of the service there, or choose an "
                raise InputError(f"{message}empty folder.", "no-service", file.parent)
            # Of a file without tables alone: what is deleted is given back to the disk by and by.
            self._connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
            self._connection.execute("PRAGMA journal_mode = WAL")
            # What has been answered must outlive a power cut: each commit reaches the disk.
            self._connection.execute("PRAGMA synchronous = FULL")
            # After each commit, not after 1000 pages: a copy without the file -wal was one of empty tables.
            self._connection.execute("PRAGMA wal_autocheckpoint = 1")
            self._connection.execute("PRAGMA foreign_keys = ON")
            # Deleted means deleted, also in the free pages of the file.
            self._connection.execute("PRAGMA secure_delete = ON")
            self._connection.create_function("seal", -1, _seal, deterministic=True)
            with self._transaction() as connection:
                if not self._has_tables():
                    for statement in filter(str.strip, TABLES.split(";\n")):
                        connection.execute(statement)
                    connection.execute("INSERT INTO form VALUES (?)", (FORM,))
                (form,) = connection.execute("SELECT number FROM form").fetchone() or (0,)
                while form in UPGRADES:
                    for statement in UPGRADES[form]:
                        connection.execute(statement)
                    form += 1
                    connection.execute("UPDATE form SET number = ?", (form,))
        except (sqlite3.Error, OSError, UnicodeDecodeError) as problem:  # what SQLite says quotes a damaged schema
            message = f"{file} cannot be opened as the service's database: {problem}."
            raise EnvironmentFault(message, "no-database") from problem
        if form != FORM:
            message = f"{file} was made by another version of the service (form {form}; this one reads {FORM})."
            raise InputError(message, "other-database", file, form)

    def _has_tables(self) -> bool:
        return bool(self._connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'form'").fetchone())

    def close(self) -> None:
        """End its use."""
        self._connection.close()

    def check(self) -> None:
        """Raise :class:`EnvironmentFault` for a file that is damaged, or cannot be written."""
        # Not quick_check, which does not compare rows with indices: with one bit of a state or a hash flipped, pages
        # answered 500, and the start removed an FMU.
        (row,) = self._rows("PRAGMA integrity_check(1)")
        if row[0] != "ok":
            raise EnvironmentFault(f"The service's database is damaged: {row[0]}.", "no-database")
        for table, columns in SEALED.items():
            if changed := self._rows(f"SELECT {columns} FROM {table} WHERE seal <> seal({columns}) LIMIT 1"):
                message = f"The service's database is damaged: what it has in {table} of {changed[0][0]} is not what "
                raise EnvironmentFault(f"{message}was written.", "no-database")
        with self._transaction() as connection:
            connection.execute("UPDATE form SET number = number")

    def copy(self, file: Path) -> None:
        """Write all state as it is now to ``file``, while others read and write."""
        try:
            with closing(sqlite3.connect(file)) as other:
                self._connection.backup(other)
        except sqlite3.Error as problem:
            raise EnvironmentFault(f"The copy {file} cannot be written: {problem}.", "not-written") from problem

    def held_protocol(self, stage: Stage) -> tuple[str, str] | None:
        """The name and the contents of the protocol that a stage was done by so far, and must be done by from now on;
        None if it may be another one."""
        held = f"EXISTS (SELECT 1 FROM runs WHERE {HELD[stage]})"
        rows = self._rows(f"SELECT name, contents FROM protocols WHERE stage = ? AND {held}", stage)
        return (str(rows[0][0]), str(rows[0][1])) if rows else None

    def use_protocol(self, stage: Stage, name: str, contents: str) -> None:
        """Keep by which protocol a stage is done from now on."""
        with self._transaction() as connection:
            connection.execute("INSERT OR REPLACE INTO protocols VALUES (?, ?, ?)", (stage, name, contents))

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
            except BaseException:
                self._connection.execute("ROLLBACK")
                raise
            self._connection.execute("COMMIT")
        except sqlite3.IntegrityError:
            raise
        except sqlite3.DatabaseError as problem:  # also of a file that is damaged
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            # The codes of SQLite have been attributes of the exceptions since Python 3.11.
            what = LOCKED if "locked" in str(problem) else FULL if self._is_full(problem) else "no-database"
            raise EnvironmentFault(f"The service's database cannot be written: {problem}.", what) from problem

    def _is_full(self, problem: sqlite3.DatabaseError) -> bool:
        """Whether it is the disk, or a quota of it, that is full. SQLite says so, or "disk I/O error": of a quota, and
        where the file -shm cannot grow."""
        if "disk I/O error" not in str(problem):
            return "disk is full" in str(problem)
        try:
            with tempfile.TemporaryFile(dir=self._file.parent) as probe:
                probe.write(bytes(SHARED))
                probe.flush()
                os.fsync(probe.fileno())
        except OSError as found:
            return found.errno in NO_ROOM
        return False

    def _rows(self, query: str, *values: object) -> list[sqlite3.Row]:
        try:
            return self._connection.execute(query, values).fetchall()
        except sqlite3.DatabaseError as problem:
            raise EnvironmentFault(f"The service's database cannot be read: {problem}.", "no-database") from problem

    # People

    def add_person(self, person: Person, key: str, now: float) -> None:
        """Add somebody, who comes in by what has the hash ``key``."""
        with self._transaction() as connection:
            values = (person.id, person.name, key, now, person.organizer)
            connection.execute("INSERT INTO people (id, name, key, created, organizer) VALUES (?, ?, ?, ?, ?)", values)

    def make_organizer(self, person: str) -> None:
        """Let somebody open and close rounds."""
        with self._transaction() as connection:
            connection.execute("UPDATE people SET organizer = 1 WHERE id = ?", (person,))

    def change_key(self, person: str, key: str) -> None:
        """Give somebody another key; who came in by the old one is out."""
        with self._transaction() as connection:
            connection.execute("UPDATE people SET key = ? WHERE id = ?", (key, person))
            connection.execute("DELETE FROM sessions WHERE person = ?", (person,))

    def person(self, id: str) -> tuple[Person, str] | None:
        """Somebody with the hash of the key."""
        rows = self._rows("SELECT id, name, organizer, key FROM people WHERE id = ?", id)
        return (_person(rows[0]), str(rows[0][3])) if rows else None

    def people(self) -> list[Person]:
        """Everybody, by name."""
        return [_person(row) for row in self._rows("SELECT id, name, organizer FROM people ORDER BY name")]

    def remove_person(self, id: str) -> None:
        """Remove somebody with all sessions, runs and comparisons; in rounds that are closed, the name."""
        with self._transaction() as connection:
            connection.execute("UPDATE entries SET person = '', name = '' WHERE owner = ?", (id,))
            connection.execute(f"{_sealing('entries')} WHERE owner = ?", (id,))
            connection.execute("DELETE FROM people WHERE id = ?", (id,))
        self.give_back(FREED)

    def add_session(self, key: str, person: str, until: float, now: float) -> None:
        """Somebody has come in; sessions that have run out are forgotten, and all but the newest of this person."""
        old = "SELECT rowid FROM sessions WHERE person = ? ORDER BY rowid DESC LIMIT -1 OFFSET ?"
        with self._transaction() as connection:
            connection.execute("DELETE FROM sessions WHERE until < ?", (now,))
            connection.execute("INSERT INTO sessions VALUES (?, ?, ?)", (key, person, until))
            connection.execute(f"DELETE FROM sessions WHERE rowid IN ({old})", (person, MAX_SESSIONS))

    def session(self, key: str, now: float) -> Person | None:
        """Who came in with this session."""
        query = (
            "SELECT p.id, p.name, p.organizer FROM sessions s JOIN people p ON p.id = s.person "
            "WHERE s.key = ? AND s.until > ?"
        )
        rows = self._rows(query, key, now)
        return _person(rows[0]) if rows else None

    def end_session(self, key: str) -> None:
        """Somebody leaves."""
        with self._transaction() as connection:
            connection.execute("DELETE FROM sessions WHERE key = ?", (key,))

    # Runs

    def add_run(self, run: Submission, text: str, binding: str = "") -> None:
        """Add a run with its ``binding``, and the beginning of its history; raises :class:`Changed` if its owner is no
        more."""
        try:
            with self._transaction() as connection:
                connection.execute(f"INSERT INTO runs ({COLUMNS}) VALUES ({MARKS})", _values(run))
                connection.execute(f"{_sealing('runs')} WHERE id = ?", (run.id,))
                connection.execute("INSERT INTO history VALUES (?, ?, ?)", (run.id, run.created, text))
                connection.execute("INSERT INTO bindings VALUES (?, ?)", (run.id, binding))
        except sqlite3.IntegrityError:
            raise Changed(run.id) from None

    def change(
        self, before: Submission, after: Submission, text: str, now: float, binding: str | None = None
    ) -> Submission:
        """Replace a run by its next form, with a line of its history, and another ``binding`` if there is one; returns
        what is stored.

        Raises :class:`Changed` if it is not ``before`` any more: two things happened at a time, and the first counts.
        """
        with self._transaction() as connection:
            _change(connection, before, after, text, now)
            if binding is not None:
                connection.execute("UPDATE bindings SET text = ? WHERE run = ?", (binding, before.id))
        stored = self.run(before.id)
        if stored is None:  # --remove is another process
            raise Changed(before.id)
        return stored

    def run(self, id: str) -> Submission | None:
        """The run with this id."""
        return next(iter(self._runs("WHERE id = ?", id)), None)

    def binding(self, id: str) -> str:
        """The text of a run's mapping file; empty if it has none."""
        return next((str(row[0]) for row in self._rows("SELECT text FROM bindings WHERE run = ?", id)), "")

    def revisions(self, owner: str) -> int:
        """A number that grows with each change of somebody's runs, and falls when one is deleted."""
        return int(self._rows("SELECT COALESCE(SUM(revision + 1), 0) FROM runs WHERE owner = ?", owner)[0][0])

    def runs_of(self, owner: str, most: int = 200) -> list[Submission]:
        """The newest runs of somebody, the newest first."""
        return self._runs("WHERE owner = ? ORDER BY rowid DESC LIMIT ?", owner, most)

    def waiting(self) -> list[Submission]:
        """Runs whose next stage is to begin."""
        return self._runs(f"WHERE state NOT IN ({FINALS}) AND running = 0 ORDER BY rowid")

    def running(self) -> list[Submission]:
        """Runs of which a stage is under way."""
        return self._runs("WHERE running = 1")

    def finished(self) -> list[Submission]:
        """Finished runs, of each person's controllers of one name the latest alone: those that meet all requirements
        first, then by V."""
        # Before the limit: who evaluates one controller 500 times would else push all others out of the table. Then
        # everybody's first, everybody's second and so on, since whoever uploads it gives a controller its name.
        # Not by the state: a run that is verified for a round stays in the table meanwhile.
        order = "remark <> '', holds = 0, cost"
        latest = (
            "SELECT *, ROW_NUMBER() OVER (PARTITION BY owner, name ORDER BY rowid DESC) AS newer "
            "FROM runs WHERE cost IS NOT NULL"
        )
        place = f"ROW_NUMBER() OVER (PARTITION BY owner ORDER BY {order}) AS place"
        best = f"SELECT *, {place} FROM ({latest}) WHERE newer = 1"
        shown = f"SELECT id FROM ({best}) ORDER BY place, {order} LIMIT {MAX_ROWS}"
        return self._runs(f"WHERE id IN ({shown}) ORDER BY {order}")

    def count(self, state: State) -> int:
        """How many runs are in a state. Each open page asks at each news, for which the table takes too long."""
        return int(self._rows("SELECT COUNT(*) FROM runs WHERE state = ?", state.value)[0][0])

    def served(self) -> dict[str, float]:
        """When a stage of each person's was last started, also of a run that is deleted."""
        return {row[0]: row[1] for row in self._rows("SELECT id, served FROM people")}

    def usage(self, owner: str) -> tuple[int, int, int]:
        """How many runs of somebody have not ended, how many there are, and what they take on the disk [bytes],
        bindings as well."""
        taken = f"MAX(disk + size + bound, {LEAST})"
        queued = f"COALESCE(SUM(state NOT IN ({FINALS})), 0)"
        query = f"SELECT {queued}, COUNT(*), COALESCE(SUM({taken}), 0) FROM runs WHERE owner = ?"
        (row,) = self._rows(query, owner)
        return int(row[0]), int(row[1]), int(row[2])

    def is_used(self, sha256: str) -> bool:
        """Whether a run has this FMU."""
        return bool(self._rows("SELECT 1 FROM runs WHERE sha256 = ? LIMIT 1", sha256))

    def counted(self) -> set[str]:
        """SHA-256 of the FMUs of which a run counts what was extracted."""
        return {row[0] for row in self._rows("SELECT DISTINCT sha256 FROM runs WHERE disk > 0")}

    def ids(self) -> set[str]:
        """Ids of all runs and comparisons."""
        return {row[0] for row in self._rows("SELECT id FROM runs UNION SELECT id FROM comparisons")}

    def files(self) -> set[str]:
        """SHA-256 of all FMUs."""
        return {row[0] for row in self._rows("SELECT DISTINCT sha256 FROM runs")}

    def history(self, id: str, most: int = 100) -> list[tuple[float, str]]:
        """What has happened to a run, the latest ``most`` lines, in their order."""
        rows = self._rows("SELECT at, text FROM history WHERE run = ? ORDER BY rowid DESC LIMIT ?", id, most)
        return [(row[0], row[1]) for row in reversed(rows)]

    def remove_run(self, id: str) -> None:
        """Remove a run with its history."""
        with self._transaction() as connection:
            connection.execute("DELETE FROM runs WHERE id = ?", (id,))
        self.give_back(FREED)

    def give_back(self, pages: int = 0) -> None:
        """Give so many ``pages`` of what was deleted back to the disk, 0 for all, and empty the file -wal, in which it
        would stay."""
        with suppress(sqlite3.Error):  # it is deleted all the same
            # As a script: a statement alone gives back one page, since Python asks for rows, and there are none.
            self._connection.executescript(f"PRAGMA incremental_vacuum({pages})")
        with suppress(EnvironmentFault):
            self._rows("PRAGMA wal_checkpoint(TRUNCATE)")

    def keep_only(self, ids: set[str]) -> None:
        """Remove the runs that are not among ``ids``: they have been deleted."""
        with self._transaction() as connection:
            gone = [row for row in connection.execute("SELECT id FROM runs").fetchall() if row[0] not in ids]
            connection.executemany("DELETE FROM runs WHERE id = ?", gone)

    def _runs(self, condition: str, *values: object) -> list[Submission]:
        return [_run(row) for row in self._rows(f"SELECT {COLUMNS} FROM runs {condition}", *values)]

    # Comparisons

    def add_comparison(self, id: str, owner: str, runs: Iterable[str], now: float) -> list[str]:
        """Keep which runs somebody compares; returns the ids of the oldest ones, which are no more."""
        old = "SELECT id FROM comparisons WHERE owner = ? ORDER BY created DESC, rowid DESC LIMIT -1 OFFSET ?"
        with self._transaction() as connection:
            connection.execute("INSERT INTO comparisons VALUES (?, ?, ?, ?)", (id, owner, " ".join(runs), now))
            ended = [row[0] for row in connection.execute(old, (owner, MAX_COMPARISONS)).fetchall()]
            connection.executemany("DELETE FROM comparisons WHERE id = ?", [(each,) for each in ended])
        return ended

    def comparison(self, id: str) -> tuple[str, tuple[str, ...]] | None:
        """The owner of a comparison, and its runs."""
        rows = self._rows("SELECT owner, runs FROM comparisons WHERE id = ?", id)
        return (str(rows[0][0]), tuple(str(rows[0][1]).split())) if rows else None

    def comparisons_with(self, run: str) -> list[str]:
        """Ids of the comparisons that a run is part of."""
        rows = self._rows("SELECT id FROM comparisons WHERE ' ' || runs || ' ' LIKE ?", f"% {run} %")
        return [row[0] for row in rows]

    def remove_comparison(self, id: str) -> None:
        """Remove a comparison."""
        with self._transaction() as connection:
            connection.execute("DELETE FROM comparisons WHERE id = ?", (id,))

    # Rounds

    def add_round(self, round: Round) -> None:
        """Open a round; raises :class:`Changed` if another one is open."""
        with self._transaction() as connection:
            if connection.execute("SELECT 1 FROM rounds WHERE closed IS NULL").fetchone():
                raise Changed(round.id)
            connection.execute(f"INSERT INTO rounds ({ROUND}) VALUES (?, ?, ?, ?, ?, ?)", astuple(round))
            connection.execute(f"{_sealing('rounds')} WHERE id = ?", (round.id,))

    def round(self, id: str) -> Round | None:
        """The round with this id."""
        return next((Round(*row) for row in self._rows(f"SELECT {ROUND} FROM rounds WHERE id = ?", id)), None)

    def rounds(self) -> list[Round]:
        """All rounds, the newest first."""
        return [Round(*row) for row in self._rows(f"SELECT {ROUND} FROM rounds ORDER BY opened DESC, rowid DESC")]

    def choose(self, round: str, entry: HandIn) -> None:
        """Have a run count for its owner in a ``round`` that is open; raises :class:`Changed` if it is not."""
        with self._transaction() as connection:
            if not connection.execute("SELECT 1 FROM rounds WHERE id = ? AND closed IS NULL", (round,)).fetchone():
                raise Changed(round)
            _add_entries(connection, round, [entry])

    def entries(self, round: str) -> list[HandIn]:
        """What was chosen in a ``round``; from its close on, all that counts."""
        rows = self._rows("SELECT owner, run, person, name FROM entries WHERE round = ? ORDER BY owner", round)
        return [HandIn(*row) for row in rows]

    def handed_in(self, round: Round, owner: str, most: int = 200) -> list[Submission]:
        """The newest finished runs of somebody that were handed in while a round was open, and count in no other one.
        The newest is the first, but for one that was chosen."""
        order = "ORDER BY id IN (SELECT run FROM entries WHERE round = ?) DESC, rowid DESC LIMIT ?"
        values = round.opened, round.closes, owner, round.id, most
        return self._runs(f"WHERE {HANDED_IN} AND owner = ? {order}", *values)

    def is_handed_in(self, round: Round, id: str) -> bool:
        """Whether a run is one of them."""
        return bool(self._rows(f"SELECT 1 FROM runs WHERE {HANDED_IN} AND id = ?", round.opened, round.closes, id))

    def may_count(self, round: Round) -> list[Submission]:
        """Of all of them, those that were chosen and everybody's newest one, the oldest first."""
        # By SQL: with 6,000 runs a look at a round took 0.8 s, for which everybody waited.
        newest = f"SELECT MAX(rowid) FROM runs WHERE {HANDED_IN} GROUP BY owner"
        chosen = f"SELECT rowid FROM runs WHERE {HANDED_IN} AND id IN (SELECT run FROM entries WHERE round = ?)"
        values = round.opened, round.closes, round.opened, round.closes, round.id
        return self._runs(f"WHERE rowid IN ({newest} UNION {chosen}) ORDER BY rowid", *values)

    def latest(self) -> float:
        """When the latest run was handed in; 0 if there is none."""
        return float(self._rows("SELECT COALESCE(MAX(created), 0.0) FROM runs")[0][0])

    def in_round(self, round: str) -> list[Submission]:
        """The runs that count in a ``round`` that is closed."""
        return self._runs("WHERE round = ?", round)

    def close_round(
        self, round: Round, entries: Sequence[HandIn], runs: Iterable[tuple[Submission, Submission, str]]
    ) -> None:
        """Close a round: keep its bits and what counts, and change these ``runs``, all of it or nothing.

        Raises :class:`Changed` if it is closed already, or one of the runs is another by now.
        """
        assert round.closed is not None and round.bits
        query = "UPDATE rounds SET closed = ?, bits = ? WHERE id = ? AND closed IS NULL"
        with self._transaction() as connection:
            if connection.execute(query, (round.closed, round.bits, round.id)).rowcount != 1:
                raise Changed(round.id)
            connection.execute("DELETE FROM entries WHERE round = ?", (round.id,))
            connection.execute(f"{_sealing('rounds')} WHERE id = ?", (round.id,))
            _add_entries(connection, round.id, entries)
            for before, after, text in runs:
                _change(connection, before, after, text, round.closed)


def _change(connection: sqlite3.Connection, before: Submission, after: Submission, text: str, now: float) -> None:
    """See :meth:`Database.change`, within a transaction."""
    columns = ", ".join(f"{field.name} = ?" for field in fields(Submission) if field.name != "revision")
    values = [
        value for field, value in zip(fields(Submission), _values(after), strict=True) if field.name != "revision"
    ]
    changed = connection.execute(
        f"UPDATE runs SET {columns}, revision = revision + 1 WHERE id = ? AND revision = ?",
        (*values, before.id, before.revision),
    )
    if changed.rowcount != 1:
        raise Changed(before.id)
    connection.execute(f"{_sealing('runs')} WHERE id = ?", (before.id,))
    if after.started != before.started:
        # With the person: who deleted each run as soon as it had finished was served before all others.
        connection.execute("UPDATE people SET served = ? WHERE id = ?", (after.started, before.owner))
    connection.execute("INSERT INTO history VALUES (?, ?, ?)", (before.id, now, text))
    last = "SELECT rowid FROM history WHERE run = ? ORDER BY rowid DESC LIMIT 1 OFFSET ?"
    connection.execute(f"DELETE FROM history WHERE run = ? AND rowid <= ({last})", (before.id, before.id, MAX_HISTORY))


def _add_entries(connection: sqlite3.Connection, round: str, entries: Sequence[HandIn]) -> None:
    """Have what counts in a ``round``, in the place of what counted for the same people, within a transaction."""
    rows = [(round, *astuple(entry)) for entry in entries]
    connection.executemany(f"INSERT OR REPLACE INTO entries ({ENTRY}) VALUES (?, ?, ?, ?, ?)", rows)
    whose = [(round, entry.owner) for entry in entries]  # not all: a damaged one would be taken for whole
    connection.executemany(f"{_sealing('entries')} WHERE round = ? AND owner = ?", whose)


def _seal(*values: object) -> int:
    """A checksum of what a row holds, the same with every version of Python: ``repr`` spells a letter of a newer
    Unicode otherwise, and after an upgrade of the system one in an FMU's name had the database called damaged."""
    return zlib.crc32(ascii(values).encode())


def _person(row: sqlite3.Row | tuple[object, ...]) -> Person:
    return Person(str(row[0]), str(row[1]), bool(row[2]))


def _values(run: Submission) -> tuple[object, ...]:
    return tuple(value.value if isinstance(value, State) else value for value in astuple(run))


def _run(row: tuple[object, ...] | sqlite3.Row) -> Submission:
    named = dict(zip((field.name for field in fields(Submission)), row, strict=True))
    verdicts = {name: None if named[name] is None else bool(named[name]) for name in ("holds", "drawn_holds")}
    return Submission(**{**named, **verdicts, "state": State(named["state"]), "running": bool(named["running"])})
