"""``python -m orchestrator.runs``: see :mod:`orchestrator.cli.runs`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("runs"))
