"""The playground in a real browser: its numbers are those of this program, to the last bit."""

import base64
import json
import shlex
import zipfile

import numpy as np
import pytest
from fmpy import read_model_description
from support.command_lines import call

import build_fmus
from browser.pages import PHONE
from controller_fmu.export.state_space import controller_from_state_space
from orchestrator import Benchmark, Controller
from orchestrator.cli.playground import built_page

pytestmark = [pytest.mark.slow, pytest.mark.needs("compiler", "ziglang")]

DESK = (1400, 900)
LEAD = {
    "A": [[0.9, 0.01, 0.0], [0.0, 0.93, 0.0], [0.0, 0.1, 0.5]],
    "B": [[1.0, 0.0], [0.0, 1.0], [0.3, 0.0]],
    "C": [[-150.0, 0.0, 1.0], [0.0, -35.0, 2.0]],
    "D": [[1545.0, 0.0], [0.0, 515.0]],
}
STATES = {
    "as it begins": {},
    "gains, force and its direction": {
        "chosen": {"name": "TunedPID", "values": {"K_p[1]": 31.5}},
        "force": 340,
        "phi": 1.25,
    },
    "a loop that is worse": {"protocolCase": "c11.sticky.gain_2", "gain": [1.7, 0.6], "delay": [0.00075, 0.00175]},
    "an arm of one's own": {
        "protocolCase": "c03.random_2.disturbance",
        "pose": [12.3, -45.6],
        "arm": {"m[1]": 46.25, "k_low[2]": 173000.0, "psi[1]": 0.00047, "f_c[2]": 1.7, "gamma[1]": 1.09},
        "chosen": {"name": "RobustLQG", "values": {}},
        "seed": 5_000_000_017,
    },
    "a pose of the grid": {
        "protocolCase": "c02.compliant.delay_1",
        "pose": [-90.0, 80.0],
        "arm": {"alpha[1]": 7.0},
        "chosen": {"name": "RobustLinearLQG", "values": {}},
    },
    "matrices": {"chosen": {"name": "linear", "matrices": LEAD}, "protocolCase": "c05.compliant.noise"},
    "only the force": {"force": 340},
    "only its direction": {"phi": 2.0, "protocolCase": "c08.sticky.gain_2"},
    "a corner of the workspace": {"pose": [-90.0, -180.0], "force": None, "phi": None},
    "small numbers": {"pose": [1e-7, -1e-7], "phi": -3e-7},
    "a pose close to one of the grid": {"pose": [146.25, -179.99999993]},
}


@pytest.fixture(scope="module")
def html():
    """The page."""
    return built_page()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the FMUs that the page's commands name."""
    made = tmp_path_factory.mktemp("commands")
    fmus = made / "build" / "fmus"
    fmus.mkdir(parents=True)
    for name in ("DiagonalPID_C", "TunedPID", "RobustLQG", "RobustLinearLQG"):
        build_fmus.build(name, fmus)
    controller_from_state_space(*LEAD.values(), T_s=0.25e-3, out=made / "MyLinear.fmu")  # as a download would be
    return made


@pytest.fixture
def own_page(chromium, html, tmp_path):
    """Opens the page for this test alone, which may spoil it: the others share one. A script may run before its own."""
    file, pages = tmp_path / "page.html", []
    file.write_text(html, encoding="utf-8")

    def opened(script=""):
        pages.append(chromium.new_page(viewport={"width": DESK[0], "height": DESK[1]}))
        pages[0].add_init_script(script)
        pages[0].goto(file.as_uri())
        return pages[0]

    yield opened
    for page in pages:
        page.close()


def finish(page):
    """Wait until what is chosen is simulated."""
    page.locator('#results[aria-busy="false"]').wait_for(timeout=60_000)


def go_to(page, state):
    """Open a link to the page in a state."""
    busy = "$('#results').setAttribute('aria-busy', 'true')"
    page.evaluate(f"{busy}; location.hash = encoded({json.dumps({**state})})")
    finish(page)


