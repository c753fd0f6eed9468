"""FMUs with the oddities of real ones: each is the paper's PID and gives its torques, or is refused in one sentence.

The oddities are those of 240 FMUs of 60 tools in public collections.
"""

import io
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from xml.etree.ElementTree import Comment, Element, SubElement

import fmpy
import numpy as np
import pytest
from exporters.description_edits import DESCRIPTION, Edit, declare, each, without_units
from support.closed_loops import case, simulate_all
from support.pid_fmus import built
from support.refusals import refusal

from controller_fmu.export.archive import unpack
from controller_fmu.export.description import parse, to_bytes
from orchestrator import Benchmark, Controller

pytestmark = pytest.mark.needs("compiler")

Contents = dict[str, bytes]
"""Files of an archive by name; a name with a slash at its end is a folder."""

NAME = "DiagonalPID_C"
SCENARIO = replace(case(0, "compliant", "noise").scenario, duration=Fraction(1, 20))


@dataclass(frozen=True)
class Oddity:
    """``change`` makes it of the contents of an FMU; ``fmu`` is that FMU's name."""

    change: Callable[[Contents], Contents]
    fmu: str = NAME


def library(identifier: str = NAME, platform: str = fmpy.platform) -> str:
    return f"binaries/{platform}/{identifier}{fmpy.sharedLibraryExtension}"


def without(*folders: str) -> Callable[[Contents], Contents]:
    """Without these folders."""
    return lambda files: {name: data for name, data in files.items() if not name.startswith(folders)}


def plus(more: Contents, *left_out: str) -> Callable[[Contents], Contents]:
    """With ``more`` files, and without the folders ``left_out``."""
    return lambda files: {**without(*(left_out or ("none/",)))(files), **more}


def described(*edits: Edit) -> Callable[[Contents], Contents]:
    """With another description."""

    def change(files: Contents) -> Contents:
        root = parse(files[DESCRIPTION])
        for edit in edits:
            edit(root)
        return {**files, DESCRIPTION: to_bytes(root)}

    return change


def written(change: Callable[[bytes], bytes]) -> Callable[[Contents], Contents]:
    """With a description of other bytes."""
    return lambda files: {**files, DESCRIPTION: change(files[DESCRIPTION])}


def named(identifier: str, keep_binary: bool = True) -> Callable[[Contents], Contents]:
    """With another modelIdentifier."""

    def edit(root: Element) -> None:
        for interface in root.iterfind("CoSimulation"):
            interface.set("modelIdentifier", identifier)

    def change(files: Contents) -> Contents:
        binary = {library(identifier): files[library()]} if keep_binary else {}
        return {**without("binaries/")(described(edit)(files)), **binary}

    return change


def utf16(text: bytes) -> bytes:
    return re.sub(r'encoding="[^"]*"', 'encoding="UTF-16"', text.decode(), count=1, flags=re.IGNORECASE).encode(
        "utf-16"
    )


def with_vendor_annotations(root: Element) -> None:
    annotations = SubElement(root, "VendorAnnotations")
    tool = SubElement(annotations, "Tool", name="A tool")
    SubElement(tool, "{https://example.org/tool}Settings", {"{https://example.org/tool}licence": "none"})


def with_a_long_name(root: Element) -> None:
    variables = root.find("ModelVariables")
    assert variables is not None
    attributes = {"name": ".".join(["component"] * 300), "valueReference": "1000000", "causality": "local"}
    SubElement(SubElement(variables, "ScalarVariable", attributes), "Real")


def with_comments(root: Element) -> None:
    each(lambda variable: variable.insert(0, Comment("a comment")))(root)
    root.insert(0, Comment("another"))


def with_structural_parameter(root: Element) -> None:
    variables = root.find("ModelVariables")
    assert variables is not None
    attributes = {"name": "n", "valueReference": "1000000", "causality": "structuralParameter", "start": "2"}
    variables.append(Element("UInt64", attributes, variability="fixed"))
    for dimension in root.iterfind("ModelVariables/Float64/Dimension"):
        dimension.clear()
        dimension.set("valueReference", "1000000")


def without_variability(root: Element) -> None:
    each(lambda variable: variable.attrib.pop("variability", None))(root)


FOLDERS = {f"binaries/{platform}/": b"" for platform in ("linux64", "win64", "darwin64")}
NAMESPACE = b'<fmiModelDescription xmlns="http://fmi-standard.org/fmi2" '

