"""``python -m orchestrator.tune``: see :mod:`orchestrator.cli.studies`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("tune"))
