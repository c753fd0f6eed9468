"""``python -m orchestrator.playground``: see :mod:`orchestrator.cli.playground`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("playground"))
