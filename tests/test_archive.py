"""Archives from strangers: refused with a reason, with nothing written outside the cache, or opened."""

from __future__ import annotations

import hashlib
import io
import shutil
import stat
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from conftest import build_or_skip
from hostile import fmus
from hostile.fmus import LIBRARY, hostile_fmu

from controller_fmu.export.archive import pack
from orchestrator import evaluate
from orchestrator.commands import EXIT_BAD_INPUT, guarded
from orchestrator.cosim import archive
from orchestrator.cosim.archive import open_archive
from orchestrator.errors import InputError
from orchestrator.folders import VARIABLE

DESCRIPTION = "modelDescription.xml"


@pytest.fixture
def room(tmp_path, monkeypatch) -> Path:
    """A folder with a cache of its own below, and a file that nobody may touch beside."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    (tmp_path / "precious").write_text("untouched")
    return tmp_path


@pytest.fixture(scope="module")
def good() -> dict[str, bytes]:
    """The files of an FMU with nothing wrong."""
    return build_or_skip(fmus.contents)


def zipped(entries: list[tuple[str | zipfile.ZipInfo, bytes]]) -> bytes:
    """An archive with these entries, whatever their names."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as opened:
        for name, data in entries:
            opened.writestr(name, data)
    return buffer.getvalue()


def link(name: str, target: str) -> tuple[zipfile.ZipInfo, bytes]:
    """A symbolic link."""
    entry = zipfile.ZipInfo(name)
    entry.create_system = 3
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry, target.encode()


def with_name(data: bytes, placeholder: bytes, name: bytes) -> bytes:
    """An archive with an entry renamed behind zipfile's back, which would refuse or clean the name."""
    assert len(placeholder) == len(name)
    return data.replace(placeholder, name)


def with_source(description: bytes, name: str) -> bytes:
    """The description with a list of sources."""
    listed = f'><SourceFiles><File name="{name}"/></SourceFiles></CoSimulation>'.encode()
    start, rest = description.split(b"<CoSimulation", 1)
    attributes, rest = rest.split(b"/>", 1)
    return start + b"<CoSimulation" + attributes + listed + rest


def encrypted(data: bytes) -> bytes:
    """The archive with all entries flagged as encrypted, in both places."""
    changed = bytearray(data)
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = changed.find(signature)
        while at >= 0:
            (flags,) = struct.unpack_from("<H", changed, at + offset)
            struct.pack_into("<H", changed, at + offset, flags | 1)
            at = changed.find(signature, at + 4)
    return bytes(changed)


ENTITY_BOMB = b"""<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a0 "ha">%s]>
<fmiModelDescription fmiVersion="2.0" modelName="&a25;" guid="x"><CoSimulation modelIdentifier="X"/><ModelVariables/>
<ModelStructure/></fmiModelDescription>""" % b"".join(
    b'<!ENTITY a%d "&a%d;&a%d;&a%d;">' % (i, i - 1, i - 1, i - 1) for i in range(1, 26)
)
EXTERNAL = b"""<?xml version="1.0"?><!DOCTYPE b [<!ENTITY secret SYSTEM "file:///etc/hostname">]>
<fmiModelDescription fmiVersion="2.0" modelName="&secret;" guid="x"><CoSimulation modelIdentifier="X"/>
<ModelVariables/><ModelStructure/></fmiModelDescription>"""

