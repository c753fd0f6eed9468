"""``python -m orchestrator.new``: see :mod:`orchestrator.cli.controllers`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("new"))
