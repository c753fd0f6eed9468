"""Figures over several controllers for a paper: what they show, and that a controller looks the same everywhere."""

import colorsys
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.text import Text
from msgspec.structs import replace
from support.command_lines import Finished, call
from support.refusals import refusal
from support.reports import hunted, recording, scaled, seeded, stored
from support.tools import LATEX

from orchestrator.cli import finished
from orchestrator.documents import compare_page
from orchestrator.documents.comparison import Comparison, grouped
from orchestrator.documents.comparison_figures import CAPTIONS, Paper, Sheet, drawn, sheets, write_comparison
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.robustness import Robustness
from orchestrator.views.drawing import PALETTE
from orchestrator.views.plot import HUES, Bars, Line, Plot, Scatter, dash, hue, shape

STYLES = Path(compare_page.__file__).parents[1] / "views" / "templates" / "style.css"

GAINS = {"b": 1.2, "a": 0.8, "c": 1.0}
"""Three controllers in the order in which they are given; in the leaderboard, a is first, and b is last."""


def file_of(name: str) -> dict[str, str]:
    return {"file": f"{name}.fmu", "sha256": name * 64}


def evaluation(name: str) -> Evaluation:
    gain = GAINS[name]
    return Evaluation(scaled(gain, controller=file_of(name)), (recording(("example",), size=gain * 8e-3),))


def search(name: str) -> Robustness:
    """A search that found V of 1.2 times the paper's; its parts are the shares of the criteria."""
    found = hunted(**file_of(name), parameters={"K": GAINS[name]})[0]
    parts = [found.rules.criteria[key].weight * each.value / found.rules.criteria[key].target
             for key, each in found.criteria.items()]  # fmt: skip
    return replace(found, cost=sum(parts))


def everything() -> Comparison:
    """Documents of three kinds, each kind with other controllers, and in another order."""
    spreads = [seeded(GAINS[name], range(3), **file_of(name)) for name in "ca"]
    searches = [search(name) for name in "cb"]
    return grouped([(one, None) for one in (*map(evaluation, GAINS), *spreads, *searches)])


def plots(part: Any) -> Iterator[Plot]:
    """All plots of a page, also those of choices."""
    if isinstance(part, Plot):
        yield part
    elif isinstance(part, list | tuple):
        for one in part:
            yield from plots(one)
    elif hasattr(part, "__dataclass_fields__") or hasattr(part, "_fields"):
        yield from plots([getattr(part, name) for name in getattr(part, "__dataclass_fields__", part)])


def all_sheets(compared: Comparison, columns=None, cases=None) -> list[Sheet]:
    return [sheet for found in sheets(compared.first, columns, cases or {}).values() for sheet in found]


def test_a_controller_has_one_colour_one_line_and_one_symbol_on_every_page_and_in_every_figure():
    """Those of its place among all that are compared, whatever its rank, and whichever kinds of results it has."""
    compared = everything()
    assert [entry.controller[0] for entry in compared[0].entries] == ["a", "c", "b"]
    places = {name: place for place, name in enumerate(GAINS)}
    shown = {"page": list(plots(compared.page().panels))}
    shown |= {sheet.name: [plot for row in sheet.rows for plot in row] for sheet in all_sheets(compared)}
    for where, drawings in shown.items():
        seen = set()
        for series in (one for plot in drawings for one in plot.series):
            named = re.match(r"(?:\d\. )?([abc])\b", series.name)
            if named is None:
                continue
            seen.add(named[1])
            place = places[named[1]]
            assert series.colour == hue(place), (where, series.name)
            if isinstance(series, Line):
                assert series.dash == dash(place), (where, series.name)
            if isinstance(series, Scatter) and series.symbol not in ("left", "right"):
                assert series.symbol == shape(place), (where, series.name)
        expected = {"V_by_criteria": "", "V_and_criteria_over_seeds": "ac", "margins_of_gain_and_delay": "bc"}
        assert seen == set(expected.get(where, "bc" if where == "V_and_tolerances" else "abc")), where


def test_many_controllers_differ_in_colour_or_line_and_neighbours_in_both():
    looks = [(hue(number), dash(number)) for number in range(24)]
    assert len(set(looks)) == len(looks)
    assert len({(hue(number), shape(number)) for number in range(24)}) == 24
    assert all(one[0] != other[0] and one[1] != other[1] for one, other in zip(looks, looks[1:], strict=False))


def test_pages_have_the_colours_of_the_figures_on_light_and_on_dark_ground():
    def tone(colour: str) -> float:
        return colorsys.rgb_to_hsv(*(int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)))[0]

    style = STYLES.read_text(encoding="utf-8")
    for name in HUES:
        light, dark = re.search(rf"--{name}: light-dark\((#\w{{6}}), (#\w{{6}})\);", style).groups()
        for ground, colour in (("light", light), ("dark", dark)):
            apart = abs(tone(colour) - tone(PALETTE[name]))
            assert min(apart, 1 - apart) < 0.06, (name, ground)


