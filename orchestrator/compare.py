"""``python -m orchestrator.compare``: see :mod:`orchestrator.cli.finished`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("compare"))
