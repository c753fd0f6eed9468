"""The texts of errors: one of each code, as a user reads it, in ``snapshots/messages.txt``.

Other tests assert codes and fields. After a change of words, look at the difference that ``REFRESH=1 python -m pytest
tests/test_error_texts.py`` makes to the file.
"""

import ast
import re
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import fmpy
import pytest
from fmpy.model_description import BaseUnit, Unit
from support.closed_loops import PAPER
from support.descriptions import T_S, archive, description, pair, usual, variable
from support.refusals import refusal
from support.snapshots import snapshot
from test_draws import ROUND

import orchestrator
from controller_fmu.export.archive import pack
from orchestrator.benchmark import cases, draws, linearization, protocol, variation
from orchestrator.cli.guard import REMEDIES, remedy
from orchestrator.fmi import controller_files
from orchestrator.fmi.archive import Archive, open_archive
from orchestrator.fmi.connectors import bind_controller
from orchestrator.fmi.lookup import elements, find_outputs, find_values
from orchestrator.fmi.slaves.base import refusal as load_refusal
from orchestrator.fmi.variables import conversion
from orchestrator.loop import sampling, setup
from orchestrator.loop import scenario as scenarios
from orchestrator.loop.scenario import NO_DELAY, Recurrence, Scenario
from plant_fmu.flexible_manipulator.parameters import NOMINAL

WHERE = "The controller x.fmu"
NAMED = description(
    [variable("K", "parameter", size=2), variable("n", "parameter", kind="Integer"), variable("y", "output")]
)
XML = b"""<fmiModelDescription fmiVersion="%s" modelName="x" guid="x">%s
<ModelVariables/><ModelStructure/></fmiModelDescription>"""


def bound(shown, mapping=None) -> Callable[[], object]:
    return lambda: bind_controller(shown, WHERE, mapping)


def unit(name: str, *definitions: Unit) -> Callable[[], object]:
    return lambda: conversion(description([], definitions), name, "rad", f"{WHERE}: q_m[1]")


def with_parameters(*names: str, causality: str = "parameter") -> Archive:
    shown = usual(*(variable(name, causality) for name in names))
    return Archive(Path("x.fmu"), "", Path("."), shown, "CoSimulation")


def opened(folder: Path, contents: dict[str, bytes] | bytes) -> Callable[[], object]:
    def attempt() -> object:
        (folder / "x.fmu").write_bytes(contents if isinstance(contents, bytes) else pack(contents))
        return open_archive(folder / "x.fmu")

    return attempt


def read(folder: Path, name: str, text: str) -> Callable[[], object]:
    def attempt() -> object:
        (folder / name).write_text(text)
        if text.startswith("[parameters]") or name == "gains.toml":
            return controller_files.read_parameters(folder / name, with_parameters())
        return controller_files.read_mapping(folder / name)

    return attempt


def not_loaded(folder: Path, sources: bool) -> Callable[[], object]:
    """A binary that was built for a newer system, in an FMU with or without sources."""

    def attempt() -> object:
        (folder / "sources").mkdir(exist_ok=True)
        if sources:
            (folder / "sources" / "x.c").write_text("")
        said = OSError("libm.so.6: version `GLIBC_2.99' not found (required by x.so)")
        raise load_refusal(replace(archive(), folder=folder if sources else folder / "resources"), said)

    return attempt


