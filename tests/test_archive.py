"""Archives from strangers: refused with a reason, with nothing written outside the cache, or opened."""

import hashlib
import io
import platform
import shutil
import stat
import struct
import subprocess
import sys
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from hostile import fmus
from hostile.fmus import LIBRARY
from support import descriptions
from support.refusals import refusal
from support.tools import require

from controller_fmu.export.archive import pack
from orchestrator import Benchmark, Controller
from orchestrator.cache import PRIVATE, VARIABLE, incomplete
from orchestrator.errors import EnvironmentFault, FmuError, InputError
from orchestrator.fmi import archive, compilation, entries
from orchestrator.fmi.archive import open_archive, restore
from orchestrator.fmi.slaves.base import refusal as load_refusal

DESCRIPTION = "modelDescription.xml"


@pytest.fixture
def room(tmp_path, monkeypatch) -> Path:
    """A folder with a cache of its own below, and a file that nobody may touch beside."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    (tmp_path / "precious").write_text("untouched")
    return tmp_path


@pytest.fixture
def good() -> dict[str, bytes]:
    """The files of an FMU with nothing wrong, as long as nobody loads it."""
    return fmus.sound()


@pytest.fixture
def good_file(room, good) -> Path:
    """That FMU."""
    file = room / "good.fmu"
    file.write_bytes(pack(good))
    return file


def zipped(entries: list[tuple[str | zipfile.ZipInfo, bytes]], placeholder: bytes = b"", name: bytes = b"") -> bytes:
    """An archive with these entries, whatever their names: zipfile, which would refuse or clean ``name``, is given a
    ``placeholder`` of the same length."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as opened:
        for entry, data in entries:
            opened.writestr(entry, data)
    assert len(placeholder) == len(name)
    return buffer.getvalue().replace(placeholder, name) if name else buffer.getvalue()


def more(entry: str | zipfile.ZipInfo, data: bytes = b"gone", placeholder: bytes = b"", name: bytes = b""):
    """What makes an archive of a good FMU and one more entry."""
    return lambda good: zipped([*good.items(), (entry, data)], placeholder, name)


def described(description: bytes, whole: bool = False, **others: bytes):
    """What makes an archive of a description, and of all else there is of a good FMU if ``whole``."""
    return lambda good: pack({**(good if whole else {}), DESCRIPTION: description, **others})


def link(name: str, target: str) -> tuple[zipfile.ZipInfo, bytes]:
    """A symbolic link."""
    entry = zipfile.ZipInfo(name)
    entry.create_system = 3
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry, target.encode()


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


def of_method(data: bytes, method: int) -> bytes:
    """The archive with all entries said to be compressed by ``method``, in both places."""
    changed = bytearray(data)
    for signature, offset in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        at = changed.find(signature)
        while at >= 0:
            struct.pack_into("<H", changed, at + offset, method)
            at = changed.find(signature, at + 4)
    return bytes(changed)


def beginning_at(data: bytes, offset: int) -> bytes:
    """The archive with its first entry said to begin at ``offset``, by a field for large files."""
    entry, end = data.find(b"PK\x01\x02"), data.rfind(b"PK\x05\x06")
    name, extra = struct.unpack_from("<HH", data, entry + 28)
    field = struct.pack("<HHQ", 1, 8, offset)
    changed = bytearray(data)
    struct.pack_into("<I", changed, end + 12, struct.unpack_from("<I", data, end + 12)[0] + len(field))
    struct.pack_into("<H", changed, entry + 30, extra + len(field))
    struct.pack_into("<I", changed, entry + 42, 0xFFFFFFFF)
    behind = entry + 46 + name + extra
    return bytes(changed[:behind] + field + changed[behind:])


