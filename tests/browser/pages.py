"""The pages that tests look at, of runs made by hand, and how these are read."""

import functools
import json
from dataclasses import replace

import numpy as np
from msgspec.structs import replace as changed
from support.reports import hunted, recording, results_of, scaled, searched, seeded, spread, swept, tuned
from support.results import RULES, TABLE_2, everything, result, trajectory

from orchestrator import Benchmark
from orchestrator.documents.comparison import grouped
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.recording import Recording
from orchestrator.documents.simulations import PlottedSimulation
from orchestrator.documents.simulations import page as simulation_page
from orchestrator.loop.trajectory import Status
from orchestrator.views.page import page_html
from orchestrator.views.table import Note

DESKTOP, PHONE = (1280, 900), (390, 844)
EVIL = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
WORST, CHIRPED = "c17.compliant.disturbance", "c05.random_1.disturbance"
UNSTABLE = result(3, "sticky", "delay_2", None, None, Status.UNSTABLE, EVIL + "left the workspace " * 12)
CYCLES = {"gain_2": 25e-6, "gain_1": 3e-6, "delay_1": 1e-10}
SPREAD = {"compliant": 6e-3, "random_1": 3e-3, "random_2": 11e-3, "random_3": 4e-3}
GAINS = [0.6 + 0.2 * number for number in range(8)]


def lively(roles=("B5",), **changes) -> Recording:
    """A recording whose TCP moves differently along x and z, and whose links and torques differ."""
    made = recording(roles, **changes)
    t = made.motion[:, 0]
    decay = np.exp(-np.clip(t - 10, 0, None)) * (t > 9.99)
    chirp = np.where((t > 0.5) & (t < 8), 1e-3 * np.sin(2 * np.pi * t), 0)
    motion = np.column_stack([t, 8e-3 * decay + chirp, -2e-3 * decay * np.cos(t), 3e-3 * decay, -5e-3 * decay])
    torque = np.column_stack([t, 3 * np.sin(t), 7 * np.cos(t)])
    return replace(made, motion=motion.astype(np.float32), torque=torque.astype(np.float32))


def ended(entry: Recording, time: float) -> Recording:
    """The recording of a case that ended unstable."""
    motion, torque = (table[table[:, 0] <= time] for table in (entry.motion, entry.torque))
    about = changed(entry.about, status=Status.UNSTABLE, time=time)
    return replace(entry, about=about, motion=motion, torque=torque)


CHANGED = (
    UNSTABLE,
    result(5, "random_1", "disturbance", {**TABLE_2, "B5": 6e-3, "B7": 2e-3}),
    *(result(7, "slippery", test, {}, cycle) for test, cycle in CYCLES.items()),
)
OTHER = {case.id: case for case in CHANGED}
CASES = [case for index in range(18) for case in everything({**TABLE_2, "B5": 1e-3 * (index + 1)}, [index])]
RESULTS = results_of(
    [OTHER.get(case.id, case) for case in CASES],
    controller={"file": EVIL, "path": EVIL, "generation_tool": EVIL, "parameters": {EVIL: 1.0}},
)
RECORDINGS = (
    lively(("B5", "B6"), id=WORST),
    recording(("B7",), CHIRPED),
    recording(("example",), system=EVIL),
    *(spread(size, system) for system, size in SPREAD.items()),
)
ENDS = (0.27, 5.0, 12.0, 26.0)
"""When the cases of :func:`ended_report` ended [s]."""


@functools.cache
def report() -> str:
    """A whole run, of a controller with a hostile name; one case is unstable, and some have limit cycles."""
    return page_html(Evaluation(RESULTS, RECORDINGS).page())


@functools.cache
def ended_report() -> str:
    """A run of cases that ended early; that of the spread does so before its first disturbance."""
    cases = (ended(recording(("B5",), f"c0{n}.compliant.disturbance"), end) for n, end in enumerate(ENDS))
    recordings = (*cases, spread(6e-3, "compliant"), ended(spread(3e-3, "random_1"), ENDS[0]))
    return page_html(Evaluation(results_of(), recordings).page())


