"""``python -m orchestrator.completion``: see :mod:`orchestrator.cli.main`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("completion"))
