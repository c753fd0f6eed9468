"""Names of an FMU's library that libraries of this process have, too.

On Linux a library of position-independent code finds its own functions and data by name, first among those of the
program: of Python, the C library and the mathematical library. A law that calls its function ``y0`` got the Bessel
function of that name (V 98.1 where the law's score is 77.6, without a word), and one with a variable ``error`` wrote
into the code of the C library.
"""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

HEAD = b"\x7fELF\x02\x01"
"""Of an ELF file of 64 bits, the lowest byte first: those of other kinds are not loaded on Linux, or not looked at."""

DYNAMIC_SYMBOLS = 11
"""Type of the section with the names that a library shows."""

GLOBAL, DATA, FUNCTION = 1, 1, 2
"""Binding and types of a symbol."""

DEEP = getattr(os, "RTLD_DEEPBIND", 0)
"""Mode of the loader in which a library's own names come first; 0 where there is none."""


def shadowed(library: Path) -> list[str]:
    """Names of functions and data that ``library`` defines and that this process has already; none of what is no ELF
    file of 64 bits."""
    there = ctypes.CDLL(None)
    with suppress(OSError, struct.error, IndexError):
        names = _defined(library.read_bytes())
        # What begins with an underscore is the compiler's own, and that of C++ is meant to be one for all.
        return sorted({name for name in names if not name.startswith(("_", "fmi")) and hasattr(there, name)})
    return []


def _defined(file: bytes) -> Iterator[str]:
    if not file.startswith(HEAD):
        return
    (table,) = struct.unpack_from("<Q", file, 0x28)
    size, count = struct.unpack_from("<HH", file, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", file, table + number * size) for number in range(count)]
    for _, kind, _, _, begin, length, link, _, _, _ in sections:
        if kind == DYNAMIC_SYMBOLS:
            texts = sections[link][4]
            for name, info, _, place, _, _ in struct.iter_unpack("<IBBHQQ", file[begin : begin + length]):
                if place and info >> 4 == GLOBAL and info & 15 in (DATA, FUNCTION):
                    yield file[texts + name : file.index(b"\0", texts + name)].decode(errors="replace")


def load_with_its_own(library: Path) -> None:
    """Load ``library`` in its folder so that it finds its own functions and data, if some have names that this process
    has. What keeps it from being loaded is said when it is loaded again."""
    # Not every library: one may need the program's own of a name, as where malloc is replaced by LD_PRELOAD.
    if DEEP and shadowed(library):
        os.chdir(library.parent)
        with suppress(OSError):
            ctypes.CDLL(str(library), os.RTLD_NOW | DEEP)