@functools.cache
def empty_report() -> str:
    """A run of one case, without trajectories."""
    return page_html(Evaluation(results_of(everything(TABLE_2)[:1])).page())


def compared(number: int) -> Evaluation:
    """A run with gain K that all its figures are proportional to; the last one has another seed."""
    gain = GAINS[number]
    recordings = tuple(recording((name,), size=gain * 8e-3) for name in ("B5", "B6", "B7"))
    return Evaluation(scaled(gain, controller={"file": EVIL}, seed=int(number == 7)), recordings)


COMPARED = tuple(map(compared, range(8)))


@functools.cache
def comparison() -> str:
    """Seven runs that are ranked together, one without a rank, one that must not be ranked with them; spreads over
    seeds, a search, a tuning, and a sweep."""
    unfinished = Evaluation(results_of(everything(TABLE_2)[:1], controller={"file": "Unfinished.fmu"}))
    spreads = (seeded(gain, range(gain > 0.9, 5), file=EVIL) for gain in GAINS[:3])
    others = (*spreads, searched(GAINS[0], file=EVIL), tuned(file=EVIL), swept(4, file=EVIL))
    return page_html(grouped([(each, None) for each in (*COMPARED, unfinished, *others)]).page())


@functools.cache
def worst_case() -> str:
    """A search for the worst case, of a controller with a hostile name."""
    found, recordings = hunted(file=EVIL, path=EVIL)
    return page_html(found.page(recordings))


@functools.cache
def tuning() -> str:
    """A tuning of a controller with a hostile name."""
    return page_html(tuned(file=EVIL, path=EVIL).page())


@functools.cache
def sweep() -> str:
    """A sweep of a controller with a hostile name: a table, and a plot that needs no script of its own."""
    return page_html(swept(30, file=EVIL, path=EVIL).page())


def simulations() -> str:
    """Two simulations over each other, the second of which ended before the first."""
    case = Benchmark().case(WORST)
    shown = []
    for name, size, end in ((EVIL, 8e-3, 26.0), ("other.fmu --gain 2 1", 3e-3, 12.0)):
        made = trajectory(lambda t, size=size: size * np.sin(3 * t), 1e-3, (lambda t: 3 * np.sin(t), 4.0), duration=end)
        angles = {f"q_a[{axis}]": 0.1 * np.sin(made.time) for axis in (1, 2)}
        shown.append(
            PlottedSimulation(name, case, replace(made, extra=angles), f"simulate {EVIL}", f"at most {size} m")
        )
    return page_html(simulation_page(EVIL, EVIL, RULES, shown, (Note("a remark"),)))


def show(page, name: str) -> None:
    """Show a view by its tab."""
    page.locator(f"#tab-{name}").click()
    assert page.locator(f"#{name}").is_visible()
    assert page.locator('[role="tabpanel"]:visible').count() == 1


def chart(name: str) -> str:
    """JavaScript for a chart."""
    return f"echarts.getInstanceByDom(document.getElementById('{name}'))"


def shown(page, ending: str) -> str:
    """The id of the chart in sight whose id has this ending."""
    return page.locator(f'.chart[id$="-{ending}"]:visible').get_attribute("id")


def zoom(page, name: str, x: list[float], top: float | None = None) -> None:
    """Show a part of a chart."""
    page.evaluate(f"zoomTo({chart(name)}, {json.dumps({'x': x, 'y': [None, top]})})")


def legend(page, name: str) -> list[str]:
    """The names in the legend of a chart."""
    return [entry["name"] for entry in option(page, name)["legend"][0]["data"]]


def option(page, name: str) -> dict:
    """What ECharts was given to draw."""
    return json.loads(page.evaluate(f"JSON.stringify({chart(name)}.getOption())"))  # as text, which is faster


def series(page, name: str) -> dict[str, list]:
    """The data of the named lines of a chart; of those that share a name, the first."""
    return {line["name"]: line["data"] for line in reversed(option(page, name)["series"])}


def text(page, selector: str) -> str:
    """The text of the one element that a selector matches."""
    return page.locator(selector).inner_text()
