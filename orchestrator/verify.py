"""``python -m orchestrator.verify``: see :mod:`orchestrator.cli.verify`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("verify"))
