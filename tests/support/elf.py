"""What a 64-bit ELF library, little-endian, asks other libraries for."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

DYNAMIC_SYMBOLS = 11
"""Type of the section with the symbols that the loader sees (SHT_DYNSYM)."""


@dataclass(frozen=True)
class Section:
    """The fields of a section's header that are used here."""

    kind: int
    offset: int
    size: int
    link: int
    """For symbols: the number of the section with their names."""


def sections(library: bytes) -> tuple[Section, ...]:
    """The sections of a library."""
    assert library[:6] == b"\x7fELF\x02\x01", "64 bits, little-endian"
    (table,) = struct.unpack_from("<Q", library, 0x28)
    size, count = struct.unpack_from("<HH", library, 0x3A)
    found = []
    for at in range(table, table + size * count, size):
        _, kind, _, _, offset, length, link = struct.unpack_from("<IIQQQQI", library, at)
        found.append(Section(kind, offset, length, link))
    return tuple(found)


def undefined_symbols(library: bytes) -> frozenset[str]:
    """Names of the symbols that another library has to define."""
    return frozenset(_undefined(library))


def _undefined(library: bytes) -> Iterator[str]:
    listed = sections(library)
    for section in listed:
        if section.kind != DYNAMIC_SYMBOLS:
            continue
        names = listed[section.link].offset
        for at in range(section.offset, section.offset + section.size, 24):
            name, _, _, home = struct.unpack_from("<IBBH", library, at)
            if name and not home:
                start = names + name
                yield library[start : library.index(b"\0", start)].decode("ascii")
