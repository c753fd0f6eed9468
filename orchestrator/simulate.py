"""``python -m orchestrator.simulate``: see :mod:`orchestrator.cli.simulate`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("simulate"))
