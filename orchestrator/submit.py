"""``python -m orchestrator.submit``: see :mod:`orchestrator.cli.submit`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("submit"))
