"""Whole closed loops have the same bits on all platforms: one program in C, compiled for each and run where possible.

The program has the plant, the imperfections and several controllers, made of the FMUs' sources. It is compared with the
master loop on this machine, and its judging with the one in Python. Where only compilation is possible, that is done.
"""

from dataclasses import replace
from fractions import Fraction

import pytest
from support.one_program import LINEAR, answer, block_of, hash_of, program_input, rewritten, same, write_program
from support.targets import TARGETS, compile_program, run_program, wine_prefix
from support.tools import require

from controller_fmu.export.one_program import CONTROLLERS, IMPERFECTIONS, PLANT
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
def program(tmp_path_factory):
    """The program's sources."""
    return write_program(tmp_path_factory.mktemp("program"))


@pytest.fixture(scope="module")
def loops(program):
    """The program's input, and what the master loop gives for it."""
    blocks, wanted = [], []
    for name in CONTROLLERS:
        controller = Controller(program.files[name])
        for case in CASES:
            trajectory = BENCH.simulate(controller, case).trajectory
            assert len(trajectory.command) == case.scenario.samples
            blocks.append(block_of(program, name, BENCH, case))
            wanted.append(hash_of(trajectory, case.scenario))
    assert len(set(wanted)) == len(wanted)
    return program_input(blocks), wanted


def found(name, program, text, product="program.exe"):
    """What the program answers on a target."""
    target = TARGETS[name]
    (program.folder / "loops.txt").write_text(text)
    built = compile_program(target, program.sources, program.folder, product)
    if "wine" in target.needs:
        with wine_prefix() as environment:
            lines = run_program(target, built, program.folder / "loops.txt", environment)
    else:
        lines = run_program(target, built, program.folder / "loops.txt")
    return [answer(line) for line in lines]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.needs(*target.needs), *(() if name in OFTEN else [slow])])
        for name, target in TARGETS.items()
        if target.runner is not None
    ],
)
def test_the_program_has_the_bits_of_the_master_loop(name, program, loops):
    text, wanted = loops
    assert [one.hash for one in found(name, program, text, f"{name}.exe")] == wanted


@slow
@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if target.runner is None])
def test_it_compiles_for_other_systems(name, program):
    require(*TARGETS[name].needs)
    assert (
        compile_program(TARGETS[name], program.sources, program.folder, f"{name}.out").read_bytes()[:4]
        == b"\xcf\xfa\xed\xfe"
    )


JUDGED = (*CONTROLLERS, LINEAR)


def judged(name, program, protocol, controllers):
    """The cases of a protocol that a target's program judges otherwise than Python, and how many there are."""
    benchmark, cases, blocks = Benchmark(protocol, plant="native"), [], []
    for controller in controllers:
        results = benchmark.evaluate(Controller(program.files[controller])).results
        for case in benchmark.cases:
            cases.append((controller, case.id, results.case(case.id).judgement))
            blocks.append(block_of(program, controller, benchmark, case))
    answers = found(name, program, program_input(blocks), f"{name}.judged.exe")
    pairs = zip(answers, cases, strict=True)
    return [(*case, one) for one, case in pairs if not same(one, case[2], benchmark)], len(cases)


@pytest.mark.slow
@pytest.mark.needs("ziglang", "node")
def test_cases_are_judged_in_webassembly_as_in_python(program):
    wrong, count = judged("wasm32", program, "quick", JUDGED)
    assert not wrong and count == 96


LAST_OF_SINE = "*cosine = elementary_number(c ^ other ^ ((quarter + 1) & 2) << 62);"
FLAWS = {
    "a-last-bit-in-the-sine": (PLANT, "elementary.h", "-0.16666666666666666", "-0.16666666666666669"),
    "the-library's-in-the-plant": (PLANT, "elementary.h", LAST_OF_SINE, "*sine = sin(x); *cosine = cos(x);"),
    "the-library's-in-the-chirp": (IMPERFECTIONS, "model.c", "elementary_sin(2.0", "sin(2.0"),
}
"""FMU, file, text and what takes its place."""


@pytest.mark.needs("gcc")
@pytest.mark.parametrize("flaw", FLAWS)
def test_a_change_of_a_last_bit_is_seen(flaw, program, loops, tmp_path):
    part, file, text, other = FLAWS[flaw]
    copy = rewritten(program, tmp_path)
    spoilt = tmp_path / part / file
    assert text in spoilt.read_text(encoding="utf-8")
    spoilt.write_text(spoilt.read_text(encoding="utf-8").replace(text, other, 1), encoding="utf-8")
    given, wanted = loops
    pairs = zip(found("gcc-O0", copy, given), wanted, strict=True)
    differs = [here.hash != there for here, there in pairs]
    assert all(differs[0::3]) and all(differs[1::3])  # the cases with a chirp and a force from the start
