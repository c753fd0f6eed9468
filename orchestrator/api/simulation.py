"""One case: simulated, with the result as a user holds it, or written for another tool."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from msgspec.structs import asdict

from ..benchmark import cases as case_list
from ..benchmark.case import CRITERIA, Case
from ..benchmark.linearization import rest
from ..benchmark.metrics import AT_THE_END, case_result
from ..benchmark.results import CaseResult, Kind, Rules, rules
from ..benchmark.scorecard import kind
from ..bounded import MAX_RESULT_BYTES, read
from ..codec import Malformed, Struct, pack, unpack
from ..documents.document import Displayable
from ..documents.files import check_result, write_bytes
from ..entry import entered
from ..errors import InputError
from ..fmi.archive import open_archive
from ..loop.trajectory import Ending, Status, Trajectory
from ..pairing.built_in import AUTO, NATIVE, PYTHON, built_in
from ..pairing.controller import Controller
from ..pairing.pairing import simulate_case
from ..pairing.testbed import Testbed
from ..views.table import Cell, Column, Note, Page, Part, Quantity, Summary, Table, Value
from ..views.units import HERTZ, MICROMETRE, MILLIMETRE, NONE, SECOND, SHOWN, Unit, number

# Imports inside functions: Matplotlib, pandas, lxml and Numba are loaded by those who need them.

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from ..documents.ssp import Order

UNITS = {name: SHOWN[unit] for name, unit in CRITERIA.items()}
UNITS |= {"recovery": SECOND, "limit_cycle": MICROMETRE, "rest_error": MILLIMETRE}
UNITS |= {"limit_cycle_ratio": NONE, "limit_cycle_frequency": HERTZ}
"""Units that the figures of a simulation are shown in."""


class _Saved(Struct, frozen=True):
    case: Case
    controller: str
    trajectory: Trajectory
    result: CaseResult
    varied: bool
    kind: Kind
    rules: Rules
    cut_short: bool


@dataclass(frozen=True)
class Simulation(Displayable):
    """Sampled signals of one simulation with N samples, in SI units; times t_k = k T_s.

    Parameters
    ----------
    case : Case
        What was simulated; ``case.scenario`` holds every number.
    controller : str
        File name of the controller.
    trajectory : Trajectory
        The signals; see there for more than this class shows.
    result : CaseResult
        Criteria and what the end is judged by.
    varied : bool
        Whether the scenario was varied, so that it is not a case of the protocol any more.
    kind : str
        What it came to: ``"quiet"``, ``"ring-down"``, ``"limit cycle"``, ``"unstable"`` or ``"no verdict"``.
    rules : Rules
        What the protocol asks for.
    cut_short : bool
        Whether the simulation was to end before the test does, so that there is no verdict.
    """

    case: Case
    controller: str
    trajectory: Trajectory
    result: CaseResult
    varied: bool
    kind: Kind
    rules: Rules
    cut_short: bool

    @property
    def time(self) -> np.ndarray:
        """Shape (N + 1,) [s]."""
        return self.trajectory.time

    @property
    def q_m(self) -> np.ndarray:
        """Motor angles, shape (N + 1, 2) [rad]."""
        return self.trajectory.q_m

    @property
    def q_a(self) -> np.ndarray:
        """Link angles, shape (N + 1, 2) [rad]."""
        return np.column_stack([self.trajectory.extra["q_a[1]"], self.trajectory.extra["q_a[2]"]])

    @property
    def X(self) -> np.ndarray:
        """Position of the tool centre point, shape (N + 1, 2) [m]."""
        return self.trajectory.X

    @property
    def tcp_error(self) -> np.ndarray:
        """Distance of the tool centre point from where it began, shape (N + 1,) [m]."""
        return self.trajectory.tcp_error

    @property
    def command(self) -> np.ndarray:
        """Torques as the controller asked for them, shape (N, 2) [N.m]."""
        return self.trajectory.command

    @property
    def torque(self) -> np.ndarray:
        """Torques as they left for the drive: saturated and quantized, shape (N, 2) [N.m]."""
        return self.trajectory.torque

    @property
    def ending(self) -> Ending:
        """How the simulation ended: ``status``, ``time`` [s], ``message``."""
        return self.trajectory.ending

    @property
    def title(self) -> str:
        """Controller, system, pose and test in words."""
        pose = self.case.configuration
        angles = " / ".join(f"{math.degrees(angle):g}°" for angle in (pose.q_a1, pose.q_a2))
        return f"{self.controller}, {self.case.system.name} system at {angles}, {self.case.test.name}"

    def columns(self) -> Mapping[str, np.ndarray]:
        """All signals by name with unit, each of shape (N + 1,); torques of the last instant, not computed, are NaN."""
        from ..documents.simulations import columns

        return columns(self.trajectory, self.case.scenario)

    def to_pandas(self) -> pandas.DataFrame:
        """:meth:`columns` as a table. Needs the package pandas (the extra ``pandas``)."""
        from pandas import DataFrame

        return DataFrame(self.columns())

    def plot(self, figure: Figure | None = None) -> Figure:
        """TCP error [mm] and torques [Nm] over time, in the paper's axes, in ``figure`` or a new one."""
        from ..documents.simulations import plot

        return plot(self.trajectory, self.case.scenario, self.title, figure)

    def save(self, file: str | Path) -> Path:
        """Write the simulation into ``file``; :meth:`load` reads it. The signals alone: see :meth:`columns`."""
        check_result(Path(file))
        write_bytes(Path(file), pack(_Saved(**vars(self))))
        return Path(file)

    @classmethod
    @entered
    def load(cls, file: str | Path) -> Simulation:
        """The simulation that was saved in ``file``; raises :class:`InputError` if it is damaged or not there."""
        try:
            saved = unpack(read(Path(file), MAX_RESULT_BYTES), _Saved)
        except Malformed as problem:
            raise InputError(f"{file} does not hold a simulation: {problem}.", "damaged", file) from None
        return cls(**asdict(saved))

    def summary(self) -> Summary:
        """How it ended, and what was measured."""
        return _summary({"value": self}, self.title, self._ended)

    def page(self) -> Page:
        """Time plots with zoom, the arm moving, and the summary."""
        return overlay({self.controller: self})

    @property
    def _cut_short_words(self) -> str:
        whole = f"before the test does ({float(self.case.test.duration):g} s)"
        end = f"The simulation ends at {self.ending.time:g} s, {whole}: there is no verdict"
        return f"{end}, and the figures are those of this part alone."

    @property
    def _outcome(self) -> str:
        """What it came to: how it ended, the verdict if there is one, the largest error, and what is furthest from its
        target."""
        largest = int(np.argmax(self.tcp_error))
        error, at = number(float(self.tcp_error[largest]), MILLIMETRE.factor), number(float(self.time[largest]))
        words = [f"the TCP error is at most {error} mm, at {at} s"]
        if self.result.status is not Status.DONE:
            words.insert(0, self._ended)
        elif self.case.test.requirements and not self.cut_short:
            words.insert(0, f"the verdict is {self.kind}")
        figures = ((name, spec, getattr(self.result.measurements, name)) for name, spec in self.rules.criteria.items())
        if measured := [(value / spec.target, name) for name, spec, value in figures if value is not None]:
            ratio, name = max(measured)
            words.append(f"{name} is {number(ratio)} times its target, the most of all")
        return "; ".join(words)

    @property
    def _ended(self) -> str:
        message = f": {self.result.message}" if self.result.message else ""
        return f"{self.result.status.value} at {self.ending.time:g} s{message}"

    def _repr_html_(self) -> str:
        from ..views.drawing import png
        from ..views.page import fragment  # as in Displayable

        return fragment(self.summary(), png(self.plot()))

    def __repr__(self) -> str:
        return f"Simulation({self.title}: {self.result.status.value} at {self.ending.time:g} s)"


