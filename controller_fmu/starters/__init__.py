"""Starter kits: small complete controllers to begin with, one per language and kind of policy, copied under a name of
one's own."""

from __future__ import annotations

import difflib
import keyword
import re
import shutil
from pathlib import Path

from controller_fmu.errors import FolderTakenError, ModelNameError, StarterError, UnknownKitError
from controller_fmu.export import C_INTERFACE
from controller_fmu.export.folder import model_name

HERE = Path(__file__).resolve().parent
KINDS = {"python": ("python",), "c": ("c",), "numpy": ("policy", "numpy"), "onnx": ("policy", "onnx")}
"""Folders of each kit's files."""

TEXTS, DATA = (".c", ".md", ".py", ".xml"), (".npz", ".onnx")
NAME, CLASS = "my_controller", "MyController"

_COMMENT = re.compile(r'""".*?"""|/\*.*?\*/|#[^\n]*', re.DOTALL)


def copy(kind: str, folder: Path) -> Path:
    """Copy the starter kit ``kind`` into ``folder``, whose name the controller gets, and return ``folder``.

    Args:
        kind: one of KINDS.
        folder: a new or empty folder in one that exists, ``my_controller``; files are named after it, and the class
            or struct ``MyController``. :func:`controller_fmu.export.build_folder` builds it.

    Raises:
        UnknownKitError: there is no such kit.
        ModelNameError: the folder's name cannot be given to a module and a class, or has another meaning there.
        FolderTakenError: the folder is not empty, is a file, or has no parent folder.
        StarterError: the folder cannot be written.
    """
    texts, data = contents(kind, folder)
    try:
        folder.mkdir(exist_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        for path in data:
            shutil.copyfile(path, folder / path.name)
    except OSError as problem:
        raise StarterError(f"cannot be written: {problem.strerror or problem}", str(folder)) from None
    return folder


def contents(kind: str, folder: Path) -> tuple[dict[str, str], list[Path]]:
    """The texts by file name that :func:`copy` would write into ``folder``, and the data files that it would copy
    there; raises the same errors, and writes nothing."""
    texts = renamed(kit(kind), folder.resolve().name)
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise FolderTakenError("the folder is not empty" if folder.is_dir() else "is not a folder", str(folder))
    if not folder.parent.is_dir():
        raise FolderTakenError("the folder to create it in does not exist", str(folder), value=str(folder.parent))
    return texts, _files(kind, DATA)


def kit(kind: str) -> dict[str, str]:
    """Return the texts of the starter kit ``kind`` by file name; raises :class:`UnknownKitError`."""
    if kind not in KINDS:
        near = tuple(difflib.get_close_matches(kind, KINDS)) or tuple(KINDS)
        raise UnknownKitError(f"there is no starter kit {kind!r}", value=kind, nearest=near)
    return {path.name: path.read_text(encoding="utf-8") for path in _files(kind, TEXTS)}


def _files(kind: str, suffixes: tuple[str, ...]) -> list[Path]:
    return sorted(path for folder in KINDS[kind] for path in (HERE / folder).iterdir() if path.suffix in suffixes)


def renamed(texts: dict[str, str], name: str) -> dict[str, str]:
    """Return the texts of a kit, and their file names, for a controller ``name``.

    Raises:
        ModelNameError: ``name`` is not made of ASCII letters, digits and underscores, or is taken.
    """
    class_name = model_name(name)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
        what = f"{name!r} cannot name a controller: use letters, digits and underscores, beginning with a letter"
        near = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lstrip("0123456789_")
        raise ModelNameError(what, value=name, nearest=(near,) if near else ())
    code = "\n".join(_COMMENT.sub("", text) for file, text in texts.items() if file.endswith((".py", ".c")))
    is_taken = class_name in (*keyword.kwlist, *re.findall(r"\w+", code)) and class_name != CLASS
    if is_taken or name in [path.stem for path in C_INTERFACE.iterdir()]:
        raise ModelNameError(f"{name!r} has another meaning in the kit", value=name, nearest=(f"{name}_controller",))
    names = {NAME: name, CLASS: class_name}

    def replaced(text: str) -> str:
        return re.sub(f"{NAME}|{CLASS}", lambda match: names[match[0]], text)

    return {replaced(file): replaced(text) for file, text in texts.items()}
