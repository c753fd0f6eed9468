"""A headless Chromium, and pages that fail a test for any console error or network request."""

import functools
import os
import shutil

import pytest
from support.tools import BROWSERS, require

from browser.pages import DESKTOP


@pytest.fixture(scope="session")
def chromium():
    """The browser; the test is skipped where Playwright or Chromium is missing."""
    require("playwright", "chromium")
    from playwright import sync_api as playwright

    program = next(found for found in map(shutil.which, BROWSERS) if found)
    # Chromium has no sandbox of its own for root, who runs tests in containers.
    arguments = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=arguments)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def tabs(chromium, tmp_path_factory):
    """A function that opens a page once per size and scheme, and a list of all that goes wrong in any of them."""
    folder, troubles = tmp_path_factory.mktemp("pages"), []

    @functools.cache
    def opened(html, size, scheme):
        file = folder / f"{len(list(folder.iterdir()))}.html"
        file.write_text(html, encoding="utf-8")
        page = chromium.new_page(viewport=dict(zip(("width", "height"), size, strict=True)), color_scheme=scheme)
        page.on("console", lambda said: troubles.append(said.text) if said.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: troubles.append(str(error)))
        page.on("dialog", lambda dialog: (troubles.append(f"dialog: {dialog.message}"), dialog.dismiss()))
        # What a page has made itself, such as the program of its workers, is no request.
        own = (file.as_uri(), "blob:null/")
        page.on("request", lambda request: None if request.url.startswith(own) else troubles.append(request.url))
        page.goto(file.as_uri())
        return page

    return opened, troubles


@pytest.fixture
def open_page(tabs):
    """Opens a page, or finds it open as another test left it; at the end of the test nothing must have gone wrong."""
    opened, troubles = tabs
    yield lambda html, size=DESKTOP, scheme="light": opened(html, size, scheme)
    found = troubles.copy()
    troubles.clear()
    assert found == []
