"""A linear model of the plant at a pose, for the design of controllers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.case import Case
from ..benchmark.linearization import INPUTS, OUTPUTS, Friction, Mode, Rest, linearized, modes, rest, sampled
from ..benchmark.loop_analysis import StateSpace
from ..documents.document import Displayable
from ..documents.files import streamed, write_bytes
from ..errors import InputError
from ..loop.scenario import NO_DELAY
from ..views.table import Cell, Column, Note, Quantity, Summary, Table, Value
from ..views.units import DEGREE, HERTZ, MILLIMETRE, TORQUE

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
