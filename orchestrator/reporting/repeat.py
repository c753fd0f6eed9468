"""The command that repeats a case of a run: what stands beside every case that is shown.

Option names stand in the commands' own room only, and here; a test holds the two against each other.
"""

from __future__ import annotations

import math
import shlex

from ..benchmark.results import Results
from .recording import About


def simulate_command(results: Results, id: str) -> str:
    """The whole command that simulates the case ``id`` again, with the run's controller, protocol, seed and values."""
    return _command(results, "--case", id)


def recording_command(results: Results, about: About) -> str:
    """The same for a case that was recorded, which need not be one of the protocol's poses."""
    if about.configuration >= 0:
        return simulate_command(results, about.id)
    pose = (repr(degrees(angle)) for angle in about.q_a)
    return _command(results, "--configuration", *pose, "--system", about.system, "--test", about.test)


def degrees(angle: float) -> float:
    """The angle [degrees] that becomes ``angle`` [rad] again, if there is one; else the nearest."""
    value = math.degrees(angle)
    around = (value, math.nextafter(value, math.inf), math.nextafter(value, -math.inf))
    return next((each for each in around if math.radians(each) == angle), value)


def _command(results: Results, *case: str) -> str:
    controller, plant = results.controller, results.plant
    words = ["python", "-m", "orchestrator.simulate", *filter(None, (controller.path,)), *case]
    if results.protocol != "paper":
        words += ["--protocol", results.protocol_file or results.protocol]
    if plant.path:
        words += ["--plant", plant.path]
    if results.seed:
        words += ["--seed", str(results.seed)]
    if not results.sample_time.as_in_benchmark:
        words += ["--sample-time", repr(results.sample_time.seconds)]
    words += [word for name, value in controller.parameters.items() for word in ("--set", f"{name}={value!r}")]
    words += [word for name, value in controller.mapping.items() for word in ("--map", f"{name}={value}")]
    words += [word for name, value in plant.parameters.items() for word in ("--plant-set", f"{name}={value!r}")]
    return shlex.join(words)
