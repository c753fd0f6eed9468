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
        self._foreign: dict[str, ModuleType] = {}
        """Modules looked at before: there are hundreds, and this is done several times a simulation."""

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Within, the FMU sees its own modules and folder; after it, nobody sees them."""
        path = list(sys.path)
        covered = {name: sys.modules[name] for name in self._modules if name in sys.modules}
        sys.modules.update(self._modules)
        try:
            yield
        finally:
            unknown = {name: module for name, module in sys.modules.items() if self._foreign.get(name) is not module}
            own = {name: module for name, module in unknown.items() if self._owns(module)}
            self._modules.update(own)
            for name in own:
                del sys.modules[name], unknown[name]
            self._foreign.update(unknown)
            sys.modules.update(covered)
            sys.path[:] = path

    def _owns(self, module: ModuleType) -> bool:
        return str(getattr(module, "__file__", None) or "").startswith(self._folder)
