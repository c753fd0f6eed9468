"""A linear model of the plant at a pose, for the design of controllers; and its loop with a controller, linear or
linearized at rest through its FMU."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller_fmu.errors import ControllerFmuError

from ..benchmark import loop_analysis
from ..benchmark.case import Case
from ..benchmark.linearization import INPUTS, OUTPUTS, Friction, Mode, Rest, linearized, modes, rest, sampled
from ..benchmark.loop_analysis import LoopMargins, StateSpace
from ..documents.document import Displayable
from ..documents.files import streamed, write_bytes
from ..documents.worst_page import margin_value
from ..errors import Crash, InputError
from ..execution.job import Died, Done
from ..execution.messages import error_of
from ..execution.supervision import run_isolated
from ..loop.scenario import NO_DELAY
from ..pairing import work
from ..pairing.controller import Controller
from ..pairing.pairing import FIRST_START_TIME
from ..pairing.runs import account
from ..pairing.testbed import Testbed
from ..search.findings import Margin
from ..views.table import Cell, Column, Note, Part, Quantity, Summary, Table, Value
from ..views.units import DEGREE, HERTZ, MILLIMETRE, MILLISECOND, NONE, TORQUE, Unit

# Imports inside functions: SciPy's files, Matplotlib and the package control are loaded by those who need them.

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class LinearModel(Displayable):
    """``dx/dt = A x + B u``, or the next ``x`` if there is a ``sample_time``, and ``y = C x + D u``; SI units.

    States, inputs and outputs are deviations from :attr:`at`, the steady state. With n states:

    Parameters
    ----------
    A, B, C, D : numpy.ndarray
        Shapes (n, n), (n, 6), (4, n), (4, 6); read-only. D is zero.
    states : tuple of str
        ``q_a``, ``q_m`` [rad], ``w_a``, ``w_m`` [rad/s] of both axes; then the torques under way if there is a delay.
    sample_time : float or None
        Of the samples [s]; None for a continuous model.
    at : Rest
        ``q_a``, ``q_m`` [rad], ``u_m`` [N.m] and ``X`` [m] at rest, a pair each.
    system : str
        Name of the system of the uncertainty description.
    friction : str
        ``"sticking"`` or ``"sliding"``, see :meth:`.Benchmark.linearize`.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    sample_time: float | None
    at: Rest
    system: str
    friction: Friction

    inputs = INPUTS
    """``u_m``, ``u_d`` [N.m] and ``F`` [N], two each."""
    outputs = OUTPUTS
    """``q_m`` [rad] and ``X`` [m], two each."""

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Frequency [Hz] and damping of the motions, slowest first."""
        return modes(self.A, self.sample_time)

    @property
    def title(self) -> str:
        """System, pose, friction and sampling in words."""
        angles = " / ".join(f"{math.degrees(angle):g}°" for angle in self.at.q_a)
        time = "continuous" if self.sample_time is None else f"sampled every {self.sample_time * 1e3:g} ms"
        return f"{self.system} system at {angles}, {self.friction}, {time}"

    @property
    def matrices(self) -> StateSpace:
        """The matrices and the sample time alone."""
        return StateSpace(self.A, self.B, self.C, self.D, self.sample_time)

    def plot(self, name: str = "plant_bode") -> Figure:
        """One of the figures ``plant_bode``, ``plant_step`` (of a sampled model) and ``poles``."""
        from ..documents.loop_figures import drawn

        return drawn(self.matrices, None, name)

    def save_plots(self, folder: str | Path) -> list[str]:
        """Write all figures into ``folder`` as PDF, SVG and PNG; returns their names without endings."""
        from ..documents.figures import write_drawn
        from ..documents.loop_figures import drawings

        return write_drawn(drawings(self.matrices, None), Path(folder))[0]

    def to_control(self) -> Any:
        """The model as a ``control.StateSpace``. Needs the package control (the extra ``design``)."""
        import control

        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, self.sample_time or 0, **names)

    def save(self, file: str | Path) -> Path:
        """Write A, B, C, D, T_s (0 if continuous), the names and the steady state into a ``.mat`` or ``.npz`` file."""
        from scipy.io import savemat

        file = Path(file)
        contents = {name: getattr(self, name) for name in "ABCD"} | {"T_s": self.sample_time or 0.0}
        contents |= {f"{name}_rest": np.array(pair) for name, pair in self.at._asdict().items()}
        names = {name: getattr(self, name) for name in ("states", "inputs", "outputs")}
        if file.suffix == ".npz":
            write_bytes(file, streamed(lambda stream: np.savez_compressed(stream, **contents, **names)))
        elif file.suffix == ".mat":
            cells = {name: np.array(value, dtype=object) for name, value in names.items()}
            write_bytes(file, streamed(lambda stream: savemat(stream, {**contents, **cells}, oned_as="column")))
        else:
            raise InputError(f"{file} ends neither in .mat nor in .npz.", "bad-ending", file, file.suffix)
        return file

    def summary(self) -> Summary:
        """Where it is linearized, and frequencies and damping of its motions."""
        units = {"q_a": DEGREE, "q_m": DEGREE, "u_m": TORQUE, "X": MILLIMETRE}
        rest: tuple[tuple[Cell, ...], ...] = tuple(
            (Quantity(name, units[name]), *(Value(value, unit=units[name]) for value in pair))
            for name, pair in self.at._asdict().items()
        )
        modes = tuple((mode.frequency, mode.damping) for mode in self.modes)
        parts = (
            Table("Steady state", (Column(""), Column("first"), Column("second")), rest),
            Table("Modes", (Column("frequency", HERTZ), Column("damping")), modes),
            Note(f"{len(self.states)} states: {', '.join(self.states)}", warning=False),
        )
        return Summary("Linear model", self.title, parts)

    def __repr__(self) -> str:
        return f"LinearModel({self.title}: {len(self.A)} states)"


def linear_model(case: Case, is_sampled: bool, delay: bool, friction: Friction) -> LinearModel:
    """The linear model of a case's plant, see :meth:`.Benchmark.linearize`."""
    scenario, pose = case.scenario, case.configuration
    if friction not in ("sticking", "sliding"):
        message = f"Friction is either sticking or sliding, not {friction}."
        raise InputError(message, "bad-friction", "friction", friction, ("sticking", "sliding"))
    if scenario.sensor.delay != NO_DELAY:
        raise InputError("A linear model has no delay of the measurement.", "sensor-delay")
    if scenario.drive.dropout or scenario.sensor.jitter:
        raise InputError("A linear model has neither dropped samples nor jitter.", "random-timing")
    parameters = dict(scenario.parameters)
    at = rest(parameters, (pose.q_a1, pose.q_a2))
    model, T_s = linearized(parameters, at, friction, scenario.drive.gain), None
    if is_sampled:
        T_s = float(scenario.sample_time)
        model = sampled(model, scenario.sample_time, scenario.drive.delay if delay else NO_DELAY)
    for matrix in model[:4]:
        # The model is frozen; an array in it would not be.
        matrix.flags.writeable = False
    return LinearModel(*model, T_s, at, case.system.name, friction)