def test_v_found_stands_beside_v_of_the_same_controller_in_the_same_parts():
    sheet = all_sheets(everything())[0]
    ((plot,),) = sheet.rows
    stacks: dict[str, list[Bars]] = {}
    for bars in plot.series:
        stacks.setdefault(bars.stack, []).append(bars)
    assert [name[0] for name in plot.names] == ["a", "c", "b"] and set(stacks) == {"V", "found"}
    for name, bars in stacks.items():
        assert [each.name for each in bars] == ["B1", "B2", "B3", "B4", "B5", "B6", "B7"]
        assert {each.hatched for each in bars} == {name == "found"}
    sums = {name: np.sum([[value or 0.0 for value in each.values] for each in bars], axis=0)
            for name, bars in stacks.items()}  # fmt: skip
    np.testing.assert_allclose(sums["V"], [GAINS[name] * 140.7324 for name in "acb"], rtol=1e-4)
    found = search("b").cost
    np.testing.assert_allclose(sums["found"], [0.0, found, found])
    assert stacks["found"][-1].labels == ("", f"{found:.1f}", f"{found:.1f}")
    drawings = drawn(sheet, (3.5, 7.16)).axes[0].containers
    for bars, name in ((drawings[6], "V"), (drawings[13], "found")):
        np.testing.assert_allclose([bar.get_x() + bar.get_width() for bar in bars], sums[name], err_msg=name)
    (alone,) = all_sheets(grouped([(evaluation("a"), None), (search("b"), None)]))[:1]
    assert {bars.stack for bars in alone.rows[0][0].series} == {"V"}, "of another controller"


@pytest.mark.parametrize(("columns", "names"), [(None, 5), (1, 6), (2, 5)])
def test_figures_have_the_widths_of_the_paper_and_letters_of_8_points(columns, names):
    made = all_sheets(everything(), columns)
    assert len(made) == names
    for sheet in made:
        figure = drawn(sheet, (3.0, 6.5))
        figure.canvas.draw()
        assert figure.get_figwidth() == (3.0, 6.5)[sheet.columns - 1]
        assert columns in (None, sheet.columns)
        sizes = {text.get_fontsize() for text in figure.findobj(Text) if text.get_text().strip()}
        assert sizes == {8.0}, sheet.name
        frame = figure.bbox
        for text in figure.findobj(Text):
            if text.get_text().strip() and text.get_visible() and text.get_window_extent().width:
                box = text.get_window_extent()
                inside = frame.x0 - 1 <= box.x0 and box.x1 <= frame.x1 + 1
                assert inside or text.get_clip_on(), (sheet.name, text.get_text())


def test_a_case_is_drawn_as_in_figures_9_to_12_and_its_caption_has_units_and_system():
    compared = everything()
    for system in ("nominal", "compliant"):
        recorded = [(entry, recording((), system=system)) for entry in compared[0].entries]
        (sheet,) = sheets(compared.first, None, {"c07.x.disturbance": recorded})["time_c07-x-disturbance"]
        assert [[plot.y.heading for plot in row] for row in sheet.rows] == [
            ["TCP error [mm]"] * 2, ["Torque u_m1 [Nm]"] * 2, ["Torque u_m2 [Nm]"] * 2
        ]  # fmt: skip
        assert [plot.window.x for plot in sheet.rows[0]] == [(0.0, 10.0), (9.8, 13.5)]
        (target,) = sheet.rows[0][1].levels
        assert target.value == 7e-3 and "B7 (0.5 mm) and of B5 (7 mm)" in sheet.caption
        assert "error [mm] and motor torques [Nm] over time [s]" in sheet.caption
        assert ("nominal system" if system == "nominal" else "system compliant") in sheet.caption
        narrow = sheets(compared.first, 1, {"c07.x.disturbance": recorded})["time_c07-x-disturbance"]
        assert [one.name[-5:] for one in narrow] == ["chirp", "force"] and [len(one.rows) for one in narrow] == [3, 3]
    judged = [(entry, recording((), test="gain_1")) for entry in compared[0].entries]
    (sheet,) = sheets(compared.first, None, {"x": judged})["time_x"]
    assert [plot.window.x for plot in sheet.rows[0]] == [(9.8, 13.5), (23.0, 26.0)]
    still = [(entry, recording((), test="noise", force=(0.0, 0.0))) for entry in compared[0].entries]
    (sheet,) = sheets(compared.first, None, {"x": still})["time_x"]
    assert [plot.window.x for plot in sheet.rows[0]] == [(0.0, 26.0)] and "Dashed" not in sheet.caption


