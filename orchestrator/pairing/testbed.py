"""What controllers are tried on: protocol, seed and plant, and what runs simulations."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark import cases as case_list
from ..benchmark import protocol as protocols
from ..benchmark.case import Case
from ..benchmark.linearization import check_changes
from ..benchmark.protocol import Protocol
from ..benchmark.variation import Variation, vary
from ..documents.results import CaseList
from ..entry import enter_fields, entered
from ..errors import InputError
from ..execution import cluster
from ..execution.job import Limits
from ..loop.sampling import controller_sample_time
from .built_in import AUTO, NATIVE, PYTHON, Plant, choose
from .controller import Controller
from .pairing import Pairing

MAX_SEED = 2**53
"""What JSON's numbers hold exactly."""

LEAST_MEMORY = 300e6
"""What a simulation's process needs [bytes]: it uses 260 MB before it loads an FMU."""


def available_cores() -> int:
    """Number of processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class Testbed:
    """What :class:`.Benchmark` says of its parameters, and what follows from them."""

    protocol: str | Path = "paper"
    seed: int = 0
    workers: int | None = None
    plant_parameters: Mapping[str, float] = field(default_factory=dict)
    plant: str | Path = AUTO
    timeout: float = 60.0
    memory_limit: float = 2e9
    sandbox: bool = False
    scheduler: str | None = None
    wait: float = cluster.WAIT
    command: str = ""

    def __post_init__(self) -> None:
        enter_fields(self)
        if not 0 <= self.seed <= MAX_SEED:
            message = f"The seed is from 0 to {MAX_SEED}, not {self.seed}."
            raise InputError(message, "bad-number", "seed", self.seed)
        if self.workers is not None and self.workers < 1:
            message = f"The number of workers is at least 1, not {self.workers}."
            raise InputError(message, "bad-number", "workers", self.workers)
        for name in ("timeout", "memory_limit", "wait"):
            value = getattr(self, name)
            # NaN fails as well: a limit of NaN would never be reached.
            if not 0.0 < value < math.inf:
                raise InputError(f"The {name} must be positive and finite, not {value}.", "bad-number", name, value)
        if self.memory_limit < LEAST_MEMORY:
            message = (
                f"The memory_limit is in bytes, and at least {LEAST_MEMORY / 1e6:.0f} MB, which a process uses before "
            )
            message += f"it loads an FMU; {self.memory_limit:g} bytes are too few."
            raise InputError(message, "bad-number", "memory_limit", self.memory_limit)
        check_changes(self.plant_parameters, self.rules.uncertainty)

    @functools.cached_property
    def rules(self) -> Protocol:
        """The protocol's contents."""
        return protocols.load(self.protocol)

    @functools.cached_property
    def manipulator(self) -> Plant:
        """The manipulator's FMU, see ``plant``; it is built on first use."""
        return choose(self.plant)

    @functools.cached_property
    def nominal(self) -> dict[str, float]:
        """The plant's nominal parameters by FMI name, SI units."""
        # The benchmark's own builds have the same table: to list cases, nothing has to be built.
        nominal = NOMINAL if self.plant in (AUTO, PYTHON, NATIVE) else self.manipulator.nominal
        return {**nominal, **self.plant_parameters}

    @functools.cached_property
    def cases(self) -> CaseList:
        """All cases of the protocol, in its order: a tuple that shows itself in a notebook."""
        return CaseList(case_list.cases(self.rules, self.nominal, self.seed))

    @entered
    def case(self, id: str) -> Case:
        """The case called ``id``, such as ``"c07.compliant.gain_1"``, also with a system the protocol does not run.

        Raises :class:`InputError` if there is none.
        """
        return case_list.case_named(self.rules, self.nominal, self.seed, id)

    @entered
    def case_at(
        self,
        q_a: tuple[float, float],
        system: str = "nominal",
        test: str = "disturbance",
        variation: Variation | None = None,
    ) -> Case:
        """The case of a pose ``q_a`` [rad], anywhere in the workspace, a system and a test, varied if wanted."""
        test_rules = self.rules.test(test)
        pose = case_list.configuration(self.rules, *q_a, self.seed)
        member = case_list.system(self.rules, self.nominal, self.seed, pose.index, system, test_rules)
        at_pose = case_list.case(self.rules, pose, member, test_rules, self.seed)
        return at_pose if variation is None else self.varied(at_pose, variation)

    @entered
    def varied(self, case: Case, variation: Variation) -> Case:
        """``case`` with single disturbances and imperfections set or switched off."""
        return replace(case, scenario=vary(case.scenario, self.rules, variation))

    @property
    def processes(self) -> int:
        """How many processes at a time."""
        return self.workers or available_cores()

    def pairing(self, controller: Controller) -> Pairing:
        """Manipulator and controller, and the limits they run under."""
        limits = Limits(memory=int(self.memory_limit))
        return Pairing(
            self.manipulator.archive, controller.archive, controller.setup, self.timeout, limits, self.sandbox
        )

    def prepared(self, controller: Controller) -> tuple[Controller, Pairing, Fraction, tuple[Case, ...]]:
        """The controller with its pairing, its sample time [s] and all cases at that."""
        pairing = self.pairing(controller)
        T_s = controller_sample_time(pairing.controller, self.rules.sample_time, controller.given_sample_time).value
        return controller, pairing, T_s, case_list.cases(self.rules, self.nominal, self.seed, T_s)

    def sampled(self, controller: Controller, case: Case | str) -> tuple[Pairing, Case]:
        """A case, sampled by the controller."""
        pairing = self.pairing(controller)
        chosen = self.case(case) if isinstance(case, str) else case
        T_s = controller_sample_time(pairing.controller, chosen.scenario.sample_time, controller.given_sample_time)
        return pairing, replace(chosen, scenario=replace(chosen.scenario, sample_time=T_s.value))
