"""FMUs of the C controller whose sources are changed: what a conforming exporter may do and the PID does not."""

from __future__ import annotations

import re
from pathlib import Path

from exporters.description_edits import Edit, edited

from controller_fmu.export.archive import pack, unpack


def with_functions(fmu: Path, target: Path, functions: dict[str, str], *edits: Edit) -> Path:
    """``fmu`` without a binary and with other definitions of C functions, by name; compiled when it is opened.

    ``edits`` change the description.
    """
    contents = {name: data for name, data in unpack(fmu).items() if not name.startswith("binaries/")}
    sources = [name for name in contents if name.startswith("sources/") and name.endswith(".c")]
    for function, definition in functions.items():
        # Written out there, or made by a macro.
        written = rf"^[\w ]+\*?\b{function}\([^;{{]*?\)\s*\{{(?:[^\n]*\}}|.*?^\}})$"
        pattern = re.compile(rf"{written}|^[A-Z_]+\({function}\b[^)\n]*\)$", re.MULTILINE | re.DOTALL)
        texts = {name: pattern.subn(lambda _, new=definition: new, contents[name].decode(), 1) for name in sources}
        assert any(count for _, count in texts.values()), function
        contents |= {name: text.encode() for name, (text, count) in texts.items() if count}
    target.write_bytes(pack(contents))
    return edited(target, target, *edits)
