"""``python -m orchestrator.evaluate``: see :mod:`orchestrator.cli.evaluate`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("evaluate"))
