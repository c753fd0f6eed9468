"""From an error to a message with a remedy, and to an exit code."""

from __future__ import annotations

import errno
import gc
import io
import logging
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module

from ..errors import BenchmarkError, Crash, FmuError, InputError
from ..text import printable

# Imports inside functions: the command's own, in which a Ctrl-C is no traceback either.

EXIT_OK, EXIT_INCOMPLETE, EXIT_BAD_INPUT, EXIT_NOT_JUDGED, EXIT_INTERRUPTED = 0, 1, 2, 3, 130

EXIT_NOT_STANDARD = 4
"""Of ``verify --repeat``: the results are equal, the conditions not the standard ones."""

EXIT_CODES = """exit codes: 0 all cases ended with done or unstable, 1 some ended with crashed, timeout or error, or
the run could not go on (a full disk, a lost cluster), 2 bad input, 3 not judged: a case was lost to
something else than the controller, or a requirement has no verdict since cases were skipped, 130
interrupted"""

REMEDIES = {
    "connector-missing": "Rename it, or map it: --map {value}[1]=NAME --map {value}[2]=NAME.",
    "connector-half": "Rename the other one, or map both: --map {value}[1]=NAME --map {value}[2]=NAME.",
    "connector-ambiguous": "Say which, such as --map {value}={nearest[0]}.",
    "connector-parameter": "Leave {value} out of --set and of parameter files.",
    "undriven-input": "Give it a constant (--set {value}=VALUE), or connect it (such as --map q_m_ref[1]={value}).",
    "undriven-switch": "Set it (--set {value}=VALUE): a controller that is switched off is judged as it is.",
    "newer-system": "Compile them here: --library source.",
    "other-sample-time": "Or have it step as the benchmark does: --sample-time {value}.",
    "fixed-step": "Change --sample-time, or leave it out.",
    "bad-sample-time": "Export it with another one, or overrule it: --sample-time 0.00025.",
    "ambiguous-sample-time": "Set one yourself, such as --set {nearest[0]}=0.00025, or rename it to {value}.",
    "folder-not-writable": "Choose another folder with --output-dir (serve: --data, --backup).",
    "folder-in-use": "Wait for it, or choose another folder with --output-dir.",
    "no-sandbox": "Install bubblewrap, or leave out --sandbox.",
    "no-dask": "It is needed for --scheduler only.",
    "no-case": "List them with: flexible-manipulator evaluate --list.",
    "no-plant-parameter": "Correct --plant-set.",
    "bad-plant-parameter": "Correct --plant-set.",
    "left-files": "--sandbox keeps it from that.",
    "state-passes": "Do the same again: what is stored is not used, and each simulation has a process of its own.",
    "small-budget": "Give a larger one (--budget, or --robust of tune), or --no-list.",
    "no-optuna": "It is needed for tuning only.",
    "no-pyarrow": "It is needed for --parquet only.",
    "no-sample": "Draw one first, without --more.",
    "no-run": "Give the folder of a run, such as runs/DiagonalPID-paper.",
    "unstable-system": "Or take it as it is: --unstable.",
    "service-in-use": "Wait for it, or choose another folder with --data.",
    "not-apart": "Choose another folder with --backup.",
    "other-protocol": "Go on with that one (--protocol), or choose an empty folder with --data.",
    "other-draws-protocol": "Go on with that one (--draws-protocol) until an organizer has had verified again, or its "
    "owner has deleted, what is left of the round; or choose an empty folder with --data.",
    "not-ascii": "Choose another folder with --data.",
    "other-database": "Choose another folder with --data, or go on with the version that made this one.",
    "no-accounts": "Give --accounts, too, and invite people with --invite.",
    "no-fence": "Install bubblewrap, or give --trust if you trust all of them.",
    "no-port": "Choose another one with --port.",
    "no-host": "Give the name or an address of this machine with --host.",
    "no-person": "List who was invited with --people.",
    "no-key": "Put your key into the environment variable BENCHMARK_KEY.",
    "standstill": "--timeout shortens this.",
    "stored": "--force runs them again, --keep-going those that failed.",
    "replaced": "--output-dir keeps both.",
}
"""What to do about a problem, by its stable code; formatted with the fields of the error."""