MATRICES = (".mat", ".npz", ".json")
"""Endings of files with a controller's matrices."""

IMPULSE_SAMPLES, MOTION_SAMPLES = 8001, 4000
"""Samples of the impulse response that a controller is known by, and of the random motion it is checked with."""

IMPULSE_ERROR, MOTION_ERROR = 1e-4, 3e-5
"""Error of the impulse and largest error of the random motion [rad]: far above rounding, far below saturation."""

EXACT_MISMATCH, MAX_MISMATCH = 1e-6, 0.05
"""Relative differences: at which more states are of no use, and beyond which a controller is not linear at rest."""


@dataclass(frozen=True, eq=False)
class LinearLoop(Displayable):
    """A linear model of the plant in a loop with a linear controller, e = q_m_ref - q_m, u_m = u_m0 + K e.

    Parameters
    ----------
    model : LinearModel
        The plant, sampled with the controller's sample time and with the loop's delay.
    name : str
        File name of the controller.
    controller : StateSpace
        Matrices A, B, C, D of the controller, from e [rad] to u_m - u_m0 [N.m], and its sample time ``T_s`` [s].
    mismatch : float or None
        Largest difference between the torques of the FMU and of these matrices in a random motion, relative to the
        largest torque; None if the matrices were given.
    """

    model: LinearModel
    name: str
    controller: StateSpace
    mismatch: float | None

    @property
    def plant(self) -> StateSpace:
        """The model's matrices."""
        return self.model.matrices

    @property
    def closed(self) -> StateSpace:
        """The closed loop: from q_m_ref [rad], u_d [N.m], F [N] to q_m [rad], X [m], u_m [N.m], two each."""
        return loop_analysis.closed(self.plant, self.controller)

    @property
    def stable(self) -> bool:
        """Whether no pole of the closed loop is outside the unit circle."""
        return loop_analysis.is_stable(self.closed)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Frequency [Hz] and damping of the closed loop's motions, slowest first."""
        return modes(self.closed.A, self.closed.T_s)

    @property
    def margins(self) -> tuple[LoopMargins, LoopMargins]:
        """Margins of axis 1 and 2, each with the other loop closed; raises :class:`InputError` if the loop is
        unstable, which has none."""
        if not self.stable:
            raise InputError(f"The loop of {self.title} is unstable: it has no margins.", "unstable-loop", self.name)
        first, second = (loop_analysis.margins(self.plant, self.controller, axis) for axis in (0, 1))
        return first, second

    @property
    def title(self) -> str:
        """Controller, system, pose, friction and sampling in words."""
        return f"{self.name}, {self.model.title}"

    def plot(self, name: str = "loop_sensitivity") -> Figure:
        """One of the figures ``plant_bode``, ``plant_step``, ``poles``, ``loop_bode``, ``loop_nichols``,
        ``loop_sensitivity``, ``loop_step``."""
        from ..documents.loop_figures import drawn

        return drawn(self.plant, self.controller, name)

    def save_plots(self, folder: str | Path) -> list[str]:
        """Write all figures into ``folder`` as PDF, SVG and PNG; returns their names without endings."""
        from ..documents.figures import write_drawn
        from ..documents.loop_figures import drawings

        return write_drawn(drawings(self.plant, self.controller), Path(folder))[0]

    def summary(self) -> Summary:
        """Margins and motions of the loop."""
        return self.beside({})

    def beside(self, found: Mapping[str, Margin]) -> Summary:
        """The same with margins that a search :attr:`.Robustness.margins` has ``found``, by name."""
        parts: list[Part] = []
        if self.stable:
            parts += [_margin_table(self.margins, found), Note(MARGINS_NOTE, warning=False)]
        else:
            parts.append(Note("The linear loop is unstable: it has no margins."))
        rows = tuple((mode.frequency, mode.damping) for mode in self.modes)
        parts.append(Table("Modes of the loop", (Column("frequency", HERTZ), Column("damping")), rows))
        if self.mismatch is not None:
            words = f"The FMU was linearized at rest as {len(self.controller.A)} states, by its impulse response"
            text = f"{words}; in a random motion, its torques differ by {self.mismatch:.1g} of the largest one."
            parts.append(Note(text, warning=False))
        return Summary("Linear loop", self.title, tuple(parts))

    def __repr__(self) -> str:
        return f"LinearLoop({self.title}: {len(self.closed.A)} states)"


