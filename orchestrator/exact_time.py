"""Times as exact fractions of a second, so that sample times and delays fit together to the last digit."""

from __future__ import annotations

from fractions import Fraction

MAX_DIGITS, MAX_EXPONENT = 50, 100
"""Limits on the digits and the decimal exponent of a time that is read from text."""


def seconds(value: float | int | str | Fraction) -> Fraction:
    """Exact seconds: a float counts as the decimal number it prints as (0.00025 is 1/4000), "1/3000" as written.

    Raises :class:`ValueError` for what is not a number, or is out of any reasonable range.
    """
    if isinstance(value, (Fraction, int)) and not isinstance(value, bool):
        return Fraction(value)
    # The shortest decimal that gives the float: 0.00025 is meant, and not the binary number beside it.
    text = str(value).strip()
    exponent = text.lower().partition("e")[2] or "0"
    if len(text) > MAX_DIGITS or abs(int(exponent)) > MAX_EXPONENT:  # 1e9999999999 would fill the memory
        raise ValueError(f"{text[:MAX_DIGITS]} is not a time")
    try:
        return Fraction(text)
    except ZeroDivisionError:
        raise ValueError(f"{text} divides by zero") from None
