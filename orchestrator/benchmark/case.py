"""The frozen words of the benchmark: configuration, system, test, case."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from ..cosim.scenario import Scenario


@dataclass(frozen=True)
class Configuration:
    """A pose Q_k of the workspace: link angles [rad] and the index k."""

    index: int
    q_a1: float
    q_a2: float


@dataclass(frozen=True)
class Disturbance:
    """What a system's disturbance leaves open: direction of the force [rad], start of the chirp [s], its sweep [Hz]."""

    phi_F: float
    t_3: float
    f_start: float
    f_stop: float


@dataclass(frozen=True)
class System:
    """One member of the uncertainty description: plant parameters by FMI name (SI), and its disturbance."""

    name: str
    parameters: tuple[tuple[str, float], ...]
    disturbance: Disturbance


@dataclass(frozen=True)
class Test:
    """One experiment on a system. ``gain`` and ``delay`` [s] are added on ``axis`` (1 or 2; 0 for none).

    ``criteria`` (B1..B7) and ``requirements`` (A1..A3) name what is read off it.
    """

    __test__ = False  # pytest takes classes of this name for its own

    name: str
    systems: str
    duration: Fraction
    disturbed: bool = True
    axis: int = 0
    gain: float = 1.0
    delay: Fraction = Fraction(0)
    criteria: tuple[str, ...] = ()
    requirements: tuple[str, ...] = ()


@dataclass(frozen=True)
class Case:
    """Configuration x system x test. The scenario holds every number the simulation depends on, noise included."""

    configuration: Configuration
    system: System
    test: Test
    scenario: Scenario

    @property
    def id(self) -> str:
        """Unique within a protocol, such as ``c07.compliant.gain_1``."""
        return f"c{self.configuration.index:02d}.{self.system.name}.{self.test.name}"
