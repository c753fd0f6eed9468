"""The command ``serve``: a service for groups, and who may use it."""

from __future__ import annotations

import argparse
import errno
import os
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

from ..benchmark import protocol
from ..documents.files import prepare_folder
from ..errors import InputError
from ..service import accounts
from ..service.database import Database
from ..service.files import Files, make_private
from ..service.records import Allowance, Conduct, Settings
from .guard import EXIT_OK
from .values import MAX_LIMIT, Parser, natural, number

# Imports inside functions: the sandbox is tried, and the packages of the extra are loaded, when a service begins.

EXAMPLES = """examples:
  flexible-manipulator serve                          # for oneself: open http://127.0.0.1:8080
  flexible-manipulator serve --data /srv/benchmark --invite "Ada"
                                                      # a link for Ada, who may then come in
  flexible-manipulator serve --data /srv/benchmark --accounts --host 0.0.0.0
                                                      # for a group, on all addresses of this machine
  flexible-manipulator serve --data /srv/benchmark --organizer "Ada"
                                                      # Ada may open and close rounds
  flexible-manipulator serve --data /srv/benchmark --people
  flexible-manipulator serve --data /srv/benchmark --remove "Ada"
  flexible-manipulator serve --data /srv/benchmark --backup /backup/monday
                                                      # a copy, from which serve --data goes on

exit codes: 0 ended by Ctrl-C, or done; 1 the machine fails, 2 bad input, 3 the folder was taken or locked at the last
moment, 130 interrupted while it starts"""

MB = 1e6

OPEN_FILES = 65536
"""Files that the service may have open at a time, where the system lets it: 450 connections take up to 900."""