MARGINS_NOTE = (
    "Each axis with the other loop closed, broken at its torque; S is its sensitivity. The margins of the linear model "
    "are those of this arm, at this pose, near rest. Those of a search are the smallest that were found over all arms "
    "and poses, with friction, limits and quantization."
)


def _margin_table(margins: tuple[LoopMargins, LoopMargins], search_margins: Mapping[str, Margin]) -> Table:
    """Margins of both axes, and those of a search where there are some."""
    lines: tuple[tuple[str, str, str, Unit], ...] = (
        ("gain", "gain", "gain_{}", NONE),
        ("gain_down", "gain, reduced", "gain_{}_down", NONE),
        ("phase", "phase", "", DEGREE),
        ("delay", "additional delay", "delay_{}", MILLISECOND),
        ("sensitivity", "largest |S|", "", NONE),
        ("frequency", "its frequency", "", HERTZ),
    )
    rows: list[tuple[Cell, ...]] = []
    for field, words, searched, unit in lines:
        cells: list[Cell] = [Value(getattr(axis, field), unit=unit) for axis in margins]
        if search_margins:
            of_search = [search_margins.get(searched.format(axis)) for axis in (1, 2)]
            cells += [None if margin is None else margin_value(searched, margin) for margin in of_search]
        rows.append((Quantity(words, unit), *cells))
    columns = [Column("unstable at"), Column("axis 1"), Column("axis 2")]
    columns += [Column("axis 1, search"), Column("axis 2, search")] if search_margins else []
    return Table("Stability margins", tuple(columns), tuple(rows))