def refused(folder: Path) -> tuple[Callable[[], object], ...]:
    """What is refused: one attempt per code."""
    empty = Scenario((), Fraction(1), T_S)
    sound = XML % (b"2.0", b'<CoSimulation modelIdentifier="X"/>')
    started = b'<ModelVariables><ScalarVariable name="p" valueReference="0"><Real start="much"/></ScalarVariable>'
    return (
        lambda: open_archive(folder / "absent.fmu"),
        opened(folder, b"text"),
        opened(folder, {"modelDescription.xml": sound.replace(b'"X"', b'"../X"')}),
        opened(folder, {"modelDescription.xml": sound, "../outside": b""}),
        opened(folder, {"modelDescription.xml": sound, **{f"resources/{i}": b"" for i in range(10_001)}}),
        opened(folder, {"modelDescription.xml": XML % (b"2.0", b"")}),
        opened(folder, {"modelDescription.xml": sound}),
        opened(folder, {"modelDescription.xml": sound, "sources/x.h": b""}),
        opened(folder, {"modelDescription.xml": sound.replace(b"<ModelVariables>", started)
               .replace(b"<ModelVariables/>", started + b"</ModelVariables>")}),
        opened(folder, {"modelDescription.xml": sound.replace(b'"X"', b'"X" needsExecutionTool="true"'),
                        "binaries/win64/X.dll": b""}),
        read(folder, "names.toml", "[map]\nq_m = 1"),
        read(folder, "names.ssm", "<open>"),
        read(folder, "gains.toml", "K_p = 1"),
        bound(usual(*pair(["In1", "In2"]), without="q_m")),
        bound(usual(*pair(["a.q_m_1", "a.q_m_2", "b.q_m_1", "b.q_m_2"]), without="q_m")),
        bound(usual(variable("q_m_ref[1]"))),
        bound(usual(*pair(["q_m[1]", "q_m[2]"], "output"), without="q_m")),
        bound(usual(variable("q_m", size=3), without="q_m")),
        bound(usual(), {"q_n[1]": "In1"}),
        bound(usual(), {"q_m[1]": "In1"}),
        unit("m"),
        unit("furlong"),
        unit("x", Unit("x", BaseUnit(rad=1, factor=-1.0))),
        unit("x", Unit("x", BaseUnit(rad=1, offset=1.0))),
        lambda: find_values(NAMED, {"K_p": 1.0}, WHERE),
        lambda: find_values(NAMED, {"K": 1.0}, WHERE),
        not_loaded(folder, True),
        not_loaded(folder, False),
        lambda: find_values(NAMED, {"n": 1.5}, WHERE),
        lambda: elements({"K": [1.0, 2.0], "K[1]": 3.0}, NAMED, WHERE),
        lambda: find_values(NAMED, {"K[1]": "much"}, WHERE),
        lambda: find_values(NAMED, {"y": 1.0}, WHERE),
        lambda: sampling.controller_sample_time(archive(fixed="0.0005"), T_S, T_S),
        lambda: find_outputs(NAMED, ["x"], WHERE),
        lambda: scenarios.make_plan(T_S, (Fraction(1, 10**15 + 1), T_S), NO_DELAY),
        lambda: scenarios.make_plan(T_S, NO_DELAY, (T_S / 2, T_S), None, T_S * 3 / 4),
        lambda: sampling.controller_sample_time(archive(experiment="0.0003"), T_S),
        lambda: setup.controller_binding(
            with_parameters("u_m0[1]", "u_m0[2]"), setup.Setup({"u_m0[1]": 1.0})
        ),
        lambda: setup.sample_time_parameter(with_parameters("a.T_s", "b.T_s"), setup.Setup()),
        lambda: protocol.load("pepper"),
        lambda: protocol.load(folder / "names.toml"),
        lambda: PAPER.test("nois"),
        lambda: cases.case_named(PAPER, NOMINAL, 0, "c99.sticky.noise"),
        lambda: cases.case_named(PAPER, NOMINAL, 0, "c00.slimy.noise"),
        lambda: cases.configuration(PAPER, 4.0, 0.0),
        lambda: linearization.require_integrable({"d[1]": 1e12}, PAPER.uncertainty),
        lambda: linearization.check_changes({"m_3": 1.0}, PAPER.uncertainty),
        lambda: linearization.check_changes({"m[1]": float("inf")}, PAPER.uncertainty),
        lambda: variation.Variation(duration=Fraction(-1)),
        lambda: variation.Variation(angle_bits=99),
        lambda: variation.Variation(dropout=1.5),
        lambda: variation.vary(empty, PAPER, variation.Variation(force=1.0, t_2=1.0)),
        lambda: variation.vary(empty, PAPER, variation.Variation(phi_F=2e6)),
        lambda: variation.vary(
            replace(empty, again=Recurrence(4.0, 2)), PAPER, variation.Variation(force=1.0, chirp_amplitude=(1.0, 1.0))
        ),
        lambda: draws.from_beacon("2027-01-01", "2026-01-01"),
        lambda: draws.from_beacon(ROUND, "2027-01-01"),
        lambda: draws.from_beacon(ROUND, "yesterday"),
    )  # fmt: skip


@pytest.mark.needs("compiler")
def test_texts_are_those_of_the_snapshot(tmp_path, monkeypatch):
    monkeypatch.setenv("FLEXIBLE_MANIPULATOR_CACHE", str(tmp_path / "cache"))
    found: dict[str, str] = {}
    for attempt in refused(tmp_path):
        error = refusal(attempt)
        assert error.what not in found, error.what
        text = str(error) if not remedy(error) else f"{error}\n    {remedy(error)}"
        text = text.replace(str(tmp_path), "FOLDER").replace(fmpy.platform, "PLATFORM")
        found[error.what] = re.sub(r"Premature end.*", "(libxml's words)", text)
    told = "".join(f"{what}\n    {text}\n\n" for what, text in sorted(found.items()))
    assert told == snapshot("messages.txt", told)
    assert lower_codes() - set(found) <= SEEN_ELSEWHERE, "every code of the lower rooms has its text in the snapshot"


SEEN_ELSEWHERE = {
    *("bad-file-name", "cannot-extract", "no-compiler", "no-sandbox", "no-variable", "no-wine", "wrong-signature"),
}
"""Codes whose texts name what differs from machine to machine, or that need an odd one; tested with their rooms."""


def lower_codes() -> set[str]:
    """The codes of all errors that the rooms below the execution raise."""
    codes = set()
    for name in ("fmi", "loop", "benchmark", "conformance"):
        for file in (Path(orchestrator.__file__).parent / name).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("InputError", "unknown", "refused"):
                    assert len(node.args) > 1, f"{file}:{node.lineno} has no code"
                    codes |= {a.value for a in node.args[1:2] if isinstance(a, ast.Constant)}
    return codes


@pytest.mark.parametrize("what", REMEDIES)
def test_remedies_can_be_formatted(what):
    class Problem:
        value, nearest = "q_m", ("a.q_m[1]",)

    Problem.what = what
    assert remedy(Problem()) and "{" not in remedy(Problem())
