"""Python FMUs in one process share one interpreter; this keeps the modules of each to itself.

pythonfmu puts an FMU's resources at the head of ``sys.path`` and imports from there. A second FMU with a module of the
same name would silently run the first one's code. Here what an FMU imported from its own folder leaves ``sys.modules``
when another FMU is instantiated, and comes back when it is its turn again, so nothing is imported twice.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType


class PrivateModules:
    """The modules that one FMU imported from below ``folder``."""

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._modules: dict[str, ModuleType] = {}

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Within, the FMU sees its own modules and folder; after it, nobody sees them."""
        path = list(sys.path)
        covered = {name: sys.modules[name] for name in self._modules if name in sys.modules}
        sys.modules.update(self._modules)
        before = set(sys.modules)
        try:
            yield
        finally:
            imported = {name: sys.modules[name] for name in sys.modules.keys() - before}
            self._modules.update({name: module for name, module in imported.items() if self._owns(module)})
            for name in self._modules:
                sys.modules.pop(name, None)
            sys.modules.update(covered)
            sys.path[:] = path

    def _owns(self, module: ModuleType) -> bool:
        return str(getattr(module, "__file__", None) or "").startswith(self._folder)
