"""``python -m orchestrator.serve``: see :mod:`orchestrator.cli.serve`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("serve"))
