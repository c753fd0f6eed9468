"""A person with a browser: an FMU with unusual names is uploaded, bound in the form, watched and read; and the pages
fit the screen, are accessible, and can be used by keyboard."""

import contextlib
import socket
import threading
import time
from dataclasses import replace

import pytest
from service.conftest import ALONE, FAKE, fmu
from service.test_jobs import ONE_POSE
from service.unusual import BINDING, unusual
from support.tools import require

require("starlette", "uvicorn")

pytestmark = pytest.mark.slow

SIZES = [(1400, 900), (390, 844)]


@contextlib.contextmanager
def served(folder, settings, job):
    """The address of a service on loopback, which ends with the block."""
    from orchestrator.service.app import application
    from orchestrator.service.server import Server

    with socket.create_server(("127.0.0.1", 0)) as listening:
        server = Server(application(folder, settings, job))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            while not server.started:
                assert thread.is_alive()
                time.sleep(0.05)
            yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(60)


@pytest.fixture
def opened(chromium):
    """A function that opens a page of a size; nothing may go wrong in it, nor go out to others."""
    troubles = []

    @contextlib.contextmanager
    def page_of(size=SIZES[0], address=""):
        page = chromium.new_page(viewport=dict(zip(("width", "height"), size, strict=True)))
        page.set_default_timeout(30_000)
        page.on("console", lambda said: troubles.append(said.text) if is_trouble(said) else None)
        page.on("pageerror", lambda error: troubles.append(str(error)))
        known = (address, "data:", "blob:")
        page.on("request", lambda asked: None if asked.url.startswith(known) else troubles.append(asked.url))
        yield page
        page.close()  # before the service ends, which a page that follows it would complain of

    yield page_of
    assert troubles == []


def is_trouble(said) -> bool:
    """Whether a message of the console is one; a browser also tells of each answer that refuses something."""
    return said.type in ("error", "warning") and "status of 400" not in said.text


def assert_fits_and_is_accessible(page):
    from axe_playwright_python.sync_playwright import Axe

    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    found = Axe().run(page, options={"iframes": False}).response["violations"]
    assert [(entry["id"], [node["html"][:200] for node in entry["nodes"]]) for entry in found] == []


@pytest.mark.needs("axe_playwright_python")
@pytest.mark.parametrize("size", SIZES)
def test_an_fmu_with_unusual_names_is_uploaded_bound_watched_and_read(size, opened, tmp_path, quick_pid_file):
    from orchestrator.service.runner import JOB

    (tmp_path / "short.toml").write_text(ONE_POSE.format("short"), encoding="utf-8")
    short = str(tmp_path / "short.toml")
    settings = replace(ALONE, conduct=replace(ALONE.conduct, protocol=short, quick_protocol=short, processes=2))
    file = unusual(quick_pid_file, tmp_path / "Regler Müller <1>.fmu")
    with served(tmp_path / "data", settings, JOB) as address, opened(size, address) as page:
        page.goto(address)
        assert_fits_and_is_accessible(page)
        page.locator("#file").set_input_files(file)
        page.get_by_role("button", name="Evaluate").click()
        page.wait_for_url("**/runs/*")
        assert page.locator("h1").inner_text() == "Regler Müller <1>.fmu"
        page.get_by_role("heading", name="Bind its variables").wait_for(timeout=120_000)
        assert_fits_and_is_accessible(page)
        for part, name in BINDING.items():
            page.locator(f'[name="map:{part}"]').select_option(name)
        page.get_by_role("button", name="Check again with this binding").click()
        page.get_by_role("heading", name="Finished").wait_for(timeout=300_000)  # the page has followed by itself
        assert page.locator(".hero").first.inner_text().replace(".", "").isdigit()
        assert_fits_and_is_accessible(page)
        page.reload()
        report = page.frame_locator("iframe.report")
        report.locator("#summary").wait_for()
        assert page.evaluate("scrollY") == 0, "the report in its frame leaves the page where it is"
        page.locator("iframe.report").scroll_into_view_if_needed()
        report.locator("#tab-workspace").click()
        assert report.locator("#workspace").is_visible()
        assert page.locator("iframe.report").get_attribute("sandbox") == "allow-scripts"
        page.goto(address)
        assert "finished" in page.locator("#mine").inner_text()
        page.on("dialog", lambda dialog: dialog.accept())
        page.locator("#mine a").click()
        # Chromium closes a dialog, unanswered, when any frame of its page is loaded.
        report.locator("#summary").wait_for()
        page.get_by_role("button", name="Delete").click()
        page.get_by_text("None yet.").wait_for()


def test_the_start_page_follows_runs_and_the_keyboard_is_enough(opened, tmp_path):
    with served(tmp_path / "data", ALONE, FAKE) as address, opened(SIZES[0], address) as page:
        page.goto(address)
        (tmp_path / "a.fmu").write_bytes(fmu(evaluating={"cost": 88.25}))
        (tmp_path / "b.fmu").write_bytes(fmu(quick={"wait": 60}))
        page.locator("#file").set_input_files([tmp_path / "a.fmu", tmp_path / "b.fmu"])
        page.locator("#file").focus()
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        page.locator("#mine .finished").wait_for()
        assert "88.3" in page.locator("#table").inner_text() or "88.2" in page.locator("#table").inner_text()
        link = page.locator("#mine a", has_text="b.fmu")
        link.focus()
        page.keyboard.press("Enter")
        page.get_by_role("button", name="Cancel").wait_for()
        page.get_by_text("3 of 24 cases, V so far 101.5").wait_for()
        page.get_by_role("button", name="Cancel").focus()
        page.keyboard.press("Enter")
        page.get_by_role("heading", name="Cancelled").wait_for()


def test_a_file_that_is_no_fmu_is_told_without_leaving_the_page(opened, tmp_path):
    with served(tmp_path / "data", ALONE, FAKE) as address, opened(SIZES[1], address) as page:
        page.goto(address)
        (tmp_path / "a.fmu").write_bytes(b"no zip file")
        page.locator("#file").set_input_files(tmp_path / "a.fmu")
        page.get_by_role("button", name="Evaluate").click()
        page.get_by_text("an FMU is a zip file").wait_for()