GARBAGE_THRESHOLD = 50_000
"""New objects between two looks for garbage. Importing makes many objects that stay: with Python's 700 a tenth of the
start is spent looking for garbage among them."""


def guarded(command: Callable[[Sequence[str] | None], int], arguments: Sequence[str] | None = None) -> int:
    """Run a command; an error of the library becomes one message and an exit code.

    An :class:`FmuError`, the refusal of a call by an FMU, arrives here only if it occurs before the first sample. It
    counts as bad input.
    """
    handler = _Notes()
    logger = logging.getLogger("orchestrator")
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    # A name in a list ended a command on a terminal of ASCII. What is drawn has look-alikes: views/terminal.py.
    if isinstance(sys.stdout, io.TextIOWrapper):  # a notebook's stream is none, and takes every character
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = command(arguments)
        if sys.stdout is not None:  # it is None where it was closed before the start
            sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader has read enough, as in a pipe to head
        # Python flushes standard output once more at its end, and would print a traceback there.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print("the program that reads standard output has ended; nothing more is printed", file=sys.stderr)
        return EXIT_INCOMPLETE
    except BenchmarkError as error:
        print(f"error: {printable(' '.join(filter(None, (str(error), remedy(error)))))}", file=sys.stderr)
        # Somebody else ended the process, such as a machine out of memory: nothing is said about the controller.
        if isinstance(error, Crash) and error.what == "killed":
            return EXIT_NOT_JUDGED
        return EXIT_BAD_INPUT if isinstance(error, InputError | FmuError) else EXIT_INCOMPLETE
    except OSError as problem:  # any word may be looked for as a file, and pathlib raises for those that are none
        if problem.errno == errno.ENOSPC:
            print(f"error: {problem.strerror}.", file=sys.stderr)
            # As above: what is left in the buffer would raise once more.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return EXIT_INCOMPLETE
        if problem.errno != errno.ENAMETOOLONG:
            raise
        print(f"error: {printable(str(problem.filename)[:60])}... is too long for the name of a file.", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def remedy(problem: object) -> str:
    """The remedy for an error, finding or log record with the code ``what``; empty if there is none."""
    fields = {"value": getattr(problem, "value", ""), "nearest": getattr(problem, "nearest", ())}
    return REMEDIES.get(getattr(problem, "what", ""), "").format(**fields)


class _Notes(logging.Handler):
    """Notes of the library, printed on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        prefix = "warning: " if record.levelno > logging.INFO and not hasattr(record, "what") else ""
        message = printable(record.getMessage())
        advice = remedy(record).rstrip(".")
        # Its reader may have ended, or its disk be full: the service's queue stood still for good.
        with suppress(OSError, ValueError):
            print(f"{prefix}{message}" + (f" ({advice})" if advice else ""), file=sys.stderr)


HOMES = {
    **dict.fromkeys(("robustness", "reliability", "tune", "sweep"), "studies"),
    **dict.fromkeys(("report", "compare", "runs"), "finished"),
    **dict.fromkeys(("new", "build"), "controllers"),
    **dict.fromkeys(("check", "selftest"), "checks"),
    "completion": "main",
}
"""Modules of the commands without one of their own, in which they are functions."""


SIMULATING = {"evaluate", "check", "simulate", "robustness", "reliability", "sweep"}
"""Commands that start processes for simulations."""


def run(name: str, arguments: Sequence[str] | None = None) -> int:
    """Run a command, guarded: what the console command and ``python -m`` call."""
    gc.set_threshold(GARBAGE_THRESHOLD)
    return guarded(partial(_imported, name), arguments)


def _imported(name: str, arguments: Sequence[str] | None) -> int:
    """Import a command and run it. A Ctrl-C meanwhile, which takes some time, leads to no traceback either."""
    words = sys.argv[1:] if arguments is None else arguments
    if name in SIMULATING and "--sandbox" not in words and any(map(os.path.isfile, words)):
        from ..execution.launch import start_ahead

        start_ahead("orchestrator.pairing.work")
    room = import_module(f".{HOMES.get(name, name)}", __package__)
    # A verification starts itself anew, in an interpreter that no earlier run can have prepared.
    command = getattr(room, name if name in HOMES else "clean", None) or room.main
    return int(command(arguments))
