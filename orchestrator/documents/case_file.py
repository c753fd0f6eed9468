"""A simulated case in one file, ``case.npz``: what the second checker reads, which shares no code with this package.

The file holds NumPy arrays and ``about``, a JSON text. Units are SI; row k belongs to time k T_s.

========== ============ ====================================================================================
array      shape        what it is
========== ============ ====================================================================================
about      ()           JSON text: :class:`CaseAbout`
q_m, q_a   (N + 1, 2)   motor and link angles, eq. (1) [rad]
X          (N + 1, 2)   position of the tool centre point, eq. (9) [m]
noise      (N + 1, 2)   measurement noise that is added to q_m before delay and rounding [rad]
given      (N, 2)       the angles that the controller was given: delayed and rounded [rad]
command    (N, 2)       the torques that it asked for [N.m]
torque     (N, 2)       the torques that left for the drive: gain, limit, rounding; the delay is yet to come [N.m]
========== ============ ====================================================================================
"""

from __future__ import annotations

import io
from collections.abc import Mapping

import numpy as np

from ..benchmark.case import CRITERIA, Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from ..codec import Struct, to_json
from ..loop.random_streams import noise
from ..loop.scenario import Scenario
from ..loop.trajectory import Trajectory

ARRAYS = ("q_m", "X", "given", "command", "torque")


class Definitions(Struct):
    """By what the figures are defined: the error band of B6 [m], the windows at the end [s] that the largest error and
    the limit cycle are taken from, and in how many directions its amplitude is measured."""

    settling_error: float
    rest_window: float
    limit_cycle_window: float
    limit_cycle_directions: int


class CaseAbout(Struct):
    """What was simulated and what it came to.

    ``parameters`` are all parameters of the plant by FMI name, those of the case among them; ``scenario`` is the
    simulation; ``claimed`` are the figures: B1 to B7, ``rest_error`` and ``limit_cycle_at_end``, as far as the test has
    them.
    """

    schema: str
    benchmark: str
    id: str
    controller: str
    parameters: dict[str, float]
    scenario: Scenario
    definitions: Definitions
    status: str
    claimed: dict[str, float]


CLAIMED = (*CRITERIA, "rest_error", "limit_cycle_at_end")

NAME = "case.npz"

SCHEMA = "flexible-manipulator-case/1"


def packed(
    protocol: Protocol,
    case: Case,
    controller: str,
    nominal: Mapping[str, float],
    trajectory: Trajectory,
    result: CaseResult,
) -> bytes:
    """The bytes of a ``case.npz``."""
    from ..benchmark.one_pass import DIRECTIONS  # with the compiler, which takes long to load

    limits = protocol.stability
    figures = {name: getattr(result.measurements, name) for name in CLAIMED}
    about = CaseAbout(
        schema=SCHEMA,
        benchmark=protocol.benchmark,
        id=case.id,
        controller=controller,
        parameters={**nominal, **dict(case.scenario.parameters)},
        scenario=case.scenario,
        definitions=Definitions(
            protocol.settling.error, limits.rest_window, limits.limit_cycle_window, limit_cycle_directions=DIRECTIONS
        ),
        status=result.status.value,
        claimed={name: value for name, value in figures.items() if value is not None},
    )
    arrays = {name: getattr(trajectory, name) for name in ARRAYS}
    arrays["q_a"] = np.column_stack([trajectory.extra["q_a[1]"], trajectory.extra["q_a[2]"]])
    arrays["noise"] = noise(case.scenario.sensor.noise, len(trajectory.time))
    with io.BytesIO() as file:
        np.savez_compressed(file, about=np.array(to_json(about)), **arrays)
        return file.getvalue()
