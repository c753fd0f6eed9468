"""The sample time at which a controller runs."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from ..errors import InputError
from ..exact_time import seconds
from ..fmi.archive import Archive

MAX_RATIO = 1000
"""Largest ratio of a controller's and the benchmark's sample time, either way: beyond it is a slip."""


FIXED = "fixedInternalStepSize"
"""Attribute of a description of FMI 3.0 co-simulation."""


@dataclass(frozen=True)
class SampleTime:
    """``value`` [s], and where it comes from: "given", "fixedInternalStepSize", "DefaultExperiment" or "benchmark"."""

    value: Fraction
    origin: str


def controller_sample_time(controller: Archive, benchmark: Fraction, given: Fraction | None = None) -> SampleTime:
    """The sample time of ``controller``: as given, else its own, else the ``benchmark``'s [s].

    Raises :class:`InputError` if it is not an integer multiple or fraction of the benchmark's.
    """
    chosen = _find(controller, benchmark, given)
    ratio = chosen.value / benchmark if chosen.value > 0 else Fraction(0)
    if chosen.value <= 0 or min(ratio.numerator, ratio.denominator) != 1 or max(ratio.as_integer_ratio()) > MAX_RATIO:
        message = (
            f"The sample time of {controller.name} is {float(chosen.value):g} s ({chosen.origin}), which is not an "
        )
        message += f"integer multiple or fraction (up to {MAX_RATIO}) of the benchmark's {float(benchmark):g} s."
        raise InputError(message, "bad-sample-time", controller.name, float(chosen.value))
    if given is not None and (fixed := _fixed(controller)) is not None:
        # FMI 3.0 (fixedInternalStepSize): communication steps should be
        # multiples of it. Others may end early, or with an error.
        step = _near(_read(controller, fixed, FIXED), given)
        if step <= 0 or (given / step).denominator != 1:
            message = (
                f"The sample time of {controller.name} is given as {float(given):g} s, which is no multiple of its "
            )
            message += f"fixed internal step ({FIXED}) of {float(step):g} s. Give a multiple."
            raise InputError(message, "fixed-step", controller.name, float(step))
    return chosen


def _find(controller: Archive, benchmark: Fraction, given: Fraction | None) -> SampleTime:
    if given is not None:
        return SampleTime(given, "given")
    experiment = controller.description.defaultExperiment
    default = experiment.stepSize if experiment is not None else None
    for text, origin in ((_fixed(controller), FIXED), (default, "DefaultExperiment")):
        if text not in (None, ""):
            return SampleTime(_near(_read(controller, str(text), origin), benchmark), origin)
    return SampleTime(benchmark, "benchmark")


def _fixed(controller: Archive) -> str | None:
    """The fixed internal step size that is declared, in FMI 3.0 co-simulation."""
    value = getattr(controller.description.coSimulation, FIXED, None) if controller.kind == "CoSimulation" else None
    return None if value in (None, "") else str(value)


def _read(controller: Archive, text: str, origin: str) -> Fraction:
    try:
        return seconds(text)
    except ValueError:
        message = f"The sample time of {controller.name}, {text!r} ({origin}), is not a number of seconds."
        raise InputError(message, "bad-sample-time", controller.name, text) from None


def _near(value: Fraction, benchmark: Fraction) -> Fraction:
    """``value``, freed from the rounding of a decimal notation: 0.000333333 is a third of 0.001."""
    # In both directions: exporters write 0.000333333 for a third of a millisecond, and 0.00333333 for its tenfold.
    for ratio in (value / benchmark, benchmark / value if value else Fraction(0)):
        whole = round(ratio)
        if whole and abs(ratio - whole) < Fraction(1, 10**5) * whole:
            return benchmark * whole if value >= benchmark else benchmark / whole
    return value
