"""FMUs as slaves of the master loop, one class per standard and kind."""

from __future__ import annotations

from ..archive import Archive
from ..library import WINE
from ..trace import NOBODY
from .base import Slave
from .co_simulation import Fmi1CoSimulation, Fmi2CoSimulation, Fmi3CoSimulation
from .hosted import hosted
from .model_exchange import Fmi2ModelExchange, Fmi3ModelExchange
from .numba_slave import NumbaSlave, compiled_twin_of

__all__ = ["Slave", "load"]

CLASSES: dict[tuple[str, str], type[Slave]] = {
    ("1", "CoSimulation"): Fmi1CoSimulation,
    ("2", "CoSimulation"): Fmi2CoSimulation,
    ("3", "CoSimulation"): Fmi3CoSimulation,
    ("2", "ModelExchange"): Fmi2ModelExchange,
    ("3", "ModelExchange"): Fmi3ModelExchange,
}
"""By major FMI version and kind; an archive of any other combination is refused when it is opened."""


def load(archive: Archive, side: int = NOBODY) -> Slave:
    """Load the library of an opened FMU; ``side`` (PLANT, CONTROLLER) is noted in the process's trace."""
    if archive.library == WINE:
        return hosted(CLASSES[archive.major_version, archive.kind])(archive, side)
    twin = compiled_twin_of(archive)
    if twin is not None:
        return NumbaSlave(archive, side, twin)
    return CLASSES[archive.major_version, archive.kind](archive, side)