def test_files_are_what_journals_accept_and_have_the_bytes_of_the_first_time(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        written, missing = write_comparison(everything().first, folder)
    assert missing == [] and written[-1] == CAPTIONS
    for file in first.iterdir():
        assert file.read_bytes() == (second / file.name).read_bytes(), file.name
    for name in written[:-1]:
        pdf = (first / f"{name}.pdf").read_bytes()
        assert b"/Type3" not in pdf and b"/FontFile2" in pdf, "fonts are embedded as outlines, not as bitmaps"
        assert "<text" in (first / f"{name}.svg").read_text(encoding="utf-8"), "text can be searched and edited"
        assert "." not in name, "which LaTeX would take for an ending"


@pytest.mark.needs("latex")
@pytest.mark.parametrize("options", ["", "twocolumn"])
def test_the_captions_compile_in_documents_of_one_and_of_two_columns(options, tmp_path):
    compared = everything()
    cases = {"c07.slippery.gain_1": [(entry, recording((), system="slippery_%#&")) for entry in compared[0].entries]}
    written, _ = write_comparison(compared.first, tmp_path, Paper((3.3, 6.9)), cases)
    head = rf"\documentclass[{options}]{{article}}\usepackage{{graphicx}}\begin{{document}}"
    names = written[:-1]
    references = " ".join(rf"\ref{{fig:{name.replace('_', '-')}}}" for name in names)
    (tmp_path / "paper.tex").write_text(rf"{head}{references}\input{{{CAPTIONS}}}\end{{document}}", encoding="utf-8")
    program = next(filter(None, map(shutil.which, LATEX)))
    quiet = ["-interaction=batchmode", "-halt-on-error"] if program.endswith("pdflatex") else ["--keep-logs"]
    for _ in range(2 if program.endswith("pdflatex") else 1):
        subprocess.run([program, *quiet, "paper.tex"], cwd=tmp_path, check=True, capture_output=True, timeout=120)
    log = (tmp_path / "paper.log").read_text(encoding="utf-8", errors="replace").replace("\n", "")
    assert "Overfull" not in log and "undefined" not in log
    assert all(f"{name}.pdf" in log for name in names)
    assert (tmp_path / "paper.pdf").read_bytes().startswith(b"%PDF")


def command(folder: Path, *options: object) -> Finished:
    return call("compare", *options, "--output-dir", folder / "out", folder=folder)


def test_the_command_writes_figures_and_refuses_what_no_figure_can_have(tmp_path):
    for name in GAINS:
        one = evaluation(name)
        stored(tmp_path / name, one.results, one.recordings)
    done = command(tmp_path, *GAINS, "--figures", "--widths", "90 mm,190mm", "--csv")
    assert done.code == 0 and "margins_of_gain_and_delay" in done.err and done.out.startswith("rank,controller,V,")
    for name, width in {"V_by_criteria": 90, "time_example": 190}.items():
        pdf = (tmp_path / "out" / "figures" / f"{name}.pdf").read_bytes()
        points = float(re.search(rb"/MediaBox \[ 0 0 ([0-9.]+) ", pdf)[1])
        assert points == pytest.approx(width / 25.4 * 72, abs=0.1), name
    for wrong in ("3.5in", "3.5in,7in,9in", "7in,3.5in", "0in,7in", "3.5,7", "3.5in,7000in", "-3in,7in", "nanin,7in"):
        assert command(tmp_path, "a", "--figures", f"--widths={wrong}").code == 2, wrong
    for alone in (("--widths", "3in,6in"), ("--columns", "1"), ("--case", "c07.compliant.disturbance")):
        assert "Give --figures too" in command(tmp_path, "a", *alone).err
    unknown = command(tmp_path, "a", "--figures", "--case", "c99.compliant.disturbance")
    assert unknown.code == 2 and "c99.compliant.disturbance" in unknown.err


@pytest.mark.slow
def test_a_case_that_was_not_recorded_is_simulated_as_it_was(quick, quick_folder, tmp_path, capsys):
    without = stored(tmp_path / "without", quick.results, ())
    there = next(entry for entry in quick.recordings if entry.about.configuration >= 0 and len(entry.torque))
    same = finished._recording(quick, quick_folder, there.about.id)
    assert same is there and capsys.readouterr().err == ""
    again = finished._recording(without, tmp_path / "without", there.about.id)
    assert "is not recorded" in capsys.readouterr().err
    # Both leave out samples, by what cannot be seen.
    at = again.motion[:, 0]
    np.testing.assert_allclose(np.interp(at, there.motion[:, 0], there.error), again.error, atol=2e-6)
    assert again.about.id == there.about.id and again.about.q_a == there.about.q_a
    moved = replace(quick.results.head.controller, sha256="0" * 64)
    other = replace(quick.results, head=replace(quick.results.head, controller=moved))
    stored(tmp_path / "other", other, ())
    error = refusal(finished._recording, Evaluation(other), tmp_path / "other", there.about.id)
    assert error.what == "other-controller"
