"""FMUs that cannot be used, made from good ones."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree.ElementTree import Element

from exporters.description_edits import edited

from controller_fmu.export.archive import pack, unpack


def without(fmu: Path, target: Path, *prefixes: str) -> Path:
    """``fmu`` without the entries that begin with one of ``prefixes``; no cache has ever seen it."""
    kept = {name: data for name, data in unpack(fmu).items() if not name.startswith(prefixes)}
    target.write_bytes(pack({**kept, "documentation/note.txt": os.urandom(8).hex().encode()}))
    return target


def with_broken_sources(fmu: Path, target: Path) -> Path:
    """``fmu`` with sources only, which do not compile."""
    entries = {name: data for name, data in unpack(fmu).items() if not name.startswith("binaries/")}
    target.write_bytes(pack({**entries, "sources/pid.c": b"this is not C\n"}))
    return target


def of_another_guid(fmu: Path, target: Path) -> Path:
    """``fmu`` whose description is not its binary's."""

    def change(root: Element) -> None:
        root.set("guid", "{00000000-0000-0000-0000-000000000000}")

    return edited(fmu, target, change)