ODD: dict[str, Oddity] = {
    "empty folders of binaries, and sources": Oddity(plus(FOLDERS, "binaries/")),
    "a folder of binaries with a text": Oddity(plus({f"binaries/{fmpy.platform}/readme.txt": b""}, "binaries/")),
    "an empty folder of sources": Oddity(plus({"sources/": b""}, "sources/")),
    "backslashes": Oddity(lambda files: {name.replace("/", "\\"): data for name, data in files.items()}),
    "backslashes of folders, too": Oddity(
        lambda files: {name.replace("/", "\\"): data for name, data in {**FOLDERS, "extra/": b"", **files}.items()}
    ),
    "backslashes, sources only, FMI 3": Oddity(
        lambda files: {name.replace("/", "\\"): data for name, data in without("binaries/")(files).items()},
        "DiagonalPID_C_fmi3",
    ),
    "a hyphen and a dot in the identifier": Oddity(named("Diagonal-PID_v2.0")),
    "a hyphen in the identifier, sources only": Oddity(named("Diagonal-PID", keep_binary=False)),
    "an identifier with spaces and umlauts": Oddity(named("Zwei Achsen für Müller")),
    "a continuous parameter": Oddity(described(declare(r"K_p\[.\]", variability="continuous"))),
    "parameters without a variability": Oddity(described(without_variability)),
    "no variability, FMI 3": Oddity(described(without_variability), "DiagonalPID_C_fmi3"),
    "a fixed input and a fixed output": Oddity(described(declare(r"q_m\[.\]|u_m\[.\]", variability="fixed"))),
    "a tunable output, FMI 3": Oddity(described(declare("u_m", variability="tunable")), "DiagonalPID_C_fmi3"),
    "no units": Oddity(described(without_units)),
    "nested resources": Oddity(plus({f"resources/a b/ä{'/deep' * 20}/données.txt": b"1"})),
    "a long name of a variable": Oddity(described(with_a_long_name)),
    "a long name of a file": Oddity(plus({f"resources/{'n' * 255}": b""})),
    "UTF-8 with BOM": Oddity(written(lambda text: b"\xef\xbb\xbf" + text)),
    "UTF-16": Oddity(written(utf16)),
    "namespaces of a vendor": Oddity(described(with_vendor_annotations)),
    "a namespace of its own": Oddity(written(lambda text: text.replace(b"<fmiModelDescription ", NAMESPACE, 1))),
    "comments": Oddity(described(with_comments)),
    "terminals that are no XML": Oddity(plus({"terminalsAndIcons/terminalsAndIcons.xml": b"<open>"})),
    "no terminals": Oddity(without("terminalsAndIcons/")),
    "a structural parameter": Oddity(described(with_structural_parameter), "DiagonalPID_C_fmi3"),
    "other folders": Oddity(plus({"documentation/licenses/license.txt": b"", "extra/org.tool/data.bin": b"1"})),
}

REFUSED: dict[str, tuple[Callable[[Contents], Contents], str]] = {
    "empty folders of binaries, no sources": (plus(FOLDERS, "binaries/", "sources/"), "no-binary"),
    "empty folders of binaries and sources": (plus({**FOLDERS, "sources/": b""}, "binaries/", "sources/"), "no-binary"),
    "a binary of another platform": (plus({"binaries/win32/X.dll": b"MZ"}, "binaries/", "sources/"), "no-binary"),
    "an identifier that is a path": (named("../Diagonal-PID", keep_binary=False), "bad-description"),
    "an identifier that is too long": (named("x" * 201, keep_binary=False), "bad-description"),
    "all in a folder": (lambda files: {f"{NAME}/{name}": data for name, data in files.items()}, "not-an-fmu"),
    "no version": (written(lambda text: text.replace(b' fmiVersion="2.0"', b"")), "bad-description"),
    "no variables": (described(lambda root: root.remove(root.find("ModelVariables"))), "bad-description"),  # type: ignore
    "an input that is an output": (described(declare(r"q_m\[.\]", causality="output")), "connector-type"),
    "two parents up": (plus({"..\\..\\outside.txt": b""}), "bad-entry"),
    "a drive letter": (plus({"C:\\outside.txt": b""}), "bad-entry"),
}


def zipped(files: Contents, target: Path) -> Path:
    """An archive with these entries, whatever their names."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    target.write_bytes(buffer.getvalue())
    return target


@pytest.fixture(scope="module")
def torques(quick_plant_file, fmu_folder):
    """Those of the PID as it is."""
    return simulate_all(quick_plant_file, built(NAME, fmu_folder), [SCENARIO])[0].command


@pytest.mark.parametrize("name", ODD)
def test_an_odd_fmu_runs_as_the_one_it_was_made_of(name, torques, quick_plant_file, fmu_folder, tmp_path):
    odd = ODD[name]
    file = zipped(odd.change(unpack(built(odd.fmu, fmu_folder))), tmp_path / "odd.fmu")
    (found,) = simulate_all(quick_plant_file, file, [SCENARIO])
    np.testing.assert_array_equal(found.command, torques)
    assert np.ptp(torques, axis=0).min() > 0.0, "it has something to do"


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_used_is_refused_in_one_sentence(name, fmu_folder, tmp_path):
    change, what = REFUSED[name]
    file = zipped(change(unpack(built(NAME, fmu_folder))), tmp_path / "odd.fmu")
    error = refusal(Benchmark().simulate, Controller(file))
    assert error.what == what
    assert "\n" not in str(error) and str(error).endswith(".") and "NoneType" not in str(error)


def test_illegal_combinations_are_a_warning(fmu_folder, tmp_path):
    odd = ODD["a fixed input and a fixed output"]
    file = zipped(odd.change(unpack(built(NAME, fmu_folder))), tmp_path / "odd.fmu")
    (found,) = (each for each in Benchmark("quick").check(Controller(file)) if each.subject == "variables")
    assert found.severity == "warning" and "q_m[1]: fixed input" in found.text and "u_m[2]: fixed output" in found.text