def damaged(files: dict[str, bytes], name: str, method: int) -> bytes:
    """The archive, packed by ``method``, with some bytes in the middle of its entry ``name`` inverted."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as opened:
        for entry, data in files.items():
            opened.writestr(entry, data)
        begin, size = opened.getinfo(name).header_offset, opened.getinfo(name).compress_size
    data = bytearray(buffer.getvalue())
    middle = begin + 30 + len(name) + size // 2
    data[middle : middle + 8] = bytes(255 - byte for byte in data[middle : middle + 8])
    return bytes(data)


METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)

ENTITY_BOMB = b"""<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a0 "ha">%s]>
<fmiModelDescription fmiVersion="2.0" modelName="&a25;" guid="x"><CoSimulation modelIdentifier="X"/><ModelVariables/>
<ModelStructure/></fmiModelDescription>""" % b"".join(
    b'<!ENTITY a%d "&a%d;&a%d;&a%d;">' % (i, i - 1, i - 1, i - 1) for i in range(1, 26)
)
EXTERNAL = b"""<?xml version="1.0"?><!DOCTYPE b [<!ENTITY secret SYSTEM "file:///etc/hostname">]>
<fmiModelDescription fmiVersion="2.0" modelName="&secret;" guid="x"><CoSimulation modelIdentifier="X"/>
<ModelVariables/><ModelStructure/></fmiModelDescription>"""

REFUSED = {
    "empty": (lambda good: b"", "not-an-fmu"),
    "text": (lambda good: b"this is not a zip archive\n" * 40, "not-an-fmu"),
    "truncated": (lambda good: pack(good)[:-200], "not-an-fmu"),
    "no entries": (lambda good: zipped([]), "not-an-fmu"),
    "description in a folder": (lambda good: pack({"fmu/modelDescription.xml": b"<a/>"}), "not-an-fmu"),
    "two descriptions": (more(f"{DESCRIPTION[:-1]}X", b"<x/>", b"tion.xmX", b"tion.xml"), "bad-description"),
    "another spelling of the description": (more(f"./{DESCRIPTION}", b"<x/>"), "bad-entry"),
    "two slashes": (more("resources//none.txt"), "bad-entry"),
    "a folder of a dot": (more("resources/./"), "bad-entry"),
    "a dot": (more("resources/."), "bad-entry"),
    "a description in other letters": (more(DESCRIPTION.lower(), b"<x/>"), "bad-description"),
    "path traversal": (more("../../precious"), "bad-entry"),
    "traversal in the middle": (more("resources/../../../precious"), "bad-entry"),
    "absolute path": (more("Xtmp/hostile", b"gone", b"Xtmp/hostile", b"/tmp/hostile"), "bad-entry"),
    "traversal by backslashes": (more("..Xprecious", b"gone", b"..Xprecious", b"..\\precious"), "bad-entry"),
    "absolute path by backslashes": (more("Xtmp/hostile", b"gone", b"Xtmp/hostile", b"\\tmp/hostile"), "bad-entry"),
    "a file that is a folder, too": (more("resources/none.txt/more"), "bad-entry"),
    "a name that is too long": (more("resources/" + "n" * 256), "bad-entry"),
    "drive letter": (more("c:/precious"), "bad-entry"),
    "link": (more(*link("resources/passwords", "/etc/passwd")), "bad-entry"),
    "a library as if it was compiled here": (more("compiled/x/binaries/linux64/x.so"), "bad-entry"),
    "a file in the place of what is compiled": (more("Compiled"), "bad-entry"),
    "an entry that begins where no file has a place": (
        lambda good: beginning_at(pack(good), (1 << 63) - 1),
        "cannot-extract",
    ),
    "encrypted": (lambda good: encrypted(pack(good)), "bad-entry"),
    **{
        f"compressed by method {method}": (lambda good, method=method: of_method(pack(good), method), "bad-entry")
        for method in (1, 9, 12, 14, 93, 99)
    },
    **{
        f"damaged {entry}, method {method}": (
            lambda good, entry=entry, method=method: damaged(good, entry, method),
            "cannot-extract",
        )
        for entry in (DESCRIPTION, LIBRARY)
        for method in METHODS
    },
    "bomb": (more("resources/zeros", bytes(80 << 20)), "archive-limit"),
    "too many files": (lambda good: zipped([(f"resources/{i}", b"") for i in range(10_001)]), "archive-limit"),
    "too many folders": (
        lambda good: zipped([*good.items(), *((f"resources/{i}/" + "a/" * 79 + "x", b"") for i in range(126))]),
        "archive-limit",
    ),
    "a path that is too long": (more("resources/" + ("n" * 199 + "/") * 10 + "x"), "bad-entry"),
    "a path that is too deep": (more("resources/" + "n/" * 99 + "x"), "bad-entry"),
    "a huge directory": (lambda good: zipped([(f"resources/{i}", b"") for i in range(70_000)]), "archive-limit"),
    "huge description": (described(b"<!-- -->" * (5 << 20), True), "bad-entry"),
    "huge list of sources": (more("sources/buildDescription.xml", b"<!-- -->" * (5 << 20)), "bad-entry"),
    "empty description": (described(b""), "bad-description"),
    "malformed description": (described(b"<fmiModelDescription>"), "bad-description"),
    "binary description": (described(bytes(range(256)) * 4), "bad-description"),
    "another root": (described(b"<html><body>404</body></html>"), "bad-description"),
    "another version": (described(b'<fmiModelDescription fmiVersion="9.0" modelName="x"/>'), "bad-description"),
    "entity bomb": (described(ENTITY_BOMB), "bad-description"),
    "external entity": (described(EXTERNAL), "bad-description"),
    "identifier that leaves the folder": (
        described(fmus.edited(modelIdentifier="../../../../precious"), True),
        "bad-description",
    ),
    "identifier of another library": (described(fmus.edited(modelIdentifier="Another"), True), "bad-description"),
    "a start value in words": (described(fmus.edited().replace(b'start="0.0"', b'start="much"'), True), "bad-start"),
    "no binary": (described(fmus.edited()), "no-binary"),
    "sources that are none": (described(fmus.edited(), **{"sources/model.c": b"#error\n"}), "bad-sources"),
    "sources outside": (
        described(with_source(fmus.edited(), "../../../precious"), **{"sources/model.c": b""}),
        "bad-sources",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_bad_archive_is_refused_with_the_reason(name, good, room):
    build, what = REFUSED[name]
    if what == "bad-sources":
        require("compiler")
    file = room / "bad.fmu"
    file.write_bytes(build(good))
    before = outside_of_the_cache(room)
    error = refusal(open_archive, file)
    assert error.what == what
    assert "bad.fmu" in error.where or what == "bad-start"
    assert outside_of_the_cache(room) == before
    assert (room / "precious").read_text() == "untouched"
    assert not list(room.glob("cache/fmus/incomplete-*"))


def test_the_reason_stands_before_a_page_of_warnings(good, room):
    """Five lines of what the compiler had said were shown, and the error was behind them."""
    require("compiler")
    file = room / "bad.fmu"
    source = b"#warning one\n" * 10 + b"#error the reason\n"
    file.write_bytes(described(fmus.edited(), **{"sources/model.c": source})(good))
    assert "error: the reason" in str(refusal(open_archive, file)).splitlines()[1].replace("#error", "error:")


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
    assert refusal(open_archive, file).what == "cannot-extract"
    assert sum(path.stat().st_size for path in room.rglob("zeros")) == 0


@pytest.mark.parametrize("method", METHODS)
def test_what_python_unpacks_is_opened(method, good, room):
    file = room / "good.fmu"
    with zipfile.ZipFile(file, "w", method) as opened:
        for name, data in good.items():
            opened.writestr(name, data)
    assert (open_archive(file).folder / LIBRARY).read_bytes() == good[LIBRARY]


@pytest.mark.parametrize(("method", "words"), [(9, "Deflate64"), (93, "Zstandard"), (99, "encrypted"), (1, "method 1")])
def test_a_method_of_compression_is_refused_by_its_name(method, words, good, room):
    file = room / "packed.fmu"
    file.write_bytes(of_method(pack(good), method))
    error = refusal(open_archive, file)
    assert words in str(error) and "\n" not in str(error)


@pytest.mark.parametrize("name", ["absent.fmu", "folder", "x" * 300 + ".fmu"])
def test_what_is_not_a_file(name, room):
    (room / "folder").mkdir()
    error = refusal(open_archive, room / name)
    assert (error.what, error.where) == ("no-file", str(room / name))


@pytest.mark.needs("linux")  # where names of files are any bytes
def test_a_name_that_is_not_utf8_is_refused(good, room):
    file = room / "\udcff.fmu"
    file.write_bytes(pack(good))
    assert refusal(open_archive, file).what == "bad-file-name"


BROKEN_LIBRARIES = {
    "text": lambda library: b"not a library\n",
    "truncated": lambda library: library[: len(library) // 2],
    "of another program": lambda library: Path(sys.modules["_ctypes"].__file__).read_bytes(),
}


@pytest.mark.needs("linux")
@pytest.mark.parametrize("name", BROKEN_LIBRARIES)
def test_a_broken_library_has_no_verdict(name, good, tmp_path):
    file = tmp_path / "broken.fmu"
    file.write_bytes(pack({**good, LIBRARY: BROKEN_LIBRARIES[name](good[LIBRARY])}))
    try:
        evaluation = Benchmark("quick").evaluate(Controller(file), only="c00.compliant.noise", recordings=False)
    except FmuError as error:
        assert error.call == "load" and "broken.fmu" in str(error)
    else:  # a truncated library may end the process that loads it, with SIGBUS
        (case,) = evaluation.cases
        assert not case.simulated and "loading its library" in case.message


@pytest.mark.parametrize("damage", ["changed", "emptied", "missing"])
def test_a_spoiled_folder_in_the_cache_is_extracted_again(damage, room, good_file):
    library = open_archive(good_file).folder / LIBRARY
    contents, folder = library.read_bytes(), library.parents[2]
    compiled, left = folder / "compiled" / "x.so", folder / "resources" / "left.bin"
    for file in (compiled, left):
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(b"something")
    assert open_archive(good_file).folder == folder
    assert (compiled.is_file(), left.is_file()) == (True, False), (
        "what is compiled stays, what an FMU has left does not"
    )
    if damage == "missing":
        library.unlink()
    else:
        library.write_bytes(b"" if damage == "emptied" else contents[:-1] + b"!")
    assert (open_archive(good_file).folder / LIBRARY).read_bytes() == contents
    assert not list((room / "cache" / "fmus").glob("incomplete-*"))


def test_half_an_extraction_is_named_by_its_fmu(room, good_file, monkeypatch):
    """What a process leaves that is killed is found, and goes with the FMU."""
    there = []
    monkeypatch.setattr(archive, "extract", lambda _, folder: there.append(folder.parent) or entries.extract(_, folder))
    opened = open_archive(good_file)
    assert [place.name.startswith(incomplete(opened.sha256)) for place in there] == [True]


def test_a_cache_that_cannot_be_written(room, good_file):
    (room / "cache").mkdir()
    (room / "cache" / "fmus").write_text("a file in the way")
    assert refusal(open_archive, good_file, kind=EnvironmentFault).what == "no-cache"


def test_large_contents_take_no_memory(room, good):
    """15 MB with 1.9 GB of resources took 5.7 GB of the process that opens it."""
    file = room / "large.fmu"
    file.write_bytes(zipped([*good.items(), ("resources/zeros", bytes(60 << 20))]))
    tracemalloc.start()
    try:
        opened = open_archive(file)
        assert open_archive(file).folder == opened.folder, "what is there is compared"
        archive.check_files(opened.name, opened.folder, opened.digests)
        assert tracemalloc.get_traced_memory()[1] < 30 << 20
    finally:
        tracemalloc.stop()
    assert opened.digests["resources/zeros"] == hashlib.sha256(bytes(60 << 20)).hexdigest()


def test_as_many_folders_as_allowed(room, good, monkeypatch):
    file = room / "deep.fmu"
    file.write_bytes(zipped([*good.items(), ("resources/" + "a/" * 98 + "x", b""), ("resources/b/x", b"")]))
    folder = open_archive(file).folder
    assert (folder / ("resources/" + "a/" * 98 + "x")).is_file()
    shutil.rmtree(folder)
    monkeypatch.setattr(entries, "MAX_FOLDERS", 98)
    assert "more than 98 folders" in str(refusal(open_archive, file))


@pytest.mark.parametrize("file_stays", [True, False])
def test_a_deleted_folder_is_extracted_again_from_memory(file_stays, room, good_file):
    opened = open_archive(good_file)
    assert not restore(opened), "nothing to do"
    copy = Path(shutil.copy(good_file, room / "copy.fmu"))
    assert open_archive(copy).folder == opened.folder, "equal contents share one"
    shutil.rmtree(room / "cache")
    if not file_stays:
        good_file.unlink()
    assert restore(opened) and (opened.folder / LIBRARY).is_file()


def test_a_file_that_is_too_large_is_not_unpacked(room, good_file, monkeypatch):
    size = good_file.stat().st_size
    for most in (size, size - 1):  # its contents, and the file itself
        for module in (archive, entries):
            monkeypatch.setattr(module, "MAX_BYTES", most)
        assert refusal(open_archive, good_file).what == "archive-limit"
    assert not (room / "cache").exists()


@pytest.fixture
def fenced(tmp_path):
    """What runs a script of a shell as the compiler of an FMU in ``tmp_path / "own"`` is run."""
    output = tmp_path / "own" / "scratch" / "library.so"
    output.parent.mkdir(parents=True)

    def run(script: str) -> subprocess.CompletedProcess[str]:
        words = compilation._fence(output, ["true"], zig=False)
        return subprocess.run([*words, "sh", "-c", script, str(output)], check=False, capture_output=True, text=True)

    return run


@pytest.mark.needs("bubblewrap")
def test_a_compiler_of_foreign_sources_writes_its_library_only(tmp_path, fenced):
    own = tmp_path / "own"
    script = f"echo made > $0; touch {own}/scratch/more {own}/more {tmp_path}/other $TMPDIR/temporary; ls $TMPDIR"
    assert fenced(script).stdout.split() == ["library.so", "library.so.out", "more", "temporary"]
    assert [str(file.relative_to(own)) for file in own.rglob("*.*")] == ["scratch/library.so"]
    assert list(own.rglob("more")) == [] and not (tmp_path / "other").exists()
    assert (own / "scratch" / "library.so").read_text() == "made\n"


@pytest.mark.needs("bubblewrap")
def test_a_compiler_of_foreign_sources_fills_no_disk(tmp_path, fenced, monkeypatch):
    """Each of its files was limited, and not their sum: 34 kB of sources wrote 7 GB."""
    monkeypatch.setattr(compilation, "SCRATCH_BYTES", 1 << 20)
    done = fenced("for i in 1 2 3; do head -c 500000 /dev/zero > $TMPDIR/$i || exit 7; done")
    assert done.returncode == 7 and "No space left" in done.stderr
    assert sum(file.stat().st_size for file in tmp_path.rglob("*") if file.is_file()) == 0


@pytest.mark.needs("bubblewrap")
def test_a_compiler_of_foreign_sources_reads_no_file_of_the_user(tmp_path, fenced):
    """A source could include the certificate that is repeated, and hand it to the controller that it becomes."""
    other = tmp_path / "verification.json"
    other.write_text("secret")
    (tmp_path / "own" / "source.c").write_text("own")
    assert fenced(f"cat {other} {tmp_path}/own/source.c").stdout == "own"


@pytest.mark.needs("bubblewrap")
def test_a_compiler_of_foreign_sources_finds_no_terminal(fenced):
    """A source that includes /dev/ptmx had it wait for ever, and with it a place of the service."""
    assert sorted(fenced("ls /dev").stdout.split()) == ["full", "null", "random", "urandom", "zero"]


@pytest.mark.needs("linux")  # a shell script stands for the compiler
def test_a_compiler_of_foreign_sources_has_nothing_of_the_services_environment(good, room, monkeypatch):
    """A source that includes /proc/self/environ quotes it in the errors."""
    compiler = room / "bin" / "cc"
    compiler.parent.mkdir()
    compiler.write_text('#!/bin/sh\necho "token <$A_TOKEN>, places <$CPATH>" >&2\nexit 1\n')
    compiler.chmod(0o755)
    for name, value in {"CC": str(compiler), "A_TOKEN": "secret", "CPATH": "/usr/own"}.items():
        monkeypatch.setenv(name, value)
    file = room / "curious.fmu"
    file.write_bytes(described(fmus.edited(), **{"sources/model.c": b""})(good))
    assert "token <>, places </usr/own>" in str(refusal(open_archive, file))


WITHOUT_FENCE = {
    "missing": "",
    "refused": "exit 1",
    "gone after its trial": 'case "$*" in *" true") exit 0;; esac; echo "bwrap: No permissions" >&2; exit 1',
}


@pytest.mark.needs("linux")  # shell scripts stand for the compiler and for bubblewrap
@pytest.mark.parametrize("bubblewrap", WITHOUT_FENCE)
def test_beside_a_private_folder_nothing_is_compiled_without_a_fence(bubblewrap, good, room, monkeypatch):
    """While bubblewrap was upgraded, sources with ``.incbin`` got the database of a service into their library."""
    programs = room / "bin"
    programs.mkdir()
    scripts = {"cc": f"touch {room}/compiled; exit 1", "bwrap": WITHOUT_FENCE[bubblewrap]}
    for name, script in scripts.items():
        if script:
            (programs / name).write_text(f"#!/bin/sh\nPATH=/usr/bin:/bin\n{script}\n")
            (programs / name).chmod(0o755)
    for name, value in {"CC": str(programs / "cc"), "PATH": str(programs), PRIVATE: str(room)}.items():
        monkeypatch.setenv(name, value)
    file = room / "own.fmu"
    file.write_bytes(described(fmus.edited(), **{"sources/model.c": b""})(good))
    assert refusal(open_archive, file).what == "no-sandbox"
    assert not (room / "compiled").exists()


def test_an_fmu_that_is_opened_while_it_is_compiled_is_compiled(good, room, monkeypatch):
    """Two people handed in the same sources: the second one's check removed the library of the first, as a file that
    the FMU had left, and the first one was refused."""
    require("compiler")
    file, run = room / "own.fmu", compilation.run_compiler
    file.write_bytes(described(fmus.edited(), **{"sources/model.c": b"int x = 1;\n"})(good))

    def meanwhile(command, output, **options):
        run(command, output, **options)
        monkeypatch.setattr(compilation, "run_compiler", run)
        open_archive(file)

    monkeypatch.setattr(compilation, "run_compiler", meanwhile)
    opened = open_archive(file)
    assert opened.has_library and opened.added() == []


@pytest.mark.parametrize("damage", [b"", b"\x7fELF another"])
def test_a_library_that_was_compiled_and_is_damaged_is_compiled_anew(damage, good, room):
    """A power cut had left it empty: the FMU could not be loaded, and that was held against it, for good."""
    require("compiler")
    file = room / "own.fmu"
    file.write_bytes(described(fmus.edited(), **{"sources/model.c": b"int x = 1;\n"})(good))
    library = open_archive(file).library_file
    whole = library.read_bytes()
    assert not restore(open_archive(file))
    for repair in (lambda opened: open_archive(opened.file), restore):
        opened = open_archive(file)
        library.write_bytes(damage)
        repair(opened)
        assert library.read_bytes()[:4] == whole[:4] and len(library.read_bytes()) == len(whole)


@pytest.mark.needs("linux")  # a shell script stands for the compiler
@pytest.mark.parametrize(
    ("script", "kind"),
    [
        ("kill -9 $$", EnvironmentFault),
        ('echo "cc: fatal error: Killed signal terminated program cc1" >&2; exit 1', EnvironmentFault),
        ("kill -11 $$", InputError),
        ('echo "model.c:1:2: error: #error Killed" >&2; exit 1', InputError),
    ],
)
def test_a_compiler_that_somebody_ends_is_no_fault_of_the_sources(script, kind, good, room, monkeypatch):
    """Where memory was short, the check refused the controller for good, and in a round it had no place."""
    compiler = room / "cc"
    compiler.write_text(f"#!/bin/sh\n{script}\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    file = room / "own.fmu"
    file.write_bytes(described(fmus.edited(), **{"sources/model.c": b""})(good))
    assert refusal(open_archive, file, kind=kind).what in ("not-compiled", "bad-sources")


@pytest.mark.needs("bubblewrap")
def test_a_disk_that_is_full_for_a_library_is_no_fault_of_the_sources(good, room, monkeypatch):
    monkeypatch.setattr(compilation, "HANDED_OUT", compilation.HANDED_OUT.replace('"$0.out"', "/dev/full"))
    file = room / "own.fmu"
    file.write_bytes(described(fmus.edited(), **{"sources/model.c": b"int x;\n"})(good))
    assert refusal(open_archive, file, kind=EnvironmentFault).what == "not-compiled"


@pytest.mark.needs("bubblewrap")
def test_a_compiler_beside_a_private_folder_shows_the_fmu_alone(tmp_path, monkeypatch):
    """All around it was shown, by its own path and by that of a link: <X>/service with <X>/bin/cc."""
    around, link = tmp_path / "around", tmp_path / "link"
    private, compiler = around / "service", around / "bin" / "cc"
    output = private / "cache" / "fmus" / "own" / "scratch" / "library.so"
    for file in (private / "service.sqlite", private / "cache" / "fmus" / "other" / "source.c", compiler):
        file.parent.mkdir(parents=True)
        file.write_text("secret")
    compiler.chmod(0o755)
    output.parent.mkdir(parents=True)
    (output.parents[1] / "source.c").write_text("own")
    link.symlink_to(around)
    monkeypatch.setenv(PRIVATE, str(private))
    words = compilation._fence(output, [str(link / "bin" / "cc")], zig=False)
    script = f"cat {compiler} $(find {around}/service {link}/service -type f)"
    seen = subprocess.run([*words, "sh", "-c", script, str(output)], check=False, capture_output=True, text=True)
    assert seen.stdout == "secretown", "the compiler, and the source"


def test_a_library_for_another_processor_is_told(tmp_path):
    """The loader says that a file is missing, for a file that is there."""
    other = replace(descriptions.archive(), folder=tmp_path)
    other.library_file.parent.mkdir(parents=True)
    machine = {"x86_64": 183}.get(platform.machine(), 62)  # that of arm64, elsewhere that of x86-64
    other.library_file.write_bytes(b"\x7fELF" + bytes(14) + machine.to_bytes(2, "little") + bytes(44))
    error = load_refusal(other, OSError("x.so: cannot open shared object file: No such file or directory"))
    assert isinstance(error, InputError) and "another kind of processor" in str(error)


@pytest.mark.parametrize(("size", "said"), [("9", "that does not exist"), ("1", "without a start value")])
def test_an_array_whose_size_is_nowhere_is_told(size, said, room):
    variables = (
        '<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed"/>'
        f'<Float64 name="q_m" valueReference="2" causality="input"><Dimension valueReference="{size}"/></Float64>'
    )
    text = f'<fmiModelDescription fmiVersion="3.0" modelName="x" instantiationToken="x"><ModelVariables>{variables}'
    file = room / "sizes.fmu"
    file.write_bytes(pack({"modelDescription.xml": f"{text}</ModelVariables></fmiModelDescription>".encode()}))
    error = refusal(open_archive, file)
    assert error.what == "bad-description" and f"the size of q_m is a variable {said}" in str(error)


@pytest.mark.parametrize(
    ("sizes", "said"), [((10**6, 1), "have 1000001 elements"), ((5 * 10**8, -5 * 10**8), "a negative size")]
)
def test_arrays_larger_than_memory_are_refused(sizes, said, room):
    """Where one of a negative size was taken off the sum, the other was made."""
    variables = "".join(
        f'<Float64 name="a{size}" valueReference="{reference}" causality="local"><Dimension start="{size}"/></Float64>'
        for reference, size in enumerate(sizes)
    )
    text = f'<fmiModelDescription fmiVersion="3.0" modelName="x" instantiationToken="x"><ModelVariables>{variables}'
    end = "</ModelVariables><CoSimulation modelIdentifier='x'/></fmiModelDescription>"
    file = room / "arrays.fmu"
    file.write_bytes(pack({"modelDescription.xml": (text + end).encode()}))
    error = refusal(open_archive, file)
    assert error.what == "bad-description" and said in str(error)