PACKAGES = ("starlette", "uvicorn")
"""What the extra installs."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    if given.backup is not None:
        return _copy(given)
    if given.invite is not None or given.organizer is not None or given.remove is not None or given.people:
        return _manage(given)
    missing = [name for name in PACKAGES if find_spec(name) is None]
    if missing:
        message = f"The service needs {', '.join(missing)}: pip install 'flexible-manipulator-benchmark[service]'"
        raise InputError(message, "no-service")
    if not accounts.is_loopback(given.host) and not given.accounts:
        message = f"{given.host} can be reached by others, who could evaluate, read and delete what they like."
        raise InputError(message, "no-accounts", given.host)
    protocol.load(given.protocol)
    protocol.load(given.draws_protocol)
    protected, warning = fenced(given.trust, given.accounts)
    conduct = Conduct(
        protocol=_place(given.protocol),
        drawn_protocol=_place(given.draws_protocol),
        processes=given.jobs,
        sandbox=protected,
        scheduler=given.scheduler or "",
        evaluations=given.evaluations,
    )
    limits = Allowance(queue=given.max_queue, disk=int(given.max_disk * MB), upload=int(given.max_upload * MB))
    return _serve(given, Settings(given.accounts, warning, limits, conduct))


def _parser() -> Parser:
    parser = Parser("serve", "Serve pages on which FMUs are evaluated and compared.", EXAMPLES)
    parser.add_argument(
        "--data",
        type=Path,
        default=Path("service"),
        metavar="FOLDER",
        help="where everything is kept (default: service)",
    )
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="where to listen (default: 127.0.0.1)")
    parser.add_argument("--port", type=natural(0, 65535), default=8080, metavar="N", help="the port (default: 8080)")
    parser.add_argument("--accounts", action="store_true", help="only who was invited may come in")
    people = parser.add_argument_group("people and backup, while the service runs or not")
    chosen = people.add_mutually_exclusive_group()
    chosen.add_argument("--backup", type=Path, metavar="FOLDER", help="copy everything to a new folder")
    chosen.add_argument("--invite", metavar="NAME", help="print a link by which somebody comes in; an older one ends")
    chosen.add_argument("--organizer", metavar="NAME", help="let somebody who was invited open and close rounds")
    chosen.add_argument("--remove", metavar="NAME", help="remove somebody with all runs")
    chosen.add_argument("--people", action="store_true", help="list who was invited")
    people.add_argument(
        "--url", type=_url, metavar="URL", help="the service's address in links (default: of --host and --port)"
    )
    work = parser.add_argument_group("work")
    work.add_argument(
        "--protocol",
        default="paper",
        metavar="NAME",
        help=f"what is evaluated: one of {', '.join(protocol.names())}; or a protocol file (.toml) (default: paper)",
    )
    work.add_argument(
        "--draws-protocol",
        default="verification",
        metavar="NAME",
        help="what is run once for each draw of a round; with another one than the default, verifications leave out "
        "the worst poses and the references, and are none of the standard conditions (default: verification)",
    )
    work.add_argument("--evaluations", type=natural(1, 64), default=1, metavar="N", help="at a time (default: 1)")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    work.add_argument(
        "--jobs", type=natural(1), default=cores, metavar="N", help="processes of one (default: all cores)"
    )
    work.add_argument("--scheduler", metavar="ADDRESS", help="evaluate on a Dask cluster, such as tcp://host:8786")
    work.add_argument("--trust", action="store_true", help="run FMUs without a sandbox, with your permissions")
    limits = parser.add_argument_group("limits, for each person")
    for name, default, what in (
        ("upload", Allowance.upload / MB, "size of an FMU"),
        ("disk", Allowance.disk / MB, "of all runs and their FMUs"),
    ):
        size = number(most=MAX_LIMIT, above=0.0)
        limits.add_argument(
            f"--max-{name}", type=size, default=default, metavar="MB", help=f"{what} (default: {default:g})"
        )
    limits.add_argument(
        "--max-queue",
        type=natural(1),
        default=Allowance.queue,
        metavar="N",
        help=f"runs that have not ended (default: {Allowance.queue})",
    )
    return parser


def _url(text: str) -> str:
    """The address of a service in links. A link that begins with a mere name leads nowhere."""
    try:
        parts = urlsplit(text)
        is_one = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:  # of its port, or of brackets
        is_one = False
    if not is_one or parts.path.strip("/") or parts.query or " " in parts.netloc:
        raise argparse.ArgumentTypeError(f"{text} is no address such as https://bench.example.org")
    return f"{parts.scheme}://{parts.netloc}"


def _place(name: str) -> str:
    """A protocol as jobs find it, which run in other folders."""
    return name if name in protocol.names() else str(Path(name).absolute())


def fenced(trust: bool, several: bool) -> tuple[bool, str]:
    """Whether jobs run in a sandbox, and what is warned of if not.

    Raises :class:`InputError` for a service of several people on a machine without one.
    """
    if trust:
        return False, "FMUs run without a sandbox here: an FMU can do whatever the service can." if several else ""
    from ..execution.sandbox_probe import leaks

    try:
        leaking = leaks()
    except InputError as problem:
        if several:
            raise InputError(f"FMUs of several people need a sandbox. {problem}", "no-fence") from None
        return False, "FMUs run without a sandbox here, with your permissions: take only those that you trust."
    if leaking:
        raise InputError(f"The sandbox of this machine allows what it must not: {', '.join(leaking)}.", "no-fence")
    return True, ""


def _serve(given: argparse.Namespace, settings: Settings) -> int:
    from ..service.app import application, check_folder
    from ..service.server import Server

    check_folder(given.data, settings.conduct)
    _have_open_files()
    family = socket.AF_INET6 if ":" in given.host else socket.AF_INET
    try:
        listening = socket.create_server((given.host, given.port), family=family, backlog=512)
    except (OSError, TypeError) as problem:  # the latter of a name that none can have
        message = f"{given.host}:{given.port} cannot be listened on: {getattr(problem, 'strerror', None) or problem}."
        is_port = isinstance(problem, OSError) and problem.errno in (errno.EADDRINUSE, errno.EACCES)
        raise InputError(message, "no-port" if is_port else "no-host", given.port) from None
    # asyncio does so for sockets of its own making alone: the second answer on a connection came 40 ms late.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    print(f"{_address(given.host, listening.getsockname()[1])} (Ctrl-C ends it)", flush=True)
    if settings.warning:
        print(settings.warning, file=sys.stderr)
    try:
        Server(application(given.data, settings)).run(sockets=[listening])
    except KeyboardInterrupt:  # how a service ends
        pass
    finally:
        listening.close()
    return EXIT_OK


def _have_open_files() -> None:
    """Let this process open as many files as the system lets it: a connection may take two."""
    with suppress(ImportError, ValueError, OSError):  # Windows has no such limit
        import resource

        most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        wanted = OPEN_FILES if most == resource.RLIM_INFINITY else min(OPEN_FILES, most)
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))


def _address(host: str, port: int) -> str:
    shown = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(host, host)
    return f"http://[{shown}]:{port}" if ":" in shown else f"http://{shown}:{port}"


def _copy(given: argparse.Namespace) -> int:
    """Copy what a service keeps; one that runs in the folder goes on."""
    files = Files(given.data.absolute())
    if not os.access(files.database, os.R_OK | os.W_OK):
        raise InputError(
            f"{given.data} is not the folder of a service: it has no {files.database.name} that you may read and "
            "write, as SQLite does to copy it.",
            "no-folder",
        )
    if given.backup.resolve().is_relative_to(given.data.resolve()):
        message = f"{given.backup} is within {given.data}: a copy there is lost with what it is a copy of."
        raise InputError(message, "not-apart", given.backup)
    prepare_folder(given.backup)
    if any(given.backup.iterdir()):
        message = f"{given.backup} is not empty. Each copy has a folder of its own."
        raise InputError(message, "not-empty", given.backup)
    make_private(given.backup)
    target = Files(given.backup)
    part = target.database.with_suffix(".part")
    database = Database(files.database, may_begin=False)
    try:
        # The rows first: each of them has its files then, but for what is deleted in between.
        database.copy(part)
        files.copy(given.backup)
        there = database.ids()
    finally:
        database.close()
    copied = Database(part, may_begin=False)
    try:
        copied.check()
        copied.keep_only(there)  # not by what files there are: a run whose FMU is gone has its place in a round
    finally:
        copied.close()
    part.replace(target.database)  # last of all: what has ended before that is no service
    return EXIT_OK


def _manage(given: argparse.Namespace) -> int:
    """Invite, remove or list people; a service that runs in the folder finds them at once."""
    files = Files(given.data.absolute())
    files.check_own()
    if given.invite is None and not files.database.exists():  # a slip in --data would look like an empty service
        raise InputError(f"{given.data} is not the folder of a service: nobody was invited there.", "no-folder")
    # No folder is made beside: as root, it would be one in which the service may not write.
    (files.check_writable if given.invite is None else files.prepare)()
    database = Database(files.database, may_begin=given.invite is not None)
    try:
        if given.invite is not None:
            key = accounts.invited(database, given.invite)
            # Behind the #, which browsers do not send: no log of a server on the way has it.
            print(f"{given.url or _address(given.host, given.port)}/join#{key}")
        elif given.organizer is not None:
            accounts.made_organizer(database, given.organizer)
        elif given.remove is not None:
            accounts.removed(database, given.remove)
        else:
            names = [
                f"{person.name} (organizer)" if person.organizer else person.name
                for person in database.people()
                if person.id != accounts.LOCAL.id
            ]
            print("\n".join(names) or "nobody was invited")
    finally:
        database.close()
    return EXIT_OK
