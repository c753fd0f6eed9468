"""Pictures of the pages for README and docs, in Chromium.

    python benchmarks/screenshots.py report         an evaluation of the paper's PID, half a minute
    python benchmarks/screenshots.py worst-case     a search with the default budget, some minutes
    python benchmarks/screenshots.py service        a service of its own: first page, binding form, finished run
    python benchmarks/screenshots.py report service --output-dir docs/pictures

Needs a C compiler, Playwright and Chromium; ``service`` its extra as well.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from service.unusual import unusual  # noqa: E402
from support.tools import BROWSERS  # noqa: E402

import build_fmus  # noqa: E402
from benchmarks.service import serving  # noqa: E402
from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.service.client import Client  # noqa: E402
from orchestrator.study.worst_case import RobustnessStudy  # noqa: E402

WIDTH, HEIGHT = 1360, 1130
"""Of the window [px]."""

COLOURS = 128
"""Of a picture: a page has few, and the file is a third as large."""


def write(page: Page, file: Path) -> None:
    """Write what the window shows."""
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


def built(name: str) -> Path:
    """A controller's FMU, by the path that README's commands have."""
    folder = Path("build", "fmus")
    folder.mkdir(parents=True, exist_ok=True)
    return build_fmus.build(name, folder)


def report(page: Page, scratch: Path, output: Path) -> None:
    """The report of an evaluation."""
    file, folder = built("DiagonalPID_C"), scratch / "evaluation"
    Benchmark().evaluate(Controller(file), folder=folder).report(folder / "report.html", folder)
    page.goto((folder / "report.html").as_uri())
    write(page, output / "report.png")


def worst_case(page: Page, scratch: Path, output: Path) -> None:
    """The report of a search."""
    file, folder = built("RobustLQG"), scratch / "robustness"
    Benchmark().run(RobustnessStudy(), Controller(file), folder=folder).report(folder / "report.html", folder)
    page.goto((folder / "report.html").as_uri())
    write(page, output / "worst-case.png")


def service(page: Page, scratch: Path, output: Path) -> None:
    """The first page, the binding form of an FMU with names of its own, and a finished run."""
    with serving(*(() if shutil.which("bwrap") else ("--trust",))) as served:
        client = Client(served.url)
        own = built("DiagonalPID_C")
        finished = client.submit(own)["id"]
        refused = client.submit(unusual(own, scratch / "MyController.fmu"))["id"]
        for id in (finished, refused):
            client.follow(id, lambda run: None)
        pages = {"service": "/", "service-binding": f"/runs/{refused}", "service-run": f"/runs/{finished}"}
        for name, path in pages.items():
            page.goto(served.url + path)
            page.wait_for_load_state()
            write(page, output / f"{name}.png")


PICTURES: dict[str, Callable[[Page, Path, Path], None]] = {
    "report": report,
    "worst-case": worst_case,
    "service": service,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="+", choices=PICTURES)
    parser.add_argument("--output-dir", type=Path, default=HERE.parent / "docs" / "pictures", metavar="FOLDER")
    given = parser.parse_args(arguments)
    program = next(found for found in map(shutil.which, BROWSERS) if found)
    output = given.output_dir.absolute()
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as driver:
        os.chdir(scratch)  # the pages show the commands' paths as they are given
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        for name in given.pictures:
            PICTURES[name](page, Path(scratch), output)
        os.chdir(HERE)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
