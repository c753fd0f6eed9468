"""``python -m orchestrator.completion``: see :mod:`orchestrator.cli.completion`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("completion"))
