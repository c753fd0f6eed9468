"""The parts of what a search for the worst case finds: what ``robustness.json`` is made of.

All values are in SI units; None stands for what does not exist or was not found. Each ``command`` repeats its case to
the last bit.
"""

from __future__ import annotations

from ..benchmark.results import Kind
from ..codec import Finite, Natural, NonNegative, Struct
from ..loop.trajectory import Status

BUDGET = 5000
"""Simulated time of a search by default, in whole cases: some minutes with a compiled controller."""


class Found(Struct):
    """The largest value of a criterion found, and the command that repeats it; None for a loop that is unstable."""

    value: NonNegative | None
    command: str


class CriterionSearched(Struct):
    """A criterion: the mean over the configurations of the largest values found, as in eq. (14) and Table 2, beside
    that of the protocol's list alone; and the largest of all."""

    value: NonNegative | None
    protocol: NonNegative | None
    unit: str
    worst_case: Found


class RequirementSearched(Struct):
    """A requirement: the worst case found, which fails with ``seeds_failed`` of ``seeds_tried`` realizations of the
    noise. A longer search may find a failure where this one found none. ``passed`` is None if nothing fails, but a
    simulation was skipped or lost. ``status`` is that of the worst case's simulation."""

    passed: bool | None
    kind: Kind
    limit_cycle: NonNegative | None
    ratio: NonNegative | None
    frequency: NonNegative | None
    seeds_failed: Natural
    seeds_tried: Natural
    command: str
    status: Status = Status.DONE


# The names of version 1.0.0, which its API page promises.
CriterionFound, RequirementFound = CriterionSearched, RequirementSearched


class Margin(Struct):
    """The smallest change of one axis found to make the loop fail: a factor of the loop gain, or a delay
    [s] beside the benchmark's; None if none was found up to ``limit``. It fails with ``seeds_failed`` of
    ``seeds_tried`` other realizations of the noise. ``refined`` is False where the budget did not last to try that arm
    with a little less: it fails at ``value`` or less."""

    value: NonNegative | None
    limit: NonNegative
    seeds_failed: Natural = 0
    seeds_tried: Natural = 0
    command: str = ""
    refined: bool = True


class Radius(Struct):
    """The factor on all half-widths of Table 1 at which V passes its target (``cost``) and at which a requirement fails
    (``stability``); None if they do not up to ``limit``, of members that were tried. What is not ``refined`` is so at
    that factor or less: the budget did not last for the steps below."""

    cost: NonNegative | None
    stability: NonNegative | None
    limit: NonNegative
    cost_refined: bool = True
    stability_refined: bool = True


class Step(Struct):
    """What was known at the end of a stage, after so many simulations and so many whole cases ``spent``: V of eq. (15)
    from what was found, and the worst value of each target, in whole cases."""

    stage: str
    simulations: Natural
    spent: NonNegative
    cost: NonNegative | None
    worst: dict[str, Finite | None]


class Effect(Struct):
    """By how much the largest value found of a criterion changes if one uncertain parameter, which is at the end
    ``sign`` of its range there (0: nominal), goes to the other end (the upper one from nominal)."""

    parameter: str
    sign: Finite
    criterion: str
    change: Finite | None


class ConfigurationFound(Struct):
    """V_k of eq. (14) of one configuration: of the list, and with all that was found there."""

    index: int
    q_a1: Finite
    q_a2: Finite
    protocol: NonNegative | None
    found: NonNegative | None


class PeakFound(Struct):
    """The largest value of a criterion found at a configuration, None for a loop that is unstable: with which
    ``deviations`` of the parameters, in half-widths of Table 1 by FMI name, direction of the force [rad], frequencies
    [Hz] of the chirp and base seed of the noise. ``other_noise`` are the values of the same arm with other seeds, the
    smallest first; none where the criterion is not tried with them."""

    configuration: int
    criterion: str
    value: NonNegative | None
    deviations: dict[str, Finite]
    phi_F: Finite
    sweep: tuple[Finite, Finite]
    command: str
    seed: Natural = 0
    other_noise: tuple[NonNegative | None, ...] = ()
