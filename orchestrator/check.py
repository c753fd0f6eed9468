"""``python -m orchestrator.check``: see :mod:`orchestrator.cli.checks`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("check"))