def linear_loop(testbed: Testbed, controller: Any, case: Case, friction: Friction) -> LinearLoop:
    """See :meth:`.Benchmark.linear_loop`."""
    if isinstance(controller, str | Path) and Path(controller).suffix in MATRICES or hasattr(controller, "A"):
        return _given(controller, case, friction)
    chosen = Controller.of(controller)
    pairing, sampled = testbed.sampled(chosen, case)
    model = linear_model(sampled, True, True, friction)
    T_s, at = sampled.scenario.sample_time, model.at
    impulses = np.zeros((2, IMPULSE_SAMPLES, 2))
    impulses[(0, 1), 0, (0, 1)] = IMPULSE_ERROR
    # Noise excites all states. A controller with a dead zone or a limit answers it otherwise than its impulse says.
    motion = MOTION_ERROR * np.random.default_rng(1).uniform(-1.0, 1.0, (MOTION_SAMPLES, 2))
    experiments = [np.zeros((IMPULSE_SAMPLES, 2)), *impulses, motion]
    job = pairing.raw_job(
        f"{work.__name__}:{work.answer.__name__}",
        [work.AnswerTask(pairing.setup, at.q_m, at.u_m, at.q_a, T_s, errors) for errors in experiments],
        (FIRST_START_TIME + pairing.timeout,) * len(experiments),
        lambda index, value: work.answered(len(experiments[index]), value),
        IMPULSE_SAMPLES * 32,
    )
    torques = {}
    for outcome in run_isolated(job):
        if isinstance(outcome, Died):
            raise Crash(account(outcome, sampled.scenario), "killed" if outcome.outside else "")
        if not isinstance(outcome, Done):
            raise error_of(outcome.error)
        torques[outcome.index] = outcome.value
    rest, first, second, moved = (torques[number] for number in range(len(experiments)))
    # Less what it answers at rest: a controller with dither is linear beside that.
    impulse = np.stack([first - rest, second - rest], axis=2) / IMPULSE_ERROR
    law, mismatch = _realized(impulse, float(T_s), motion, moved - rest[:MOTION_SAMPLES])
    if not mismatch <= MAX_MISMATCH:
        message = f"{chosen.file_name} is not linear at rest: in a random motion of {MOTION_ERROR:g} rad, its torques "
        message += f"differ by {mismatch:.1g} of the largest one from a linear law."
        raise InputError(message, "not-linear", chosen.file_name)
    return LinearLoop(model, chosen.file_name, law, mismatch)


def _realized(impulse: np.ndarray, T_s: float, motion: np.ndarray, torques: np.ndarray) -> tuple[StateSpace, float]:
    """The smallest system that repeats the ``torques`` of a ``motion`` exactly, or the one that does it best, and the
    relative difference that remains."""
    from ..benchmark.loop_analysis import realizations, simulated

    best: tuple[float, StateSpace] | None = None
    largest = float(np.abs(torques).max())
    for system in realizations(impulse, T_s):
        with np.errstate(over="ignore", invalid="ignore"):  # one with too few states may run away
            difference = float(np.abs(simulated(system, motion) - torques).max()) / largest
        if best is None or difference < best[0]:
            best = difference, system
        # The smallest one: more states would be fitted to rounding.
        if difference < EXACT_MISMATCH:
            break
    assert best is not None
    return best[1], best[0]


def _given(controller: Any, case: Case, friction: Friction) -> LinearLoop:
    """The loop with a controller of matrices: of a schedule, the one of the nearest point."""
    from controller_fmu.export.systems import contents, stacked

    is_file = isinstance(controller, str | Path)
    name = Path(controller).name if is_file else type(controller).__name__
    try:
        system = contents(Path(controller)) if is_file else controller
        laws = stacked(system, None, None, None, None, None, unstable=True)
    except ControllerFmuError as problem:
        raise InputError(str(problem), "bad-system", problem.where or name, problem.value, problem.nearest) from None
    T_s = Fraction(repr(laws.T_s))
    sampled = replace(case, scenario=replace(case.scenario, sample_time=T_s))
    model = linear_model(sampled, True, True, friction)
    points = np.asarray(system.get("points", np.zeros((len(laws.A), 2))) if is_file else np.zeros((1, 2)), dtype=float)
    if points.shape != (len(laws.A), 2):
        raise InputError(f"{name} has {len(laws.A)} controllers, and no point for each.", "bad-system", name, "points")
    nearest = int(np.argmin(np.sum((points - np.array(model.at.q_m)) ** 2, axis=1)))
    A, B, C, D = (matrix[nearest] for matrix in laws[:4])
    return LinearLoop(model, name, StateSpace(A, B, C, D, laws.T_s), None)
