"""``python -m orchestrator.linearize``: see :mod:`orchestrator.cli.linearize`."""

from .cli.guard import run

if __name__ == "__main__":
    raise SystemExit(run("linearize"))
