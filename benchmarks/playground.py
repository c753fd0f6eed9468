"""What the playground costs: sizes, the time of a case in Chromium beside machine code, and that of quick and paper.

    python benchmarks/playground.py              three controllers, the smallest of 5 rounds
    python benchmarks/playground.py --rounds 9
    python benchmarks/playground.py --picture docs/pictures/playground.png      only the picture of the page
    python benchmarks/playground.py --animation docs/pictures/playground.gif    only the arm, pulled and simulated

The case is ``c07.compliant.disturbance`` of 26 s. Both programs are made of the same sources with -O2, and take turns.
Needs a C compiler, ziglang, Playwright and Chromium.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from support.one_program import block_of, program_input, write_program  # noqa: E402
from support.targets import Target, compile_program, run_program  # noqa: E402
from support.tools import BROWSERS  # noqa: E402

import build_fmus  # noqa: E402
from controller_fmu.export.one_program import CONTROLLERS  # noqa: E402
from orchestrator import Benchmark  # noqa: E402
from orchestrator.cli.playground import built_page  # noqa: E402

CASE = "c07.compliant.disturbance"
REPEATED = 4
"""Times that a case is simulated in a round."""

TIMED = """async (block) => {
  const begin = performance.now();
  for (let left = REPEATED; left > 0; left -= 1) await pair[0].run({ block: Float64Array.from(block) });
  return (performance.now() - begin) / 1000 / REPEATED;
}""".replace("REPEATED", str(REPEATED))


def in_machine_code(target: Target, program: Path, given: Path) -> float:
    """The time [s] of a case, with the start of the process."""
    begin = time.perf_counter()
    run_program(target, program, given)
    return (time.perf_counter() - begin) / REPEATED


def of_protocol(page: Page, name: str) -> float:
    """The time [s] of the protocol on the page."""
    begin = time.perf_counter()
    page.locator(f'[data-protocol="{name}"]').click()
    page.locator("#scorecard", has_text=f" on {name}: ").wait_for(timeout=600_000)
    return time.perf_counter() - begin


def opened(driver: Any, file: Path) -> Page:
    """The page in Chromium, ready."""
    program = next(found for found in map(shutil.which, BROWSERS) if found)
    size = {"width": 1200, "height": 1340}
    page: Page = driver.chromium.launch(executable_path=program, args=["--no-sandbox"]).new_page(viewport=size)
    page.goto(file.as_uri())
    finish(page)
    return page


POSE, PULL = (45, -60), (0.05, 0.33)
"""The link angles of the animation [degrees], and where the force is pulled to, from the tool [m]."""

FROM, UNTIL, SPEED, FRAMES_PER_SECOND = 9.9, 11.4, 0.5, 20
"""Part of the simulation that the animation shows [s], how fast, and its frames."""

WIDTH, COLOURS, PAUSE = 420, 48, 8
"""Width of the animation [px], its colours, and frames that it stands still for before the arm moves."""

PLACES = """(pull) => {
  const home = joints(data.links, degreesOf(state).map((angle) => angle * RADIAN)).tcp;
  const [size, direction] = pulled();
  const from = [Math.cos, Math.sin].map((part) => part(direction * RADIAN) * size / PER_METRE);
  return Array.from({ length: 13 }, (_, step) => {
    const at = home.map((begin, axis) => begin + from[axis] + (pull[axis] - from[axis]) * step / 12);
    const { x, y } = new DOMPoint(...at).matrixTransform($("#stage svg > g").getScreenCTM());
    return [x, y];
  });
}"""
"""Places on the screen along which the force is pulled."""

SHOWN_AT = "(moment) => { $('#scrub').value = moment; $('#scrub').oninput(); }"
BUSY = "$('#results').setAttribute('aria-busy', 'true')"


def finish(page: Page) -> None:
    """Wait until what is chosen is simulated."""
    page.locator('#results[aria-busy="false"]').wait_for(timeout=60_000)


def frames(page: Page) -> Iterator[Image.Image]:
    """The arm while its force is pulled, and then while it moves."""
    page.evaluate(f"{BUSY}; location.hash = encoded({{ pose: {list(POSE)} }})")
    finish(page)
    stage = page.locator("figure:has(#stage)")

    def taken() -> Image.Image:
        picture = Image.open(io.BytesIO(stage.screenshot())).convert("RGB")
        return picture.resize((WIDTH, round(picture.height * WIDTH / picture.width)), Image.Resampling.LANCZOS)

    stage.scroll_into_view_if_needed()
    first, *others = page.evaluate(PLACES, PULL)
    page.evaluate(SHOWN_AT, 0)
    page.mouse.move(*first)
    page.mouse.down()
    for place in others:
        page.mouse.move(*place)
        yield taken()
    page.evaluate(BUSY)
    page.mouse.up()
    finish(page)
    page.evaluate("document.activeElement.blur()")
    for moment in [FROM] * PAUSE + list(np.arange(FROM, UNTIL, SPEED / FRAMES_PER_SECOND)):
        page.evaluate(SHOWN_AT, moment)
        yield taken()


def write_animation(page: Page, file: Path) -> None:
    """Write the frames as a GIF."""
    found = list(frames(page))
    palette = found[len(found) // 2].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    first, *others = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in found]
    duration = 1000 // FRAMES_PER_SECOND
    first.save(file, save_all=True, append_images=others, duration=duration, loop=0, optimize=True)
    print(f"{len(found)} frames, {file.stat().st_size / 1000:.0f} kB")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="the smallest times count (default: %(default)s)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write a picture of the page, and measure nothing")
    parser.add_argument("--animation", type=Path, metavar="FILE", help="write an animation, and measure nothing")
    given = parser.parse_args(arguments)
    bench = Benchmark(plant="native")
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as driver:
        folder = Path(scratch)
        file = folder / "playground.html"
        file.write_text(built_page(), encoding="utf-8")
        page = opened(driver, file)
        if given.picture is not None:
            page.screenshot(path=given.picture)
        if given.animation is not None:
            write_animation(page, given.animation)
        if given.picture is not None or given.animation is not None:
            return 0
        program = write_program(folder / "program")
        target = Target((*(build_fmus.find_compiler() or ("cc",)), "-O2"), ())
        built = compile_program(target, program.sources, program.folder, "program.exe")
        module, *_ = build_fmus.build_web(folder)
        print(f"module {module.stat().st_size / 1e3:.0f} kB, page {file.stat().st_size / 1e6:.2f} MB")
        print("controller          browser [s]  machine code [s]  ratio")
        for name in CONTROLLERS:
            block = block_of(program, name, bench, bench.case(CASE))
            loops = program.folder / "loops.txt"
            loops.write_text(program_input([block] * REPEATED))
            rounds = [(page.evaluate(TIMED, block), in_machine_code(target, built, loops)) for _ in range(given.rounds)]
            browser, machine = (min(times) for times in zip(*rounds, strict=True))
            print(f"{name:18}{browser:13.3f}{machine:18.3f}{browser / machine:7.2f}")
        cores = page.evaluate("navigator.hardwareConcurrency")
        for name in ("quick", "paper"):
            print(f"{name}: {of_protocol(page, name):.1f} s on {cores} cores")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
