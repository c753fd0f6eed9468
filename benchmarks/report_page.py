"""How large the report of a full run is, and how long a browser takes to open it.

    python benchmarks/report_page.py [RUN]          default: runs/DiagonalPID-paper

Opens RUN/report.html in headless Chromium, each time in a fresh context, and prints medians. The exit code is 1 where
the page has 5 MB or more, or takes a second or more. Needs playwright and a Chromium on the PATH.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
from contextlib import closing
from pathlib import Path
from typing import Any

RUN = Path("runs") / "DiagonalPID-paper"
OPENINGS = 5
MOST_MEGABYTES, MOST_SECONDS = 5.0, 1.0
BROWSERS = ("chromium", "chromium-browser", "google-chrome")

# The scripts of the page draw its first view before the event "load" ends; it is on the screen with the frame after
# that. A page that has shown nothing yet has painted no text either.
TIMES = """() => new Promise((resolve) => {
  const told = () => {
    const [navigation] = performance.getEntriesByType("navigation");
    if (!navigation.loadEventEnd) return setTimeout(told, 1);
    requestAnimationFrame(() => setTimeout(() => resolve({
      loaded: navigation.loadEventEnd / 1000,
      drawn: performance.now() / 1000,
      charts: document.querySelectorAll(".chart canvas").length,
    })));
  };
  told();
})"""


def opened(browser: Any, page_file: Path) -> dict[str, float]:
    """Seconds from the navigation to the end of its event "load" and to the frame with the first view."""
    with closing(browser.new_context(viewport={"width": 1280, "height": 900})) as context:
        page = context.new_page()
        page.goto(page_file.resolve().as_uri(), wait_until="commit")
        times: dict[str, float] = page.evaluate(TIMES)
    if not times["charts"]:
        raise SystemExit(f"{page_file} has drawn no chart in its first view.")
    return times


def measured(page_file: Path) -> list[dict[str, float]]:
    """The times of all openings; the browser's own start, an empty page, comes before and is not counted."""
    from playwright.sync_api import sync_playwright

    program = next((found for found in map(shutil.which, BROWSERS) if found), None)
    if program is None:
        raise SystemExit(f"No browser: none of {', '.join(BROWSERS)} is on the PATH.")
    # Chromium has no sandbox of its own for root, who runs this in containers.
    arguments = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=arguments)
        browser.new_page().goto("about:blank")
        times = [opened(browser, page_file) for _ in range(OPENINGS)]
        browser.close()
    return times


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Measure the size of a report and the time to open it.")
    parser.add_argument("run", nargs="?", type=Path, default=RUN, help=f"folder of a full run (default: {RUN})")
    page_file = parser.parse_args().run / "report.html"
    if not page_file.is_file():
        command = f"flexible-manipulator evaluate --output-dir {page_file.parent}"
        raise SystemExit(f"{page_file} is missing. Make it: {command}")
    size = page_file.stat().st_size / 1e6
    times = measured(page_file)
    loaded, drawn = (statistics.median(entry[name] for entry in times) for name in ("loaded", "drawn"))
    slowest = max(entry["drawn"] for entry in times)
    print(f"{page_file}: {size:.2f} MB (below {MOST_MEGABYTES:g} wanted)")
    print(f"median of {OPENINGS}: loaded after {loaded:.2f} s, first view drawn after {drawn:.2f} s")
    print(f"slowest: {slowest:.2f} s (median below {MOST_SECONDS:g} s wanted)")
    return int(size >= MOST_MEGABYTES or max(loaded, drawn) >= MOST_SECONDS)


if __name__ == "__main__":
    raise SystemExit(main())