REFUSED = {
    "empty": (lambda good: b"", "no zip archive"),
    "text": (lambda good: b"this is not a zip archive\n" * 40, "no zip archive"),
    "truncated": (lambda good: pack(good)[:-200], "no zip archive"),
    "half": (lambda good: pack(good)[: len(pack(good)) // 2], "no zip archive"),
    "no entries": (lambda good: zipped([]), "no modelDescription.xml"),
    "no description": (lambda good: pack({"readme.txt": b"hello"}), "no modelDescription.xml"),
    "description in a folder": (lambda good: pack({"fmu/modelDescription.xml": b"<a/>"}), "no modelDescription.xml"),
    "two descriptions": (
        lambda good: with_name(
            zipped([*good.items(), ("modelDescription.xmX", b"<other/>")]),
            b"modelDescription.xmX",
            DESCRIPTION.encode(),
        ),
        "more than one modelDescription.xml",
    ),
    "path traversal": (lambda good: zipped([*good.items(), ("../../precious", b"gone")]), "points outside"),
    "traversal in the middle": (
        lambda good: zipped([*good.items(), ("resources/../../../precious", b"gone")]),
        "points outside",
    ),
    "absolute path": (
        lambda good: with_name(zipped([*good.items(), ("Xtmp/hostile", b"gone")]), b"Xtmp/hostile", b"/tmp/hostile"),
        "points outside",
    ),
    "backslashes": (
        lambda good: with_name(zipped([*good.items(), ("..Xprecious", b"gone")]), b"..Xprecious", b"..\\precious"),
        "points outside",
    ),
    "drive letter": (lambda good: zipped([*good.items(), ("c:/precious", b"gone")]), "points outside"),
    "link": (lambda good: zipped([*good.items(), link("resources/passwords", "/etc/passwd")]), "is a link"),
    "link as folder": (
        lambda good: zipped([*good.items(), link("resources", ".."), ("resources/precious", b"gone")]),
        "is a link",
    ),
    "encrypted": (lambda good: encrypted(pack(good)), "is encrypted"),
    "bomb": (lambda good: zipped([*good.items(), ("resources/zeros", bytes(80 << 20))]), "a ratio of 200"),
    "too many files": (
        lambda good: zipped([*good.items(), *((f"resources/{i}", b"") for i in range(10_001))]),
        "10000 files",
    ),
    "huge description": (
        lambda good: pack({**good, DESCRIPTION: good[DESCRIPTION] + b"<!-- -->" * (5 << 20)}),
        "its modelDescription.xml has 42 MB, more than the 34 MB that are read",
    ),
    "huge list of sources": (
        lambda good: pack({**good, "sources/buildDescription.xml": b"<!-- -->" * (5 << 20)}),
        "its sources/buildDescription.xml has 42 MB",
    ),
    "empty description": (lambda good: pack({DESCRIPTION: b""}), "modelDescription.xml"),
    "malformed description": (lambda good: pack({DESCRIPTION: b"<fmiModelDescription>"}), "modelDescription.xml"),
    "binary description": (lambda good: pack({DESCRIPTION: bytes(range(256)) * 4}), "modelDescription.xml"),
    "another root": (lambda good: pack({DESCRIPTION: b"<html><body>404</body></html>"}), "modelDescription.xml"),
    "another version": (
        lambda good: pack({DESCRIPTION: b'<fmiModelDescription fmiVersion="9.0" modelName="x"/>'}),
        "modelDescription.xml",
    ),
    "entity bomb": (lambda good: pack({DESCRIPTION: ENTITY_BOMB}), "modelDescription.xml"),
    "external entity": (lambda good: pack({DESCRIPTION: EXTERNAL}), "modelDescription.xml"),
    "identifier that leaves the folder": (
        lambda good: pack({**good, DESCRIPTION: fmus.edited(modelIdentifier="../../../../precious")}),
        "is no C identifier",
    ),
    "identifier of another library": (
        lambda good: pack({**good, DESCRIPTION: fmus.edited(modelIdentifier="Another")}),
        "the modelIdentifier does not fit",
    ),
    "a step size that fills the memory": (
        lambda good: pack({**good, DESCRIPTION: with_step_size(good[DESCRIPTION], "1e9999999999")}),
        "is no number of seconds",
    ),
    "a step size divided by zero": (
        lambda good: pack({**good, DESCRIPTION: with_step_size(good[DESCRIPTION], "1/0")}),
        "is no number of seconds",
    ),
    "a start value in words": (
        lambda good: pack({**good, DESCRIPTION: good[DESCRIPTION].replace(b'start="0"', b'start="much"')}),
        "is no number for each element",
    ),
    "no binary": (lambda good: pack({DESCRIPTION: good[DESCRIPTION]}), "no binary for this platform"),
    "sources that are none": (
        lambda good: pack({DESCRIPTION: good[DESCRIPTION], "sources/model.c": b'#error "never mind"\n'}),
        "do not compile",
    ),
    "sources outside": (
        lambda good: pack({DESCRIPTION: with_source(good[DESCRIPTION], "../../../precious"), "sources/model.c": b""}),
        "lies outside the FMU",
    ),
}


def with_step_size(text: bytes, value: str) -> bytes:
    """A description with this step size as its default."""
    return text.replace(b"<ModelVariables>", f'<DefaultExperiment stepSize="{value}"/><ModelVariables>'.encode())


@pytest.mark.parametrize("name", REFUSED)
def test_a_bad_archive_is_refused_with_the_reason(name, good, room, capsys):
    build, reason = REFUSED[name]
    file = room / "bad.fmu"
    file.write_bytes(build(good))
    before = outside_of_the_cache(room)
    assert guarded(evaluate.main, [str(file), "--quick", "--output-dir", str(room / "out")]) == EXIT_BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert reason in error
    assert "Traceback" not in error
    assert len(error) < 1000
    assert outside_of_the_cache(room) == before
    assert (room / "precious").read_text() == "untouched"
    assert not list(room.glob("cache/fmus/incomplete-*"))


def outside_of_the_cache(room: Path) -> dict[str, bytes]:
    """Names and hashes of all files beside the cache."""
    return {
        str(path.relative_to(room)): hashlib.sha256(path.read_bytes()).digest()
        for path in room.rglob("*")
        if path.is_file() and "cache" not in path.parts
    }


def test_a_size_that_is_a_lie_is_noticed(good, room):
    """Headers may say that little comes out of much: what counts is what comes out."""
    data = bytearray(zipped([*good.items(), ("resources/zeros", bytes(1 << 20))]))
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        at = data.rfind(signature)
        struct.pack_into("<I", data, at + offset, 10)
    file = room / "liar.fmu"
    file.write_bytes(bytes(data))
    with pytest.raises(InputError, match="cannot be extracted"):
        open_archive(file)
    assert sum(path.stat().st_size for path in room.rglob("zeros")) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are any bytes on Linux")
def test_a_name_that_is_no_utf8_is_refused(good, room):
    file = room / "\udcff.fmu"
    file.write_bytes(pack(good))
    with pytest.raises(InputError, match="Rename it"):
        open_archive(file)


@pytest.mark.parametrize("what", ["missing", "folder", "long name"])
def test_what_is_no_file(what, room, capsys):
    path = room / ("x.fmu" if what != "long name" else "x" * 300 + ".fmu")
    if what == "folder":
        path.mkdir()
    assert guarded(evaluate.main, [str(path), "--quick", "--output-dir", str(room / "out")]) == EXIT_BAD_INPUT
    assert capsys.readouterr().err.startswith(f"error: {'There is no file ' if what != 'long name' else ''}{path}")


# ---- Libraries that are none ----


BROKEN_LIBRARIES = {
    "text": lambda library: b"not a library\n",
    "empty": lambda library: b"",
    "truncated": lambda library: library[: len(library) // 2],
    "cut in the header": lambda library: library[:100],
    "zeros": lambda library: library[:64] + bytes(len(library) - 64),
}


@pytest.mark.skipif(sys.platform != "linux", reason="shared objects of Linux")
@pytest.mark.parametrize("name", BROKEN_LIBRARIES)
def test_a_broken_library_has_no_verdict_and_no_traceback(name, good, tmp_path, capsys):
    file = tmp_path / "broken.fmu"
    file.write_bytes(pack({**good, LIBRARY: BROKEN_LIBRARIES[name](good[LIBRARY])}))
    code = guarded(evaluate.main, [str(file), "--quick", "--output-dir", str(tmp_path / "out"), "--only", "c00.*"])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err + captured.out
    if code == EXIT_BAD_INPUT:
        assert "broken.fmu cannot be loaded" in captured.err
    else:  # a truncated library may end the process that loads it, with SIGBUS
        assert code == 1
        assert "loading its library" in (tmp_path / "out" / "cases.csv").read_text()


@pytest.mark.skipif(sys.platform != "linux", reason="shared objects of Linux")
def test_a_library_without_fmi_functions(good, tmp_path, capsys):
    (tmp_path / "empty.c").write_text("int nothing(void) { return 0; }\n")
    target = tmp_path / "empty.so"
    subprocess.run(["cc", "-shared", "-fPIC", str(tmp_path / "empty.c"), "-o", str(target)], check=True)
    file = tmp_path / "broken.fmu"
    file.write_bytes(pack({**good, LIBRARY: target.read_bytes()}))
    code = guarded(evaluate.main, [str(file), "--quick", "--output-dir", str(tmp_path / "out"), "--only", "c00.*"])
    error = capsys.readouterr().err
    assert (code, "Traceback" in error) == (EXIT_BAD_INPUT, False)
    assert "cannot be loaded" in error


# ---- The cache ----


def test_equal_contents_share_a_folder(good, room):
    fmu = hostile_fmu(room)
    copy = Path(shutil.copy(fmu, room / "copy.fmu"))
    assert open_archive(fmu).folder == open_archive(copy).folder
    assert len(list((room / "cache" / "fmus").iterdir())) == 1


@pytest.mark.parametrize("damage", ["changed", "emptied", "missing"])
def test_a_spoiled_folder_in_the_cache_is_extracted_again(damage, good, room):
    fmu = hostile_fmu(room)
    library = open_archive(fmu).folder / LIBRARY
    contents = library.read_bytes()
    if damage == "missing":
        library.unlink()
    else:
        library.write_bytes(b"" if damage == "emptied" else contents[:-1] + b"!")
    assert (open_archive(fmu).folder / LIBRARY).read_bytes() == contents
    assert not list((room / "cache" / "fmus").glob("incomplete-*"))


def test_what_was_compiled_beside_the_files_stays(good, room):
    fmu = hostile_fmu(room)
    compiled = open_archive(fmu).folder / "resources" / "compiled.bin"
    compiled.write_bytes(b"machine code")
    open_archive(fmu)
    assert compiled.read_bytes() == b"machine code"


def test_a_cache_that_cannot_be_written(good, room):
    (room / "cache").mkdir()
    (room / "cache" / "fmus").write_text("a file in the way")
    with pytest.raises(InputError, match="cannot be extracted into the cache"):
        open_archive(hostile_fmu(room))


def test_a_file_that_is_too_large_is_not_unpacked(good, room, monkeypatch):
    file = hostile_fmu(room)
    monkeypatch.setattr(archive, "MOST_BYTES", file.stat().st_size)
    with pytest.raises(InputError, match="The limits are 10000 files, 0 MB"):
        open_archive(file)
    monkeypatch.setattr(archive, "MOST_BYTES", file.stat().st_size - 1)
    with pytest.raises(InputError, match="it has more than 0 MB"):
        open_archive(file)
    assert not (room / "cache").exists()
