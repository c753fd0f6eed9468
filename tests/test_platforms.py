"""Binaries for other platforms: built where the package ziglang is installed, and run where that is possible.

Linux on x86-64 is run here and Windows under wine; what is for macOS and for Linux on arm64 is linked, and not run.
"""

import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from support.targets import wine_prefix

import build_fmus
from controller_fmu import errors
from controller_fmu.export import FMI_HEADERS, platforms

DRIVER = Path(__file__).parent / "stubs" / "drive_plant.c"
STEPS = 4000

slow = pytest.mark.slow  # the first binary for a platform compiles that platform's C library, for minutes on Windows


@pytest.fixture(scope="module")
def everywhere(fmu_folder):
    """The native plant for all platforms: an FMU of FMI 2, and one of FMI 3."""
    folder = fmu_folder / "everywhere"
    folder.mkdir()
    names = ("FlexibleManipulatorNative", "FlexibleManipulatorNative_fmi3")
    return [build_fmus.build(name, folder, tuple(build_fmus.PLATFORMS)) for name in names]


def listed_binaries(fmu):
    with zipfile.ZipFile(fmu) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name.startswith("binaries/")}


def kind(library):
    """Format and processors of a library by its first bytes."""
    if library[:4] == b"\x7fELF":
        return "ELF", {62: "x86_64", 183: "aarch64"}[struct.unpack_from("<H", library, 18)[0]]
    if library[:2] == b"MZ":
        header = struct.unpack_from("<I", library, 60)[0]
        return "PE", {0x8664: "x86_64"}[struct.unpack_from("<H", library, header + 4)[0]]
    if library[:4] == b"\xca\xfe\xba\xbe":
        count = struct.unpack_from(">I", library, 4)[0]
        places = [struct.unpack_from(">IIIII", library, 8 + 20 * part) for part in range(count)]
        return "universal", *(kind(library[start : start + size]) for _, _, start, size, _ in places)
    assert library[:4] == b"\xcf\xfa\xed\xfe"
    return "Mach-O", {0x01000007: "x86_64", 0x0100000C: "aarch64"}[struct.unpack_from("<I", library, 4)[0]]


@pytest.mark.needs("ziglang")
@slow
def test_one_fmu_has_binaries_for_all(everywhere):
    first, second = (
        {path.split("/")[1]: kind(library) for path, library in listed_binaries(fmu).items()} for fmu in everywhere
    )
    assert first == {
        "linux64": ("ELF", "x86_64"),
        "aarch64-linux": ("ELF", "aarch64"),
        "win64": ("PE", "x86_64"),
        "darwin64": ("universal", ("Mach-O", "x86_64"), ("Mach-O", "aarch64")),
        "aarch64-darwin": ("Mach-O", "aarch64"),
    }
    formats = {"linux": "ELF", "windows": "PE", "darwin": "Mach-O"}
    assert second == {name: (formats[name.split("-")[1]], name.split("-")[0]) for name in build_fmus.PLATFORMS}


@pytest.mark.needs("ziglang")
@slow
def test_its_bytes_are_the_same_every_time(everywhere, tmp_path):
    again = build_fmus.build(everywhere[0].stem, tmp_path, tuple(build_fmus.PLATFORMS))
    assert again.read_bytes() == everywhere[0].read_bytes()


def driven(fmu, platform, folder, *runner, environment=None):
    """What the driver, compiled for ``platform``, prints of the binary for it; in columns q_m, q_a, X."""
    folder.mkdir()
    program = folder / "drive.exe"
    command = [
        *platforms.cross_compilers((platform,))[platform],
        "-O1",
        f"-I{FMI_HEADERS}",
        "-o",
        program,
        DRIVER,
        "-ldl",
    ]
    subprocess.run(command if "linux" in platform else command[:-1], check=True)
    library = folder / f"plant{platforms.PLATFORMS[platform].suffix}"
    library.write_bytes(
        listed_binaries(fmu)[f"binaries/{platforms.PLATFORMS[platform].folders[0]}/{fmu.stem}{library.suffix}"]
    )
    guid = fmpy.read_model_description(str(fmu)).guid
    finished = subprocess.run(
        [*runner, program, library.name if runner else library, guid, str(STEPS)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return np.array([[float.fromhex(word) for word in line.split()] for line in finished.stdout.splitlines()])


@pytest.mark.needs("ziglang", "wine", "x86_64-linux")
@slow
def test_the_windows_binary_moves_as_the_linux_one(everywhere, tmp_path):
    linux = driven(everywhere[0], "x86_64-linux", tmp_path / "linux")
    with wine_prefix() as environment:
        windows = driven(everywhere[0], "x86_64-windows", tmp_path / "windows", "wine", environment=environment)
    assert windows.shape == linux.shape == (STEPS, 6)
    assert np.ptp(linux[:, 4:], axis=0).min() > 0.05, "the tool moves"
    np.testing.assert_array_equal(windows, linux)


@pytest.mark.needs("ziglang", "x86_64-linux")
@slow
def test_zig_gives_the_bits_of_this_machines_compiler(everywhere, native_plant_file, tmp_path):
    by_zig = driven(everywhere[0], "x86_64-linux", tmp_path / "zig")
    np.testing.assert_array_equal(driven(native_plant_file, "x86_64-linux", tmp_path / "own"), by_zig)


def test_without_the_package_the_reason_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    with pytest.raises(errors.NoCompilerError) as refused:
        build_fmus.build("FlexibleManipulatorNative", tmp_path, ["x86_64-windows"])
    assert (refused.value.value, refused.value.remedy) == ("ziglang", platforms.REMEDY)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.needs("ziglang")
def test_folders_of_fmi_2_are_names_of_platforms_too():
    assert list(platforms.cross_compilers(["win64"])) == ["x86_64-windows"]
    assert list(platforms.cross_compilers(["darwin64", "x86_64-darwin"])) == ["x86_64-darwin", "aarch64-darwin"]


def test_an_unknown_platform_is_refused(tmp_path, capsys):
    with pytest.raises(errors.PlatformError) as refused:
        build_fmus.build("FlexibleManipulatorNative", tmp_path, ["amiga"])
    assert refused.value.value == "amiga" and "x86_64-windows" in refused.value.nearest
    command = ["FlexibleManipulatorNative", "--platforms", "x86_64-linux,amiga", "--output-dir", str(tmp_path)]
    assert build_fmus.main(command) == 2 and "amiga" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_ziglang_is_the_compiler_of_last_resort(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    assert build_fmus.find_compiler() is None
    monkeypatch.setattr(platforms, "find_spec", lambda name: object())
    command = build_fmus.find_compiler()
    assert command[:4] == [sys.executable, "-m", "ziglang", "cc"] and command[4] == "-target"


def test_parts_of_a_universal_file_begin_at_pages():
    parts = [struct.pack("<III", 0xFEEDFACF, kind, 3) + bytes(length) for kind, length in ((7, 5), (12, 70000), (9, 1))]
    whole = platforms.universal(parts)
    table = [struct.unpack_from(">IIIII", whole, 8 + 20 * part) for part in range(3)]
    assert [place[:2] for place in table] == [(7, 3), (12, 3), (9, 3)]
    assert [whole[start : start + size] for _, _, start, size, _ in table] == parts
    assert all(start % 2**14 == 0 and 1 << power == 2**14 for *_, start, _, power in table)
