"""Whole closed loops have the same bits on all platforms: one program in C, compiled for each and run where possible.

The program has the plant, the imperfections and three controllers, made of the FMUs' sources. What it is compared with
is the master loop on this machine. Where only compilation is possible, that is done.
"""

from dataclasses import replace
from fractions import Fraction

import pytest
from support.one_program import CONTROLLERS, PARTS, hash_of, loop_of, program_input, write_sources
from support.targets import TARGETS, compile_program, run_program, wine_prefix
from support.tools import require

import build_fmus
from orchestrator import Benchmark, Controller
from orchestrator.loop.scenario import Chirp, Drive, Noise, Pulse, Sensor

pytestmark = pytest.mark.needs("compiler")

MS = Fraction(1, 1000)
BENCH = Benchmark(plant="native")
CASE = BENCH.case("c07.random_1.gain_1")
EVERYTHING = replace(
    CASE.scenario,
    duration=Fraction(1, 2),
    sensor=Sensor(Noise(1e-4, (3, 1)), (MS / 2, Fraction(0)), 1e-4),
    drive=Drive((1.4, 0.9), (1.8, 0.2), (0.02, 0.01), (MS / 4, 2 * MS)),
    chirp=Chirp((1.0, -1.0), 0.05, 0.4, 1.0, 15.0),
    pulse=Pulse((60.0, -90.0), 0.1, 0.2),
)
"""Noise, quantization, delays, gain, saturation, chirp and force."""

SPLIT = replace(EVERYTHING, drive=replace(EVERYTHING.drive, delay=(MS / 8, 2 * MS)))
"""With two steps of the plant in a sample."""

LONG = BENCH.case("c03.compliant.disturbance")
CASES = (
    replace(CASE, scenario=EVERYTHING),
    replace(CASE, scenario=SPLIT),
    replace(LONG, scenario=replace(LONG.scenario, duration=Fraction(7))),
)

slow = pytest.mark.slow
OFTEN = ("gcc-O0", "clang-O0")
"""Compiled in seconds; the others are slow."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The FMUs by name."""
    folder = tmp_path_factory.mktemp("parts")
    return {name: build_fmus.build(name, folder) for name in PARTS}


@pytest.fixture(scope="module")
def loops(files):
    """The program's input, and what the master loop gives for it."""
    given, wanted = [], []
    for name in CONTROLLERS:
        controller = Controller(files[name])
        for case in CASES:
            trajectory = BENCH.simulate(controller, case).trajectory
            assert len(trajectory.command) == case.scenario.samples
            given.append(loop_of(BENCH, name, controller, case, case.scenario.samples))
            wanted.append(hash_of(trajectory, case.scenario))
    assert {loop.ticks for loop in given} == {1, 2} and len(set(wanted)) == len(wanted)
    return program_input(given, files), wanted


@pytest.fixture(scope="module")
def sources(files, tmp_path_factory):
    """The folder of the program's sources, and their names."""
    folder = tmp_path_factory.mktemp("program")
    return folder, write_sources(files, folder)


def found(name, sources, loops, program="program.exe"):
    """The hashes that the program gives on a target."""
    folder, names = sources
    target = TARGETS[name]
    (folder / "loops.txt").write_text(loops[0])
    built = compile_program(target, names, folder, program)
    if "wine" in target.needs:
        with wine_prefix() as environment:
            return run_program(target, built, folder / "loops.txt", environment)
    return run_program(target, built, folder / "loops.txt")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.needs(*target.needs), *(() if name in OFTEN else [slow])])
        for name, target in TARGETS.items()
        if target.runner is not None
    ],
)
def test_the_program_has_the_bits_of_the_master_loop(name, sources, loops):
    assert found(name, sources, loops, f"{name}.exe") == loops[1]


@slow
@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if target.runner is None])
def test_it_compiles_for_other_systems(name, sources):
    require(*TARGETS[name].needs)
    folder, names = sources
    assert compile_program(TARGETS[name], names, folder, f"{name}.out").read_bytes()[:4] == b"\xcf\xfa\xed\xfe"


LAST_OF_SINE = "*cosine = elementary_number(c ^ other ^ ((quarter + 1) & 2) << 62);"
FLAWS = {
    "a-last-bit-in-the-sine": (PARTS[0], "elementary.h", "-0.16666666666666666", "-0.16666666666666669"),
    "the-library's-in-the-plant": (PARTS[0], "elementary.h", LAST_OF_SINE, "*sine = sin(x); *cosine = cos(x);"),
    "the-library's-in-the-chirp": (PARTS[1], "model.c", "elementary_sin(2.0", "sin(2.0"),
}
"""FMU, file, text and what takes its place."""


@pytest.mark.needs("gcc")
@pytest.mark.parametrize("flaw", FLAWS)
def test_a_change_of_a_last_bit_is_seen(flaw, files, loops, tmp_path):
    part, file, text, other = FLAWS[flaw]
    names = write_sources(files, tmp_path)
    spoilt = tmp_path / part / file
    assert text in spoilt.read_text(encoding="utf-8")
    spoilt.write_text(spoilt.read_text(encoding="utf-8").replace(text, other, 1), encoding="utf-8")
    pairs = zip(found("gcc-O0", (tmp_path, names), loops), loops[1], strict=True)
    differs = [here != there for here, there in pairs]
    assert all(differs[0::3]) and all(differs[1::3])  # the cases with a chirp and a force from the start
