"""The words of the benchmark: configuration, system, test, case."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Literal
from typing import Protocol as Interface

import msgspec

from ..codec import Finite, Natural, Positive, Struct
from ..loop.scenario import Scenario

CRITERIA = {**dict.fromkeys(("B1", "B2", "B3", "B4"), "N.m"), "B5": "m", "B6": "s", "B7": "m"}
"""Names of the criteria, and the SI units in which they are measured."""

REQUIREMENTS = ("A1", "A2", "A3")


@dataclass(frozen=True)
class Configuration:
    """A pose Q_k of the workspace: link angles [rad] and the index k, -1 for a pose that is not on the grid."""

    index: int
    q_a1: Finite
    q_a2: Finite


class Disturbance(Struct):
    """What a system's disturbance leaves open: direction of the force [rad], start of the chirp [s], its sweep [Hz], by
    how much the force is ``late`` [s]."""

    phi_F: Finite
    t_3: Finite
    f_start: Finite
    f_stop: Finite
    late: Finite = 0.0


@dataclass(frozen=True)
class System:
    """One member of the uncertainty description: plant parameters by FMI name (SI), and its disturbance."""

    name: str
    parameters: tuple[tuple[str, float], ...]
    disturbance: Disturbance


class Again(Struct):
    """Chirp and force come ``number`` times, every ``period`` [s], each force turned by ``turn_deg`` [degrees] from the
    one before."""

    period: Positive
    number: Annotated[int, msgspec.Meta(ge=2, le=1000)]
    turn_deg: Finite = 0.0


class Test(Struct):
    """One experiment on a system. ``gain`` and ``delay`` [s] are added on ``axis`` (1 or 2; 0 for none).

    ``systems`` names a set of systems of the protocol, ``poses`` the indices of configurations; none means all. The
    disturbance is drawn by each system if the test ``draws``, else the protocol's fixed one with the direction of the
    force [degrees] and the ``sweep`` of the chirp changed if they are given; both act once, or ``again``. ``noise``
    numbers the realization of the measurement noise; ``repeats`` names the test that this one repeats with another.
    ``criteria`` (B1..B7) and ``requirements`` (A1..A3) name what is measured in it.
    """

    __test__ = False  # pytest takes classes of this name for its own

    name: str
    systems: str
    duration: Fraction
    disturbed: bool = True
    axis: Annotated[int, msgspec.Meta(ge=0, le=2)] = 0
    gain: Finite = 1.0
    delay: Fraction = Fraction(0)
    criteria: tuple[str, ...] = ()
    requirements: tuple[str, ...] = ()
    draws: bool = False
    direction_deg: Finite | None = None
    sweep: Literal["as fixed", "up", "down"] = "as fixed"
    noise: Natural = 0
    repeats: str = ""
    poses: tuple[Natural, ...] = ()
    again: Again | None = None


class JudgedTest(Interface):
    """What of a test its cases' judgements depend on. The key of a stored case has all of it."""

    @property
    def criteria(self) -> tuple[str, ...]:
        """B1..B7, as far as they are measured in it."""

    @property
    def requirements(self) -> tuple[str, ...]:
        """A1..A3, as far as they are judged in it."""

    @property
    def duration(self) -> Fraction:
        """Seconds; a scenario that is shorter is not continued in doubt."""


class JudgedCase(Interface):
    """The same of a case."""

    @property
    def scenario(self) -> Scenario:
        """What was simulated."""

    @property
    def test(self) -> JudgedTest:
        """What is measured in it."""

    @property
    def end(self) -> float:
        """The end of the case [s]."""


@dataclass(frozen=True)
class Case:
    """Configuration x system x test. The scenario holds every number the simulation depends on, noise included."""

    configuration: Configuration
    system: System
    test: Test
    scenario: Scenario

    @property
    def id(self) -> str:
        """Unique within a protocol, such as ``c07.compliant.gain_1``; ``free`` in place of c07 off the grid."""
        pose = f"c{self.configuration.index:02d}" if self.configuration.index >= 0 else "free"
        return f"{pose}.{self.system.name}.{self.test.name}"

    @property
    def end(self) -> float:
        """The end of the case [s]."""
        return float(self.scenario.samples * self.scenario.sample_time)
