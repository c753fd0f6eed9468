"""FMUs made from good ones: some cannot be used, others do what a conforming exporter may and the PID does not."""

import os
import re
from pathlib import Path
from xml.etree.ElementTree import Element

from exporters.description_edits import Edit, edited

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


def with_functions(fmu: Path, target: Path, functions: dict[str, str], *edits: Edit) -> Path:
    """``fmu`` without a binary and with other definitions of C functions, by name; compiled when it is opened.

    ``edits`` change the description.
    """
    contents = {name: data for name, data in unpack(fmu).items() if not name.startswith("binaries/")}
    sources = [name for name in contents if name.startswith("sources/") and name.endswith(".c")]
    for function, definition in functions.items():
        # Written out there, with or without a macro for its head, or made by a macro.
        head = rf"^(?:[\w ]+\*?\b{function}\(|[A-Z_]+\({function}\b)"
        written = rf"{head}[^;{{]*?\)\s*\{{(?:[^\n]*\}}|.*?^\}})$"
        pattern = re.compile(rf"{written}|^[A-Z_]+\({function}\b[^)\n]*\)$", re.MULTILINE | re.DOTALL)
        texts = {name: pattern.subn(lambda _, new=definition: new, contents[name].decode(), 1) for name in sources}
        assert any(count for _, count in texts.values()), function
        contents |= {name: text.encode() for name, (text, count) in texts.items() if count}
    target.write_bytes(pack(contents))
    return edited(target, target, *edits)
