"""``python -m orchestrator``: see :mod:`orchestrator.cli.main`."""

from .cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
