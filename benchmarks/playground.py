"""What the playground costs: sizes, the time of a case in Chromium beside the same program in machine code, and quick.

    python benchmarks/playground.py              three controllers, the smallest of 5 rounds
    python benchmarks/playground.py --rounds 9
    python benchmarks/playground.py --picture docs/pictures/playground.png     only the picture of the page

The case is ``c07.compliant.disturbance`` of 26 s. Both programs are made of the same sources with -O2, and take turns.
Needs a C compiler, ziglang, Playwright and Chromium.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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


def of_quick(page: Page) -> float:
    """The time [s] of the protocol on the page."""
    begin = time.perf_counter()
    page.locator('[data-protocol="quick"]').click()
    page.locator("#scorecard .hero").wait_for(timeout=600_000)
    return time.perf_counter() - begin


def opened(driver: Any, file: Path) -> Page:
    """The page in Chromium, ready."""
    program = next(found for found in map(shutil.which, BROWSERS) if found)
    size = {"width": 1200, "height": 1180}
    page: Page = driver.chromium.launch(executable_path=program, args=["--no-sandbox"]).new_page(viewport=size)
    page.goto(file.as_uri())
    page.locator('#results[aria-busy="false"]').wait_for(timeout=60_000)
    return page


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="the smallest times count (default: %(default)s)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write a picture of the page, and measure nothing")
    given = parser.parse_args(arguments)
    bench = Benchmark(plant="native")
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as driver:
        folder = Path(scratch)
        file = folder / "playground.html"
        file.write_text(built_page(), encoding="utf-8")
        page = opened(driver, file)
        if given.picture is not None:
            page.screenshot(path=given.picture)
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
        print(f"quick: {of_quick(page):.1f} s on {cores} cores")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
