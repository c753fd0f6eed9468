"""Names of an FMU's library that libraries of this process have, too.

On Linux a library of position-independent code finds its own functions and data by name, first among those of the
program: of Python, the C library and the mathematical library. A law that calls its function ``y0`` got the Bessel
function of that name (V 98.1 where the law's score is 77.6, without a word), and one with a variable ``error`` wrote
into the code of the C library.
"""

from __future__ import annotations

import ctypes
import functools
import os
import re
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

HEAD = b"\x7fELF\x02\x01"
"""Of an ELF file of 64 bits, the lowest byte first: those of other kinds are not loaded on Linux, or not looked at."""

DYNAMIC_SYMBOLS = 11
"""Type of the section with the names that a library shows."""

NAMED, DATA, INDIRECT = (1, 2), (1, 2), 10
"""Bindings (global and weak) and types (data and functions) of symbols, and the type of a function that is chosen when
the library is loaded."""

OF_THE_PROGRAM = re.compile(r"(python[\d.]*|lib(c|m|dl|util|pthread|python[\d.]+)(\.so|-\d)[\d.so]*)$")
"""Files whose names come before a library's own: Python, and what it is linked with."""

DEEP = getattr(os, "RTLD_DEEPBIND", 0)
"""Mode of the loader in which a library's own names come first; 0 where there is none."""


def shadowed(library: Path) -> list[str]:
    """Names of functions and data that ``library`` defines and that the program has already; none of what is no ELF
    file of 64 bits."""
    # What begins with an underscore is the compiler's own, and that of C++ is meant to be one for all.
    return sorted(name for name in _defined(library) & of_the_program() if not name.startswith(("_", "fmi")))


@functools.cache
def of_the_program() -> frozenset[str]:
    """The names that the program and the C libraries that it is linked with define."""
    # From the files: to ask the loader for a name may run code, and for one of libm's names that ended the process.
    with suppress(OSError):
        lines = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
        files = {line.split(maxsplit=5)[5] for line in lines if line.count("/")}
        program = os.path.realpath("/proc/self/exe")
        mapped = [file for file in files if file == program or OF_THE_PROGRAM.fullmatch(os.path.basename(file))]
        return frozenset().union(*(_defined(Path(file)) for file in mapped))
    return frozenset()


def _defined(library: Path) -> frozenset[str]:
    with suppress(OSError, struct.error, IndexError, ValueError, OverflowError):
        return frozenset(_symbols(library.read_bytes()))
    return frozenset()


def _symbols(file: bytes) -> Iterator[str]:
    """Names that an ELF file defines; raises :class:`ValueError` and others for a damaged one."""
    if not file.startswith(HEAD):
        return
    (table,) = struct.unpack_from("<Q", file, 0x28)
    size, count = struct.unpack_from("<HH", file, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", file, table + number * size) for number in range(count)]
    for _, kind, _, _, begin, length, link, _, _, _ in sections:
        if kind == DYNAMIC_SYMBOLS:
            texts = sections[link][4]
            for name, info, _, place, _, _ in struct.iter_unpack("<IBBHQQ", file[begin : begin + length]):
                if place and info >> 4 in NAMED and info & 15 in (*DATA, INDIRECT):
                    yield file[texts + name : file.index(b"\0", texts + name)].decode(errors="replace")


def load_with_its_own(library: Path) -> None:
    """Load ``library`` in its folder so that it finds its own functions and data, if some have names that the program
    has. What keeps it from being loaded is said when it is loaded again."""
    # Not every library: one may need the program's own of a name, as where malloc is replaced by LD_PRELOAD.
    if DEEP and shadowed(library):
        os.chdir(library.parent)
        with suppress(OSError):
            ctypes.CDLL(str(library), os.RTLD_NOW | DEEP)
