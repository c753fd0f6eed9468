"""The command that repeats a case of a run: what stands beside every case that is shown; and those that come next.

Option names stand in the commands' own room only, and here; a test holds the two against each other.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from ..benchmark.tally import Tally
from ..codec import Scalar
from ..search.member import Member
from ..text import spelled
from .head import ControllerRecord, Head, PlantRecord
from .recording import About


class Setting(NamedTuple):
    """What a case is simulated with: ``protocol`` is a name or a file, empty for that of the command; ``sample_time``
    [s] is None for the benchmark's."""

    controller: ControllerRecord
    plant: PlantRecord
    protocol: str
    seed: int
    sample_time: float | None


def setting(head: Head, seed: int | None = None) -> Setting:
    """The setting of what was made with ``head``, with another ``seed`` if there is one."""
    sample_time = None if head.sample_time.as_in_benchmark else head.sample_time.seconds
    chosen = head.seed or 0 if seed is None else seed
    return Setting(head.controller, head.plant, head.protocol_file or head.protocol, chosen, sample_time)


def evaluate_command(file: str, mapping: str = "", protocol: str = "paper") -> str:
    """The whole command that evaluates the FMU ``file`` with a ``mapping`` file, if there is one."""
    words = ["flexible-manipulator", "evaluate", file]
    if mapping:
        words += ["--mapping", mapping]
    if protocol != "paper":
        words += ["--protocol", protocol]
    return shlex.join(words)


def simulate_command(head: Head, id: str) -> str:
    """The whole command that simulates the case ``id`` again, with the controller, protocol, seed and values of
    ``head``."""
    return case_command(setting(head), id)


def case_command(setting: Setting, id: str) -> str:
    """The whole command that simulates the case ``id`` in this setting."""
    return _command(setting, "--case", id)


def study_command(head: Head, name: str, *words: str, parameters: Mapping[str, Scalar] | None = None) -> str:
    """The whole command ``name`` on the controller of ``head`` with its plant, and with ``parameters`` in place of its
    own ones; protocol and seed are those that the command has by itself."""
    chosen = setting(head)._replace(protocol="", seed=0)
    if parameters:
        controller = replace(chosen.controller, parameters={**chosen.controller.parameters, **parameters})
        chosen = chosen._replace(controller=controller)
    return _command(chosen, *words, program=name)


TO_VARY = ("NAME=LOW:HIGH",)
"""What a reader fills in: a report of fixed parameters does not know those that there are."""


ROBUST = ("--robust", "1000")
"""Makes a tuning search for the worst case of its best candidates, with this budget; the list alone takes 936."""


MORE_TRIALS = ("--trials", "500")
"""More than the 200 that a tuning has by itself."""


def tune_command(head: Head, *words: str, ranges: Iterable[str] = TO_VARY) -> str:
    """The whole command that tunes the controller of ``head``: which parameters, and from where to where."""
    return study_command(head, "tune", *(word for name in ranges for word in ("--vary", name)), *words)


def range_words(name: str, low: float, high: float, log: bool = False) -> str:
    """The range of a parameter as that command has it."""
    return f"{name}={low!r}:{high!r}{':log' if log else ''}"


def compare_command(folder: Path) -> str:
    """The whole command that compares the results in ``folder`` with those in a folder that the reader fills in."""
    return shlex.join(("flexible-manipulator", "compare", str(folder), "FOLDER"))


def in_draw(id: str, seed: int) -> str:
    """The name of a case in the draw of this seed, as a command has it."""
    return f"{id} --seed {seed}"


def recording_command(head: Head, about: About) -> str:
    """The same for a case that was recorded, which need not be one of the protocol's poses."""
    if about.configuration >= 0:
        return simulate_command(head, about.id)
    pose = (_exact(degrees(angle)) for angle in about.q_a)
    return _command(setting(head), "--configuration", *pose, "--system", about.system, "--test", about.test)


def again(tally: Tally) -> str:
    """How to get the cases that a requirement is not judged without; empty if they were not asked for."""
    if "skipped" in tally.not_judged:
        return "to run what was skipped, repeat with --keep-going"
    return "to run again what was lost, repeat the same command" if "lost" in tally.not_judged else ""


def degrees(angle: float) -> float:
    """The angle [degrees] that becomes ``angle`` [rad] again, if there is one; else the nearest."""
    value = math.degrees(angle)
    around = (value, math.nextafter(value, math.inf), math.nextafter(value, -math.inf))
    return next((candidate for candidate in around if math.radians(candidate) == angle), value)


def member_command(setting: Setting, member: Member, parameters: Mapping[str, float]) -> str:
    """The same for a member of the uncertainty description, whose plant has these ``parameters``."""
    words = ["--configuration", *map(_exact, member.q_a), "--system", member.system, "--test", member.test]
    if member.phi_F is not None:
        words += ["--phi-F", _exact(member.phi_F)]
    if member.sweep is not None:
        words += ["--chirp-frequencies", *map(_exact, member.sweep)]
    if member.t_3 is not None:
        words += ["--t-3", _exact(member.t_3)]
    if member.gain is not None:
        words += ["--gain", *map(_exact, member.gain)]
    if member.delay is not None:
        words += ["--delay", *(str(Decimal(delay.numerator) / delay.denominator) for delay in member.delay)]
    plant = replace(setting.plant, parameters={**setting.plant.parameters, **parameters})
    return _command(setting._replace(plant=plant, seed=member.seed), *words)


def _exact(value: float) -> str:
    """All digits of a number, without an exponent: a command line takes ``-1e-5`` for an option."""
    return format(Decimal(repr(value)), "f")


def _command(setting: Setting, *own: str, program: str = "simulate") -> str:
    """A ``program`` with its ``own`` words in a setting."""
    controller, plant = setting.controller, setting.plant
    words = ["flexible-manipulator", program, *filter(None, (controller.path,)), *own]
    if controller.library == "wine":
        words += ["--library", controller.library]
    if setting.protocol not in ("", "paper"):
        words += ["--protocol", setting.protocol]
    if plant.path:
        words += ["--plant", plant.path]
    if setting.seed:
        words += ["--seed", str(setting.seed)]
    if setting.sample_time is not None:
        words += ["--sample-time", repr(setting.sample_time)]
    words += [word for name, value in controller.parameters.items() for word in ("--set", f"{name}={spelled(value)}")]
    words += [word for name, value in controller.mapping.items() for word in ("--map", f"{name}={value}")]
    if plant.parameters:
        words += ["--plant-set", ",".join(f"{name}={value!r}" for name, value in plant.parameters.items())]
    return shlex.join(words)
