"""Reading an FMU's model description, with the flaws of exporters that change no meaning put right."""

from __future__ import annotations

import gc
import io
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription
from lxml import etree

from ..errors import InputError
from .capabilities import Capability, declared, refuse_unsupported
from .entries import DESCRIPTION, DESCRIPTIONS, Damaged, files_of, unpacked

COMBINATIONS: Mapping[str, tuple[str, ...]] = {
    "parameter": ("fixed", "tunable"),
    "calculatedParameter": ("fixed", "tunable"),
    "structuralParameter": ("fixed", "tunable"),
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "local": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "independent": ("continuous",),
}
"""The variabilities that FMI 2.0 and 3.0 allow, by causality."""

NEGATED = "negated alias"
"""The causality that is read of an FMI 1.0 variable with the opposite sign of another one."""

GIVEN = ("parameter", "structuralParameter", "input")
"""Causalities of variables whose initial value is given, not calculated."""


def read_description(file: Path) -> ModelDescription:
    """The model description of an FMU, or of the folder that one was extracted to.

    Raises :class:`InputError` if it is missing or cannot be understood. The schema is not enforced: many exporters'
    descriptions have harmless flaws. A check lists them.
    """
    documents = _documents(file)
    root = _root(file, documents)
    refuse_unsupported(root, file.name)
    # After the refusal: what is refused is told of the file as it is.
    _put_right(root)
    try:
        # FMPy would say: 'NoneType' object has no attribute 'startswith'.
        if root.get("fmiVersion") is None:
            raise ValueError("it has no fmiVersion")
        if root.find("ModelVariables") is None:
            raise ValueError("it has no ModelVariables")
        _check_sizes(root)
        changed = {**documents, DESCRIPTION: etree.tostring(root, encoding="utf-8")}
        with uncollected():  # of 100,000 variables all stay, and looking for garbage takes as long as reading them
            # Without the schema: attributes of vendors, VendorAnnotations in the wrong place (CATIA-Systems/FMPy#774)
            # and unknown causalities (modelon-community/fmi-library#128) change no meaning.
            return fmpy.read_model_description(_archive(changed), validate=False)
    except Exception as problem:  # FMPy raises what it likes for everything a description can get wrong
        message = f"The {DESCRIPTION} of {file.name} cannot be used: {problem or type(problem).__name__}. "
        message += "Check it with: python -m fmpy validate."
        raise InputError(message, "bad-description", file.name) from problem


def _check_sizes(root: etree._Element) -> None:
    """Raise :class:`ValueError` for an array whose size is that of a variable without a start value, or of none."""
    starts: dict[str | None, str | None] = {}
    for size in root.iterfind("ModelVariables/*/Dimension[@valueReference]"):
        # Only if there is such an array: the dictionary of 100,000 variables is not for nothing.
        if not starts:
            starts = {
                variable.get("valueReference"): variable.get("start") for variable in root.iterfind("ModelVariables/*")
            }
        reference, name = size.get("valueReference"), size.getparent().get("name")
        if reference not in starts:
            raise ValueError(f"the size of {name} is a variable that does not exist (value reference {reference})")
        if starts[reference] is None:
            raise ValueError(f"the size of {name} is a variable without a start value (value reference {reference})")


@contextmanager
def uncollected() -> Iterator[None]:
    """Within, no garbage is looked for."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def declared_capabilities(file: Path) -> list[tuple[Capability, str]]:
    """The flags that an FMU's description sets for the kind that is used, with their values."""
    return list(declared(_root(file, _documents(file))))


def illegal_combinations(description: ModelDescription) -> list[str]:
    """What each variable is, with its name, whose causality and variability the standard does not combine.

    FMI 1.0 has other words, and none are found there.
    """
    if str(description.fmiVersion).startswith("1"):
        return []
    return [
        f"{variable.name}: {variable.variability} {variable.causality}"
        for variable in description.modelVariables
        if variable.variability not in COMBINATIONS.get(variable.causality, ())
    ]


def _root(file: Path, documents: Mapping[str, bytes]) -> etree._Element:
    """The root of a description, without the namespace that some exporters give all elements."""
    if DESCRIPTION not in documents:
        message = f"{file.name} is not an FMU: the archive has no {DESCRIPTION}."
        raise InputError(message, "not-an-fmu", file.name)
    try:
        root = etree.fromstring(documents[DESCRIPTION])
    except etree.XMLSyntaxError as problem:
        message = f"The {DESCRIPTION} of {file.name} is not well-formed XML ({problem}). Export the FMU again."
        raise InputError(message, "bad-description", file.name) from None
    namespace = etree.QName(root).namespace
    if namespace is not None:
        for element in root.iter(f"{{{namespace}}}*"):
            element.tag = etree.QName(element).localname
        etree.cleanup_namespaces(root)
    return root


def _put_right(root: etree._Element) -> None:
    """Tell FMPy what it would look up for ``initial``."""
    version = str(root.get("fmiVersion"))
    if version.startswith("1"):
        # FMPy drops this word. The variable has the value of another one with the opposite sign: were it bound as it
        # stands, the loop would run with a wrong sign. With a causality of its own it cannot be bound.
        for variable in root.iterfind("ModelVariables/*[@alias='negatedAlias']"):
            variable.set("causality", NEGATED)
        return
    for variable in root.iterfind("ModelVariables/*"):
        causality = variable.get("causality", "local")
        legal = COMBINATIONS.get(causality, ())
        default = "continuous" if version.startswith("2") else "".join(legal[:1])  # FMI 3.0's is always a legal one
        # FMPy looks the default of `initial` up by causality and variability, and fails for pairs that the standard
        # does not combine, which exporters write all the same.
        if variable.get("initial") is None and variable.get("variability", default) not in legal:
            variable.set("initial", "exact" if causality in GIVEN else "calculated")


def _documents(file: Path) -> dict[str, bytes]:
    """The files of an FMU that are parsed, by name."""
    if file.is_dir():
        return {name: (file / name).read_bytes() for name in DESCRIPTIONS if (file / name).is_file()}
    try:
        with zipfile.ZipFile(file) as archive:
            return {name: unpacked(archive, entry) for name, entry in files_of(archive).items() if name in DESCRIPTIONS}
    except Damaged as problem:
        message = f"{file.name} cannot be read: {problem}. Export the FMU again."
        raise InputError(message, "cannot-extract", file.name) from problem


def _archive(documents: Mapping[str, bytes]) -> io.BytesIO:
    """An archive in memory, which is what FMPy reads both documents from."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, text in documents.items():
            archive.writestr(name, text)
    return buffer