def overlay(simulations: Mapping[str, Simulation], commands: Mapping[str, str] | None = None) -> Page:
    """The page of simulations by name, their signals over each other; ``commands`` repeat them."""
    from ..documents.simulations import PlottedSimulation, page

    repeat = commands or {}
    first, *others = simulations.values()
    shown = [
        PlottedSimulation(name, simulation.case, simulation.trajectory, repeat.get(name, ""), simulation._outcome)
        for name, simulation in simulations.items()
    ]
    title = f"{len(simulations)} simulations" if others else first.title
    kicker = ", ".join(simulations) if others else first._ended
    return page(title, kicker, first.rules, shown, beside(simulations).parts)


def beside(simulations: Mapping[str, Simulation]) -> Summary:
    """What was measured of simulations by name, in a column each."""
    first, *others = simulations.values()
    if not others:
        return first.summary()
    return _summary(simulations, f"{len(simulations)} simulations", f"{first.case.id} and others")


def _summary(simulations: Mapping[str, Simulation], title: str, kicker: str) -> Summary:
    """The figures of each in a column, and what must be known about them."""
    several = len(simulations) > 1
    rows: list[tuple[Cell, ...]] = []
    for name, unit in UNITS.items():
        cells = [_figure(simulation, name, unit) for simulation in simulations.values()]
        if any(cell is not None for cell in cells):
            rows.append((Quantity(name.replace("_", " "), unit), *cells))
    largest = (Value(float(simulation.tcp_error.max()), unit=MILLIMETRE) for simulation in simulations.values())
    rows.append((Quantity("largest TCP error", MILLIMETRE), *largest))
    if several:
        rows.append(
            (
                "verdict",
                *(simulation.kind if simulation.case.test.requirements else "-" for simulation in simulations.values()),
            )
        )
        rows.append(
            (
                "ended",
                *(
                    f"{simulation.result.status.value}, {simulation.ending.time:g} s"
                    for simulation in simulations.values()
                ),
            )
        )
    parts: list[Part] = [Table("Measured", (Column("quantity"), *map(Column, simulations)), tuple(rows))]
    for name, simulation in simulations.items():
        who = f"{name}: " if several else ""
        if simulation.cut_short:
            parts.append(Note(who + simulation._cut_short_words))
        elif simulation.case.test.requirements and not several:
            until = simulation.result.judged_until
            later = f", judged until {until:g} s" if until is not None and until > simulation.ending.time else ""
            parts.append(Note(f"verdict: {simulation.kind}{later}", warning=False))
    return Summary(title, kicker, tuple(parts))


