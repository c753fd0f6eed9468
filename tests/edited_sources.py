"""FMUs of the C controller whose sources are changed: what a conforming exporter may do and the PID does not."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree.ElementTree import Element

import build_fmus
from controller_fmu.export.archive import pack, unpack
from controller_fmu.export.description import parse, to_bytes

PID = Path(build_fmus.__file__).parent / "controller_fmu" / "pid_c"


def with_functions(fmu: Path, target: Path, functions: dict[str, str], **attributes: str) -> Path:
    """``fmu`` without a binary and with other definitions of C functions, by name; compiled when it is opened.

    ``attributes`` are set in the description, at its root or at the interface, wherever they belong.
    """
    contents = {name: data for name, data in unpack(fmu).items() if not name.startswith("binaries/")}
    for function, definition in functions.items():
        changed = {
            name: replaced(data.decode(), function, definition)
            for name, data in contents.items()
            if name.startswith("sources/") and name.endswith(".c")
        }
        assert any(changed.values()), function
        contents.update({name: text.encode() for name, text in changed.items() if text is not None})
    root = parse(contents["modelDescription.xml"])
    for name, value in attributes.items():
        _owner(root, name).set(name, value)
    target.write_bytes(pack({**contents, "modelDescription.xml": to_bytes(root)}))
    return target


def replaced(source: str, function: str, definition: str) -> str | None:
    """``source`` with another definition of a function, written out there or made by a macro; None if it has none."""
    written = re.compile(rf"^[\w ]+\*?\b{function}\([^;{{]*?\)\s*\{{(?:[^\n]*\}}|.*?^\}})$", re.MULTILINE | re.DOTALL)
    made = re.compile(rf"^[A-Z_]+\({function}\b[^)]*\)$", re.MULTILINE)
    for pattern in (written, made):
        if pattern.search(source):
            return pattern.sub(lambda _: definition, source, count=1)
    return None


def _owner(root: Element, name: str) -> Element:
    interface = root.find("ModelExchange")
    return root if name.startswith("number") or interface is None else interface


def model_exchange(version: int, target: Path) -> Path:
    """The PID as Model Exchange FMU with scalar variables, of FMI 2 or 3."""
    sources = sorted(PID.glob("*.[ch]"))
    dialect = build_fmus.Dialect(version, "ModelExchange")
    return build_fmus.c_fmu(sources, PID / "modelDescription.xml", target, dialect)
