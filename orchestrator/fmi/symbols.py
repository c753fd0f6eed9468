"""Names of an FMU's library that libraries of this process have, too.

On Linux a library of position-independent code finds its own functions and data by name, first among those of the
program: of Python, the C library and the mathematical library. A law that calls its function ``y0`` got the Bessel
function of that name (V 98.1 where the law's score is 77.6, without a word), and one with a variable ``error`` wrote
into the code of the C library.
"""

from __future__ import annotations

import ctypes
import functools
import mmap
import os
import re
import struct
from collections.abc import Container, Iterator
from contextlib import suppress
from pathlib import Path

HEAD = b"\x7fELF\x02\x01"
"""Of an ELF file of 64 bits, the lowest byte first: those of other kinds are not loaded on Linux, or not looked at."""

DYNAMIC_SYMBOLS = 11
"""Type of the section with the names that a library shows."""

SYMBOL = struct.Struct("<IBBHQQ")
"""An entry of it: where its name begins, what it is, and the section that it lies in."""

NAMED, DATA, INDIRECT = (1, 2), (1, 2), 10
"""Bindings (global and weak) and types (data and functions) of symbols, and the type of a function that is chosen when
the library is loaded."""

OF_THE_PROGRAM = re.compile(r"(python[\d.]*|lib(c|m|dl|util|pthread|python[\d.]+)(\.so|-\d)[\d.so]*)$")
"""Files whose names come before a library's own: Python, and what it is linked with."""

MAX_SYMBOLS, MAX_NAME_BYTES = 1_000_000, 4096
"""Symbols of a library that are looked at, and the longest name; the program's own are far fewer and shorter."""

DEEP = getattr(os, "RTLD_DEEPBIND", 0)
"""Mode of the loader in which a library's own names come first; 0 where there is none."""


def shadowed(library: Path) -> list[str]:
    """Names of functions and data that ``library`` defines and that the program has already; none of what is no ELF
    file of 64 bits."""
    # What begins with an underscore is the compiler's own, and that of C++ is meant to be one for all.
    return sorted(name for name in _defined(library, of_the_program()) if not name.startswith(("_", "fmi")))


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


def _defined(library: Path, among: Container[str] | None = None) -> frozenset[str]:
    """The names that ``library`` defines; of a stranger's those alone that are ``among`` others, whatever it holds."""
    damage = (OSError, struct.error, IndexError, ValueError, OverflowError)
    # Mapped, since a library may have gigabytes, and its names lie anywhere in it.
    with suppress(*damage), library.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
        return frozenset(name for name in _symbols(whole) if among is None or name in among)
    return frozenset()


def _symbols(file: mmap.mmap) -> Iterator[str]:
    """Names that an ELF file defines; raises :class:`ValueError` and others for a damaged one."""
    if file[: len(HEAD)] != HEAD:
        return
    (table,) = struct.unpack_from("<Q", file, 0x28)
    size, count = struct.unpack_from("<HH", file, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", file, table + number * size) for number in range(count)]
    # The first one: a linker writes one, and thousands that are the same one would take hours.
    for _, _, _, _, begin, length, link, _, _, _ in [each for each in sections if each[1] == DYNAMIC_SYMBOLS][:1]:
        texts = sections[link][4]
        for entry in range(begin, begin + min(length, MAX_SYMBOLS * SYMBOL.size), SYMBOL.size):
            name, info, _, place, _, _ = SYMBOL.unpack_from(file, entry)
            if place and info >> 4 in NAMED and info & 15 in (*DATA, INDIRECT):
                # 70 names that all went on to the end of 60 MB took 4.2 GB.
                end = file.find(b"\0", texts + name, texts + name + MAX_NAME_BYTES)
                if end >= 0:
                    yield file[texts + name : end].decode(errors="replace")


def load_with_its_own(library: Path) -> None:
    """Load ``library`` in its folder so that it finds its own functions and data, if some have names that the program
    has. What keeps it from being loaded is said when it is loaded again."""
    # Not every library: one may need the program's own of a name, as where malloc is replaced by LD_PRELOAD.
    if DEEP and shadowed(library):
        os.chdir(library.parent)
        with suppress(OSError):
            ctypes.CDLL(str(library), os.RTLD_NOW | DEEP)