def _figure(simulation: Simulation, name: str, unit: Unit) -> Cell:
    """A figure; a settling time that the end of the simulation has cut off is a limit."""
    figures = simulation.result.measurements
    value = getattr(figures, name)
    if value is None:
        return None
    return Value(value, unit=unit, beyond=">" if name == "B6" and figures.settled is False else "")


def simulate(testbed: Testbed, controller: Controller, case: Case | str) -> Simulation:
    """See :meth:`.Benchmark.simulate`."""
    pairing, sampled = testbed.sampled(controller, case)
    scenario = sampled.scenario
    simulated = simulate_case(pairing, testbed.rules, sampled)
    ending, cut_short = simulated.trajectory.ending, scenario.duration < sampled.test.duration
    result = case_result(sampled, simulated.judgement)
    if cut_short:  # what is judged at the end of a test is judged at another time here, which means nothing
        figures = msgspec.structs.replace(result.measurements, **dict.fromkeys(AT_THE_END))
        changes = {"status": ending.status, "message": ending.message, "measurements": figures, "judged_until": None}
        result = msgspec.structs.replace(result, **changes)
    plain = case_list.case(testbed.rules, sampled.configuration, sampled.system, sampled.test, testbed.seed).scenario
    # The controller's sample time alone makes no other case: an evaluation has it, too.
    varied = replace(plain, sample_time=scenario.sample_time) != scenario
    verdict = "no verdict" if cut_short and ending.status is Status.DONE else kind(result, testbed.rules.stability)
    return Simulation(
        sampled,
        pairing.controller.name,
        simulated.trajectory,
        result,
        varied,
        verdict,
        rules(testbed.rules),
        cut_short,
    )


def export_ssp(testbed: Testbed, controller: Controller, case: Case | str, file: Path, order: Order) -> None:
    """See :meth:`.Benchmark.export_ssp`."""
    from ..documents.ssp import package
    from ..loop.controller import Steady  # loads Numba

    check_result(file)
    if testbed.plant not in (AUTO, PYTHON, NATIVE):
        message = f"The package holds the benchmark's manipulator, in the place of {testbed.plant}: leave that out."
        raise InputError(message, "no-ssp", testbed.plant)
    pairing, sampled = testbed.sampled(controller, case)
    scenario, pose = sampled.scenario, sampled.configuration
    at = rest(dict(scenario.parameters), (pose.q_a1, pose.q_a2))
    plant, imperfections = (open_archive(built_in(name)) for name in ("FlexibleManipulatorNative", "Imperfections"))
    steady = Steady(at.q_m, at.u_m, at.q_a)
    write_bytes(file, package(plant, imperfections, pairing.controller, pairing.setup, scenario, steady, order))
