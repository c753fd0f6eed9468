"""Python FMUs in one process share one interpreter; this keeps the modules of each to itself.

pythonfmu puts an FMU's resources at the head of ``sys.path`` and imports from there. A second FMU with a module of the
same name would silently run the first one's code. Here what an FMU imported from its own folder, and its folders on the
path, are gone when another FMU has its turn, and come back when it is its own again, so nothing is imported twice.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import ClassVar


class PrivateModules:
    """The modules that one FMU imported from below ``folder``."""

    _turns: ClassVar[list[PrivateModules]] = []
    """Whose turn it is, the last one's; those before it go on when it ends."""

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._has_resources = folder.is_dir()
        self._modules: dict[str, ModuleType] = {}
        self._covered: dict[str, ModuleType] = {}
        self._path: list[str] = []
        self._foreign: dict[str, ModuleType] = {}
        """Modules looked at before: there are hundreds, and this is done several times a simulation."""

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Within, the FMU sees its own modules and folder; after it, nobody sees them.

        An FMU without resources has none.
        """
        if not self._has_resources:
            yield
            return
        if self._turns:
            self._turns[-1]._withdraw()
        self._turns.append(self)
        self._step_in()
        try:
            yield
        finally:
            self._withdraw()
            self._turns.pop()
            if self._turns:
                self._turns[-1]._step_in()

    def _step_in(self) -> None:
        self._covered = {name: sys.modules[name] for name in self._modules if name in sys.modules}
        sys.modules.update(self._modules)
        sys.path[:0] = self._path

    def _withdraw(self) -> None:
        unknown = {name: module for name, module in sys.modules.items() if self._foreign.get(name) is not module}
        imported = {name: module for name, module in unknown.items() if self._owns(getattr(module, "__file__", None))}
        self._modules.update(imported)
        for name in imported:
            del sys.modules[name], unknown[name]
        self._foreign.update(unknown)
        sys.modules.update(self._covered)
        self._path = list(dict.fromkeys(entry for entry in sys.path if self._owns(entry)))
        sys.path[:] = [entry for entry in sys.path if not self._owns(entry)]

    def _owns(self, path: str | None) -> bool:
        return str(path or "").startswith(self._folder)
