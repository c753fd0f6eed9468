"""The arm as a Gymnasium environment, ``FlexibleManipulator-v1``: the benchmark's own loop, a sample at a time.

>>> import gymnasium, orchestrator.gym
>>> env = gymnasium.make("FlexibleManipulator-v1", duration=2.0)  # doctest: +SKIP
>>> observation, info = env.reset(seed=0, options={"case": "c00.compliant.disturbance"})  # doctest: +SKIP
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numba
import numpy as np
from gymnasium.spaces import Box

from controller_fmu.starters.policy.manipulator_observation import SIZE, Observation

from .api.benchmark import Benchmark
from .benchmark.case import Case
from .benchmark.variation import Variation
from .cache import compiled_code_folder
from .documents.recording import OBSERVED
from .entry import entered
from .errors import FmuError, InputError
from .loop.trajectory import Status, Trajectory

# Imports inside functions: the loop's compiler is loaded when the first episode begins, Matplotlib by who renders.

if TYPE_CHECKING:
    from .loop.stepwise import Stepwise

ID = "FlexibleManipulator-v1"


class FlexibleManipulator(gymnasium.Env[np.ndarray, np.ndarray]):
    """One episode is one simulation of the benchmark, with all its disturbances and imperfections.

    An observation is that of ``Observation`` in ``manipulator_observation.py``, shape (8,). An action is the torque
    [N.m] to add to that of the steady state, shape (2,): a policy that is trained here is the same as an FMU.

    The reward of a step is minus the TCP error [mm] times the sample time [s]; when the benchmark gives the simulation
    up as unstable, the rest of the episode counts with the distance at which it does. So the return is minus the
    integral of the TCP error over the episode, [mm.s]. Then the episode is ``terminated``; at its end, it is
    ``truncated``, and the last observation is that of the sample before, as nothing is measured any more.

    ``info`` has the case ``"case"`` and the ``"seed"`` of its random system and noise, the time ``"t"`` [s], and what
    no controller sees: the position of the tool ``"X"`` [m] and its ``"tcp_error"`` [m].

    Parameters
    ----------
    protocol : str or path
        Whose cases are drawn, as in :class:`Benchmark`.
    duration : float, optional
        Of an episode [s]; by default that of the case.
    render_mode : str, optional
        ``"rgb_array"``: :meth:`render` gives a picture; ``"human"``: a window of Matplotlib shows 25 a second of the
        simulation.
    **options
        ``plant`` and ``plant_parameters`` of :class:`Benchmark`.
    """

    trajectory: Trajectory | None = None
    """The last episode's signals, once it has ended."""

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 25}

    @entered
    def __init__(
        self,
        protocol: str | Path = "paper",
        duration: float | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            modes = self.metadata["render_modes"]
            message = f"There is no render mode {render_mode}. Modes: {', '.join(modes)}."
            raise InputError(message, "no-render-mode", "render_mode", render_mode, modes)
        self.render_mode = render_mode
        self._figure: Any = None
        self._bench = Benchmark(protocol, **options)
        self._ids = [case.id for case in self._bench.cases]
        self._variation = Variation(duration=duration)  # type: ignore[arg-type]  # exact there
        limit = np.array(self._bench.rules.loop.torque_limit)
        self.action_space = Box(-2.0 * limit, 2.0 * limit, dtype=np.float64)  # whatever u_m0 is, all torques
        self.observation_space = Box(-np.inf, np.inf, (SIZE,), np.float64)
        self._plant: Any = None
        self._simulation: Stepwise | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the arm is at rest.

        Without ``options`` it is a case drawn from the protocol, with a base seed drawn for its random system and
        noise. ``options={"case": ...}`` says which: a case's name, such as ``"c07.compliant.disturbance"`` (with the
        base seed 0), or a :class:`Case` of ``Benchmark.case_at`` or ``varied`` as it is. Raises what
        ``Benchmark.simulate`` raises.
        """
        super().reset(seed=seed)
        # A plant can be in one simulation at a time.
        self.close()
        case, self._seed = (options or {}).get("case"), 0
        if case is None:
            case, self._seed = str(self.np_random.choice(self._ids)), int(self.np_random.integers(2**31))
        self._case = case if isinstance(case, Case) else self._named(case)
        simulation = self._started()
        q_m = simulation.begin()
        if q_m is None:
            raise FmuError("The simulation ended before its first sample.")
        self._simulation = simulation
        self._memory = Observation()
        self._X_0, self._k, self._h = self._simulation.position(0), 0, float(self._case.scenario.sample_time)
        self._frame = max(1, round(1.0 / (self.metadata["render_fps"] * self._h)))
        self._observe(q_m)
        return self._observation, self._info()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Command ``u_m0 + action`` [N.m] for one sample.

        Raises ``ResetNeeded`` if there is no episode, and ``InvalidAction`` for an action that is not a finite number
        for each axis.
        """
        if self._simulation is None:
            raise gymnasium.error.ResetNeeded("the episode has ended, or not begun: call reset")
        if np.shape(action) != (2,) or not np.isfinite(action).all():
            raise gymnasium.error.InvalidAction(f"an action is two finite torques [N.m], not {action}")
        first, second = self._simulation.steady.u_m0
        q_m = self._simulation.step((first + float(action[0]), second + float(action[1])))
        self._k += 1
        if q_m is not None:
            self._observe(q_m)
            info = self._info()
            if self.render_mode == "human" and self._k % self._frame == 0:
                self.render()
            return self._observation, -1e3 * self._h * info["tcp_error"], False, False, info
        self.trajectory = self._simulation.trajectory
        assert self.trajectory is not None  # as it has ended
        self._k = len(self.trajectory.time) - 1
        info = self._info() | {"status": self.trajectory.ending.status.value, "message": self.trajectory.ending.message}
        self._simulation = None
        is_done = self.trajectory.ending.status is Status.DONE
        scenario = self._case.scenario
        # Else a policy would learn to be given up early, as the steps that are left would cost nothing.
        left = 0.0 if is_done else 1e3 * scenario.abort_distance * (scenario.samples - self._k) * self._h
        return self._observation, -1e3 * self._h * info["tcp_error"] - left, not is_done, is_done, info

    def render(self) -> np.ndarray | None:
        """The arm as it is, its deviation from rest magnified: an array of shape (400, 400, 3) of bytes in the mode
        ``"rgb_array"``, or drawn in a window in the mode ``"human"``."""
        if self._simulation is None:
            raise gymnasium.error.ResetNeeded("the episode has ended, or not begun: call reset")
        if self.render_mode is None:
            raise gymnasium.error.Error("the environment was made without render_mode: say rgb_array or human")
        from .documents.figures import draw

        is_human = self.render_mode == "human"
        self._figure = self._figure or _figure(is_human)
        parameters, pose = dict(self._case.scenario.parameters), self._case.configuration
        first, second = self._simulation.observed(self._k)
        error = self._info()["tcp_error"]
        words = f"{self._k * self._h:.2f} s, error {1e3 * error:.2f} mm"
        draw(self._figure, (parameters["l[1]"], parameters["l[2]"]), (pose.q_a1, pose.q_a2), (first, second), words)
        if is_human:
            from matplotlib import pyplot

            pyplot.pause(1e-3)
            return None
        self._figure.canvas.draw()
        picture: np.ndarray = np.asarray(self._figure.canvas.buffer_rgba())[..., :3].copy()
        return picture

    def close(self) -> None:
        """End the episode."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def _named(self, id: str) -> Case:
        bench = replace(self._bench, seed=self._seed)
        return bench.varied(bench.case(id), self._variation)

    def _started(self) -> Stepwise:
        # Where the processes of an evaluation keep machine code: a folder for each state of the sources.
        numba.config.CACHE_DIR = numba.config.CACHE_DIR or str(compiled_code_folder())
        from .fmi.slaves import load
        from .loop.stepwise import Stepwise

        plant = self._bench.manipulator.archive
        if plant.once_per_process:
            message = f"{plant.name} declares that a process can instantiate it only once: it has no second episode."
            raise InputError(message, "once-per-process", plant.name)
        self._plant = self._plant or load(plant)
        return Stepwise(self._plant, self._case.scenario, OBSERVED if self.render_mode else ())

    def _observe(self, q_m: tuple[float, float]) -> None:
        assert self._simulation is not None
        self._observation = np.array(self._memory.sample(self._simulation.steady.q_m_ref, q_m, self._h))

    def _info(self) -> dict[str, Any]:
        assert self._simulation is not None
        X = self._simulation.position(self._k).copy()
        tcp_error = math.hypot(*(X - self._X_0))
        return {"case": self._case.id, "seed": self._seed, "t": self._k * self._h, "X": X, "tcp_error": tcp_error}


def _figure(is_human: bool) -> Any:
    """A figure of 400 x 400 pixels, with a window or without."""
    size: Any = {"figsize": (4.0, 4.0), "dpi": 100, "layout": "constrained"}
    if is_human:
        from matplotlib import pyplot

        return pyplot.figure(**size)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(**size)
    FigureCanvasAgg(figure)
    return figure


gymnasium.register(ID, f"{__name__}:{FlexibleManipulator.__name__}")