@pytest.mark.parametrize("name", STATES)
def test_the_command_gives_the_same_numbers(name, html, folder, open_page):
    page = open_page(html, DESK)
    go_to(page, STATES[name])
    command = shlex.split(page.locator("#command").inner_text())
    assert command[:2] == ["flexible-manipulator", "simulate"]
    done = call("simulate", *command[2:], "--plant", "native", "--json", folder=folder)
    assert done.code == 0, done.err
    wanted = json.loads(done.out)
    found = page.evaluate("data.answers[0]")
    figures = {**found["figures"], "settled": bool(found["figures"].get("settled"))}
    assert wanted["status"] == "done" and found["reason"] == "finished"
    assert (found["time"], found["until"]) == (wanted["time"], wanted.get("judged_until"))
    assert {key: figures[key] for key in wanted["measurements"]} == wanted["measurements"]
    assert set(found["figures"]) == set(wanted["measurements"])


HOSTILE = {
    "text behind a gain": {"gain": [1, 1, "$(touch PWN)"]},
    "text as a delay": {"delay": [0.00025, "0.00025; touch PWN"]},
    "text as a seed": {"seed": "1; touch PWN #"},
    "text as a force that no test uses": {"protocolCase": "c05.compliant.noise", "force": "1\ntouch PWN"},
    "text in a pose": {"pose": [12, "30; touch PWN"]},
    "text as the name of a parameter": {"chosen": {"name": "DiagonalPID_C", "values": {"K_p[1]'; touch PWN '": 1}}},
    "text as a name": {"chosen": {"name": "'; touch PWN '", "values": {}}},
    "a start of the arm as a parameter": {"arm": {"q_a_start[1]": 0.1}},
    "a delay between two steps": {"delay": [0.0003, 0.0003]},
    "a delay close to a step": {"delay": [0.00050000001, 0.00025]},
    "no delay": {"delay": [0, 0.00025]},
    "a delay that no slider has": {"delay": [0.3, 0.00025]},
    "an input of the controller": {"chosen": {"name": "DiagonalPID_C", "values": {"q_m_ref[1]": 0.1}}},
    "a seed that is none": {"seed": -1},
    "a pose outside": {"pose": [500, 1e5]},
    "no values": {"chosen": {"name": "DiagonalPID_C"}},
    "matrices of another controller": {"chosen": {"name": "DiagonalPID_C", "values": {}, "matrices": LEAD}},
    "a prototype": {"__proto__": {"seed": 3}, "constructor": 1, "chosen": {"name": "__proto__", "values": {}}},
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_link_that_is_no_state_of_the_page_begins_anew(name, html, open_page):
    """Its command is pasted into a shell: it ran what stood in the place of a seed."""
    page = open_page(html, DESK)
    go_to(page, {"seed": 17})
    link = base64.urlsafe_b64encode(json.dumps(HOSTILE[name]).encode()).decode().rstrip("=")
    page.evaluate(f"$('#results').setAttribute('aria-busy', 'true'); location.hash = {json.dumps(link)}")
    finish(page)
    assert page.evaluate("state") == page.evaluate("structuredClone(BEGIN)")
    said = page.locator("#state").inner_text()
    assert "PWN" not in page.locator("#command").inner_text() and "The link is damaged" in said and "Two cases" in said
    page.evaluate("$('#results').setAttribute('aria-busy', 'true'); setOwn({ seed: 3 }); update()")
    finish(page)
    assert "The link" not in page.locator("#state").inner_text()


def test_what_a_link_holds_beside_a_state_is_left_out(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {"seed": 17})
    state = base64.urlsafe_b64encode(json.dumps({"seed": 5, "zz": "\u4e2d"}).encode()).decode().rstrip("=")
    page.evaluate(f"$('#results').setAttribute('aria-busy', 'true'); location.hash = {json.dumps(state)}")
    finish(page)
    assert page.evaluate("state.seed") == 5 and not page.evaluate("'zz' in state")


def test_large_entries_of_a_matrix_reach_the_fmu(html, open_page, tmp_path):
    """1e20 was written as an integer of C, which is too large for one: another controller, without a word."""
    page = open_page(html, DESK)
    law = {"A": [[0.0]], "B": [[1e20, 0.0]], "C": [[3e-18], [0.0]], "D": [[0.0, 0.0], [0.0, 100.0]]}
    go_to(page, {"chosen": {"name": "linear", "matrices": law}})
    with page.expect_download() as download:
        page.locator("#fmu").click()
    download.value.save_as(tmp_path / "MyLinear.fmu")
    case = page.evaluate("state.protocolCase")
    done = call("simulate", "MyLinear.fmu", "--case", case, "--plant", "native", "--json", folder=tmp_path)
    assert page.evaluate("data.answers[0].figures.B5") == json.loads(done.out)["measurements"]["B5"]


def test_a_scorecard_of_a_former_controller_says_so(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {"chosen": {"name": "DiagonalPID_C", "values": {"K_p[1]": 46.8}}})
    page.locator('[data-protocol="quick"]').click()
    page.locator("#scorecard .hero").wait_for(timeout=600_000)
    assert "with changed gains on quick" in page.locator("#scorecard").inner_text()
    assert page.locator("#former").inner_text() == ""
    page.locator("#gain-K_p-1").focus()
    page.keyboard.press("ArrowRight")
    assert "former" in page.locator("#former").inner_text()
    page.keyboard.press("ArrowLeft")
    assert page.locator("#former").inner_text() == ""


LIMITED = """(() => {
  const [replace, times] = [history.replaceState, []];
  history.replaceState = function (...given) {
    const now = performance.now();
    while (times[0] < now - 30e3) times.shift();
    if (times.push(now) > 100) throw new DOMException("too often", "SecurityError");
    return replace.apply(this, given);
  };
})()"""
"""The limit of Safari."""


def test_a_slider_that_is_drawn_for_long_is_simulated_to_its_end(own_page):
    """The address could not be written any more, and the figures of a former value stayed beside the slider."""
    page = own_page(LIMITED)
    go_to(page, {})
    page.evaluate("""async () => {
      const input = $("#gain-K_d-1");
      for (let turn = 0; turn < 150; turn += 1) {
        input.value = String(Number(input.max) * (150 - turn) / 150);
        input.dispatchEvent(new Event("input"));
        await new Promise((done) => setTimeout(done, 5));
      }
    }""")
    finish(page)
    found, values = page.evaluate("[data.answers[0].figures, state.chosen.values]")
    page.wait_for_timeout(1000)
    assert page.evaluate("location.hash === `#${encoded(state)}`")
    go_to(page, {})
    go_to(page, {"chosen": {"name": "DiagonalPID_C", "values": values}})
    assert page.evaluate("data.answers[0].figures") == found


FAILING = "pair.forEach((worker) => (worker.run = () => Promise.reject(new Error('out of memory'))))"


def test_what_is_not_simulated_has_no_figures(own_page):
    page = own_page()
    go_to(page, {})
    page.evaluate(FAILING)
    page.locator("#gain-K_p-1").press("ArrowRight")
    page.locator("#results").wait_for(state="hidden")
    assert page.locator("#state").inner_text() == "Not simulated: out of memory."


def test_an_evaluation_that_fails_says_so_and_can_be_asked_for_again(own_page):
    page = own_page()
    go_to(page, {})
    page.evaluate("(newWorker = () => ({ run: () => Promise.reject(new Error('out of memory')), end: () => {} }))")
    page.locator('[data-protocol="quick"]').click()
    assert page.locator("#scorecard").inner_text() == "Not evaluated: out of memory."
    assert page.locator('[data-protocol="quick"]').is_enabled() and not page.locator("#progress").is_visible()


def test_a_controller_with_errors_is_told_from_one_that_fails(html, open_page):
    """Cases that had ended with an error counted as failures of A1 to A3, without a word of why."""
    page = open_page(html, DESK)
    law = {"A": [[1e200]], "B": [[1.0, 0.0]], "C": [[1e200], [0.0]], "D": [[0.0, 0.0], [0.0, 100.0]]}
    go_to(page, {"chosen": {"name": "linear", "matrices": law}})
    page.locator('[data-protocol="quick"]').click()
    page.locator("#scorecard .hero").wait_for(timeout=600_000)
    said = page.locator("#scorecard .bad").inner_text()
    assert said.startswith("24 of 24 cases ended with an error of the controller, such as c")


@pytest.mark.parametrize("missing", ["WebAssembly", "Worker"])
def test_a_browser_that_cannot_simulate_is_told_so(missing, own_page):
    page = own_page(f"delete window.{missing}")
    said = page.locator("#state").inner_text()
    assert said.startswith("The page does not work in this browser: ") and f"{missing} is not defined" in said
    assert not page.locator("#results").is_visible()


def test_a_download_that_the_browser_cannot_make_says_so(own_page):
    page = own_page("delete window.DecompressionStream")
    finish(page)
    page.locator("#fmu").click()
    page.get_by_text("Not downloaded: ").wait_for()


def test_gains_and_matrices_are_there_again_after_another_law_was_chosen(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {"chosen": {"name": "DiagonalPID_C", "values": {"K_p[1]": 44}}})
    law = page.locator("#controller")
    law.select_option("linear")
    page.locator("#law").fill(json.dumps(LEAD))
    law.select_option("DiagonalPID_C")
    assert page.evaluate("state.chosen.values") == {"K_p[1]": 44}
    law.select_option("linear")
    assert page.evaluate("state.chosen.matrices") == LEAD
    page.locator("#reset").click()
    assert page.evaluate("state.chosen.matrices") != LEAD
    finish(page)


def test_a_gain_is_of_one_of_the_two_controllers(own_page):
    """After these changes both were one object, and the second controller had the gains of the chosen one."""
    page = own_page()
    law = page.locator("#controller")
    law.select_option("RobustLQG")
    law.select_option("DiagonalPID_C")
    page.locator("#swap").click()
    law.select_option("DiagonalPID_C")
    page.locator("#swap").click()
    law.select_option("RobustLQG")
    law.select_option("DiagonalPID_C")
    page.locator("#gain-K_p-1").press("ArrowRight")
    assert page.evaluate("[state.chosen.values['K_p[1]'], state.beside.values['K_p[1]']]") == [45.9, None]


def test_a_reload_keeps_the_last_change(own_page):
    page = own_page()
    finish(page)
    page.wait_for_timeout(1000)
    page.locator("#gain-K_p-1").press("ArrowRight")
    page.reload()
    finish(page)
    assert page.evaluate("state.chosen.values") == {"K_p[1]": 45.9}


def test_a_task_that_fails_does_not_end_a_worker(own_page):
    page = own_page()
    finish(page)
    page.evaluate("(async () => { try { await pair[0].run({}); } catch { window.failed = true; } })()")
    page.locator("#gain-K_p-1").press("ArrowRight")
    page.wait_for_timeout(500)
    finish(page)
    assert page.evaluate("failed") and "Two cases" in page.locator("#state").inner_text()


RECORDED = """async () => {
  const { record } = await pair[0].run({ ...blockOf(state, state.chosen), detail: "record" });
  return Object.fromEntries(Object.entries(record).map(([name, column]) => [name, Array.from(column)]));
}"""


def test_every_sample_is_that_of_the_master_loop(html, folder, open_page):
    page = open_page(html, DESK)
    go_to(page, {"chosen": {"name": "RobustLQG", "values": {}}})
    found = {name: np.array(column).reshape(-1, 2) for name, column in page.evaluate(RECORDED).items()}
    bench = Benchmark(plant="native")
    wanted = bench.simulate(Controller(folder / "build" / "fmus" / "RobustLQG.fmu")).trajectory
    assert np.array_equal(found["q_m"], wanted.q_m) and np.array_equal(found["X"], wanted.X)
    for name in ("command", "torque"):
        assert np.array_equal(found[name][:-1], getattr(wanted, name))


LAWS = {
    "MyDiagonalPID_C.fmu": {"name": "DiagonalPID_C", "values": {}},
    "MyTunedPID.fmu": {"name": "TunedPID", "values": {"K_p[1]": 31.5, "z_p[2]": 0.93}},
    "MyRobustLQG.fmu": {"name": "RobustLQG", "values": {}},
    "MyRobustLinearLQG.fmu": {"name": "RobustLinearLQG", "values": {}},
    "MyLinear.fmu": {"name": "linear", "matrices": LEAD},
}


@pytest.mark.parametrize(
    ("name", "protocol"),
    [
        *[("MyTunedPID.fmu", "quick"), ("MyRobustLinearLQG.fmu", "quick"), ("MyLinear.fmu", "quick")],
        *[("MyDiagonalPID_C.fmu", "quick"), ("MyRobustLQG.fmu", "paper")],  # a minute for each of paper
    ],
)
def test_the_scorecard_is_that_of_an_evaluation_of_the_downloaded_fmu(name, protocol, html, open_page, tmp_path):
    page = open_page(html, DESK)
    go_to(page, {"chosen": LAWS[name]})
    with page.expect_download() as download:
        page.locator("#fmu").click()
    file = tmp_path / download.value.suggested_filename
    assert file.name == name
    download.value.save_as(file)
    page.evaluate("$('#scorecard').replaceChildren()")
    page.locator(f'[data-protocol="{protocol}"]').click()
    page.locator("#scorecard .hero").wait_for(timeout=600_000)
    found, ids = page.evaluate(f"[data.scorecard, data.protocols.{protocol}.cases.map(({{ id }}) => id)]")
    bench = Benchmark(protocol, plant="native")
    wanted = bench.evaluate(Controller(file)).results
    assert found["cost"] == wanted.cost
    assert found["criteria"] == {key: criterion.value for key, criterion in wanted.criteria.items()}
    assert {key: not failed for key, failed in found["failed"].items()} == {
        key: requirement.passed for key, requirement in wanted.stability.items()
    }
    assert len(ids) == len(wanted.cases)
    for id, outcome in zip(ids, found["outcomes"], strict=True):
        judgement = wanted.case(id).judgement
        assert outcome["figures"] == {key: getattr(judgement.measurements, key) for key in judgement.measurements.names}
        assert (outcome["time"], outcome["until"]) == (judgement.time, judgement.judged_until)
    cost = "-" if wanted.cost is None else f"{wanted.cost:.1f}"
    assert cost == page.locator("#scorecard .hero").inner_text()


def test_a_downloaded_fmu_is_sound_and_its_identity_follows_from_its_contents(html, open_page, tmp_path):
    page = open_page(html, DESK)
    found = []
    for gain in (40, 41, 41):
        go_to(page, {"chosen": {"name": "DiagonalPID_C", "values": {"K_p[1]": gain}}})
        with page.expect_download() as download:
            page.locator("#fmu").click()
        download.value.save_as(tmp_path / "My.fmu")
        with zipfile.ZipFile(tmp_path / "My.fmu") as archive:
            assert archive.testzip() is None
        found.append(read_model_description(str(tmp_path / "My.fmu")))
    starts = [{each.name: each.start for each in one.modelVariables}["K_p[1]"] for one in found]
    guids = [one.guid for one in found]
    assert starts == ["40", "41", "41"] and guids[0] != guids[1] == guids[2]
    checked = call("check", "My.fmu", folder=tmp_path)
    assert checked.code == 0, checked.out + checked.err


def test_a_slider_simulates_by_the_keyboard_and_a_link_brings_it_back(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {})
    before = page.evaluate("data.answers")
    page.locator("#gain-K_p-1").focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(100)
    finish(page)
    after = page.evaluate("data.answers")
    assert "--set 'K_p[1]=46.8'" in page.locator("#command").inner_text()
    assert after[0] != before[0] and after[1] == before[1]
    link = page.locator("#link").get_attribute("href")
    go_to(page, {})
    assert page.evaluate("data.answers") == before
    page.evaluate(f"$('#results').setAttribute('aria-busy', 'true'); location.hash = {json.dumps(link)}")
    finish(page)
    assert page.evaluate("data.answers") == after


def test_the_keyboard_comes_to_the_results_past_the_sliders_and_what_was_set_stays(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {"seed": 17})
    page.locator("#lesson button").last.focus()
    page.keyboard.press("Tab")
    link = page.locator(":focus")
    assert link.inner_text() == "Skip to the results" and link.bounding_box()["x"] >= 0.0
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    assert page.evaluate("[document.activeElement.closest('#results') !== null, state.seed]") == [True, 17]


def test_a_seed_is_typed_and_stepped_by_the_keyboard(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {})
    seed = page.locator("#seed")
    seed.fill("12345")
    seed.press("Enter")
    seed.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    finish(page)
    assert page.evaluate("[document.activeElement.id, $('#seed').value, state.seed]") == ["seed", "9997", 9997]
    assert page.locator("#pose").input_value() == "own" and "--seed 9997" in page.locator("#command").inner_text()


@pytest.mark.parametrize(
    "broken", ["%", "e30", "bm8", '{"lesson": [9, 0]}', '{"protocolCase": "none"}', '{"chosen": {"name": "none"}}']
)
def test_a_link_that_means_nothing_begins_anew(broken, html, open_page):
    page = open_page(html, DESK)
    go_to(page, {"protocolCase": "c01.sticky.gain_1"})
    text = json.dumps(broken) if not broken.startswith("{") else f"encoded({broken})"
    page.evaluate(f"$('#results').setAttribute('aria-busy', 'true'); location.hash = {text}")
    finish(page)
    assert "--case c07.compliant.disturbance" in page.locator("#command").inner_text()


def test_matrices_that_do_not_fit_are_refused_in_words(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {"chosen": {"name": "linear", "matrices": LEAD}})
    page.locator("#law").fill(json.dumps({**LEAD, "B": [[1.0, 2.0]]}))
    assert page.locator("#law-problem").inner_text() == "B must have 3 × 2 numbers"
    page.locator("#law").fill(json.dumps(LEAD))
    assert page.locator("#law-problem").inner_text() == ""
    finish(page)


@pytest.mark.needs("axe_playwright_python")
@pytest.mark.parametrize(("size", "scheme"), [(DESK, "light"), (PHONE, "dark")])
def test_it_fits_the_screen_and_is_accessible(size, scheme, html, open_page):
    from axe_playwright_python.sync_playwright import Axe

    page = open_page(html, size, scheme)
    go_to(page, {"protocolCase": "c08.compliant.delay_2", "lesson": [2, 1]})
    for each in page.locator("summary").all():
        each.click()
    for each in page.locator(".chart").all():
        assert each.locator("canvas").count() == 1 and "at most" in each.get_attribute("aria-label")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    found = Axe().run(page).response["violations"]
    assert [(entry["id"], [node["html"][:200] for node in entry["nodes"]]) for entry in found] == []


SEEN = {
    (0, 0): {"B6": "2.64 s ✓", "B7": "1.26 mm ✗"},
    (0, 1): {"B6": "3.31 s ✗", "B7": "0.355 mm ✓"},
    (1, 0): {"B5 Force": "2.02 mm ✓", "B5 as": "0.522 mm"},
    (1, 1): {"B5 Force": "1.66 mm ✓", "B5 as": "0.14 mm"},
    (2, 0): {"A2": "stands still ✓"},
    (2, 1): {"A2": "no rest ✗", "Amplitude": "91 µm"},
    (3, 0): {"B5 Force": "2.02 mm ✓", "B7": "0.746 mm ✗"},
    (3, 1): {"B5 Force": "1.66 mm ✓", "B7": "0.332 mm ✓"},
    (3, 2): {"A1": "limit cycle ✗", "Amplitude": "14.8 µm"},
    (4, 0): {"A2": "stands still ✓"},
    (4, 1): {"A2": "no rest ✗", "Amplitude": "32.6 mm", "Error": "226.8 mm"},
}
"""What the lesson says is seen, by step and view: the figures of the chosen controller."""


def next_view(page, button):
    """Press a button of the lesson by the keyboard, and wait for what is simulated."""
    page.evaluate("$('#results').setAttribute('aria-busy', 'true')")
    button.press("Enter")
    finish(page)


@pytest.mark.parametrize("size", [DESK, PHONE])
def test_each_step_of_the_lesson_shows_what_its_answer_says(size, html, open_page):
    page = open_page(html, size)
    go_to(page, {})
    lesson = page.locator("#lesson")
    next_view(page, lesson.get_by_role("button", name="Begin the lesson"))
    found = {}
    for step in range(5):
        assert page.evaluate("document.activeElement.textContent").startswith(f"{step + 1} of 5")
        views = lesson.get_by_role("group", name="Set the page").get_by_role("button")
        for view in range(views.count()):
            next_view(page, views.nth(view))
            assert views.nth(view).get_attribute("aria-pressed") == "true"
            lines = lesson.locator("#lesson-seen span").all_inner_texts()
            found[step, view] = {
                name: line.split(": ")[1].split(" with ")[0] for line in lines for name in [line.split(":")[0]]
            }
        right = page.evaluate(f"LESSON[{step}].right")
        answers = lesson.get_by_role("radio")
        answers.nth((right + 1) % 3).check()
        assert lesson.get_by_role("status").inner_text().startswith("✗ No.")
        answers.nth(right).check()
        assert lesson.get_by_role("status").inner_text() == f"✓ Yes. {page.evaluate(f'LESSON[{step}].because')}"
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        if step < 4:
            next_view(page, lesson.get_by_role("button", name="Next step"))
    assert found.keys() == SEEN.keys()
    for place, wanted in SEEN.items():
        shown = found[place]
        assert {begin: value for begin in wanted for name, value in shown.items() if name.startswith(begin)} == wanted


def test_the_answers_of_the_lesson_are_true_of_the_papers_gains_and_of_the_frequency_too(html, open_page):
    page = open_page(html, DESK)
    for case in ("c08.compliant.delay_2", "c08.slippery.gain_2"):
        go_to(page, {"protocolCase": case})
        assert page.evaluate("data.answers[0].verdict") == "quiet"
    go_to(page, page.evaluate("lessonState(2, 1)"))
    assert round(page.evaluate("data.answers[0].figures.limit_cycle_frequency")) == 43


def test_the_arm_of_the_lesson_is_within_the_tolerances_as_its_answer_says(html, open_page):
    page = open_page(html, DESK)
    arm, table, nominal = page.evaluate("[FOUND_ARM, data.table, data.nominal]")
    tolerances = {row["symbol"]: row["tolerance"] for row in table}
    shares = {name: (value / nominal[name] - 1) / tolerances[name[:-3]] for name, value in arm.items()}
    assert len(arm) == 2 * len(table) and all(abs(share) <= 1 + 1e-9 for share in shares.values())
    assert sum(abs(share) > 1 - 1e-9 for share in shares.values()) >= 8  # "many at an end"


def test_a_view_of_the_lesson_that_was_changed_is_no_view_any_more_and_a_link_brings_the_step_back(html, open_page):
    page = open_page(html, DESK)
    page.evaluate("goToLesson(3, 1)")
    finish(page)
    pressed = page.locator('#lesson [aria-pressed="true"]')
    assert pressed.all_inner_texts() == ["Four times"]
    page.locator("#gain-K_p-1").press("ArrowLeft")  # the other end is reached
    finish(page)
    assert pressed.count() == 0
    link = page.locator("#link").get_attribute("href")
    go_to(page, {})
    assert page.locator("#lesson h2").inner_text() == "A lesson in five steps"
    page.evaluate(f"$('#results').setAttribute('aria-busy', 'true'); location.hash = {json.dumps(link)}")
    finish(page)
    assert page.locator("#lesson h2").inner_text().startswith("4 of 5")


def test_the_force_is_pulled_by_the_mouse_and_by_keys(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {})
    before = page.evaluate("data.answers")
    grip = page.locator("#pull .grip")
    grip.scroll_into_view_if_needed()
    box = grip.bounding_box()
    home = "joints(data.links, degreesOf(state).map((angle) => angle * RADIAN)).tcp"
    matrix = "$('#stage svg > g').getScreenCTM()"
    scale = page.evaluate(f"{matrix}.a")  # pixels of a metre
    x, y = page.evaluate(f"(({{ x, y }}) => [x, y])(new DOMPoint(...{home}).matrixTransform({matrix}))")
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(x - 0.3 * scale, y - 0.3 * scale, steps=3)
    page.evaluate("$('#results').setAttribute('aria-busy', 'true')")
    page.mouse.up()
    finish(page)
    size, direction = page.evaluate("pulled()")
    assert size == 850 and abs(direction - 135) <= 1  # 0.3 m to the left and upwards, at 2000 N a metre
    assert page.locator("#force").input_value() == "850"
    assert page.evaluate("data.answers[0].figures.B5") != before[0]["figures"]["B5"]
    handle = page.get_by_role("slider", name="Force at the tool")
    for key in ("ArrowUp", "ArrowRight", "PageDown"):
        page.evaluate("$('#results').setAttribute('aria-busy', 'true')")
        handle.press(key)
        finish(page)
    assert page.evaluate("pulled()") == [770, pytest.approx(direction - 5)]
    assert handle.get_attribute("aria-valuetext") == f"770.0 newtons at {direction - 5:.1f} degrees"
    assert "--force 770" in page.locator("#command").inner_text()
    assert page.evaluate("document.activeElement.id") == "pull"
    for _ in range(8):
        handle.press("PageUp")
    assert handle.get_attribute("aria-valuenow") == "1000"


def test_a_finger_pulls_the_force_and_does_not_scroll_the_page(html, open_page):
    page = open_page(html, PHONE)
    go_to(page, {"pose": [45, -60], "force": 800, "phi": 0.0})
    grip = page.locator("#pull .grip")
    grip.evaluate("(ring) => ring.scrollIntoView({ block: 'center' })")
    box, scrolled = grip.bounding_box(), page.evaluate("scrollY")
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    touch = page.context.new_cdp_session(page)
    points = [("touchStart", [{"x": x, "y": y}])]
    points += [("touchMove", [{"x": x - 5 * step, "y": y - 5 * step}]) for step in range(1, 7)]
    page.evaluate("$('#results').setAttribute('aria-busy', 'true')")
    for kind, places in [*points, ("touchEnd", [])]:
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})
    finish(page)
    size, direction = page.evaluate("pulled()")
    assert 0 < size <= 1000 and 45 < direction < 135
    assert page.evaluate("scrollY") == scrolled


def test_no_force_is_pulled_where_none_acts(html, open_page):
    page = open_page(html, DESK)
    go_to(page, {"protocolCase": "c05.compliant.noise"})
    assert page.locator("#pull").count() == 0
    assert page.locator("#pull-text").inner_text() == "In this test no force acts."


def test_a_circle_larger_than_the_drawing_ends_at_its_frame(html, open_page):
    """It ran over the whole page where the errors are of a micrometre, and the arm's motion is magnified by 1000."""
    page = open_page(html, DESK)
    go_to(page, {"protocolCase": "c05.compliant.noise"})
    circle = "document.querySelector('#stage svg svg circle')"
    assert page.evaluate(f"{circle}.getBoundingClientRect().width > $('#stage').getBoundingClientRect().width")
    assert page.evaluate(f"getComputedStyle({circle}.ownerSVGElement).overflowX") == "hidden"
