"""The coefficients of plant_fmu/flexible_manipulator/formulas.py, computed anew with 60 digits.

    python benchmarks/elementary_coefficients.py

Each polynomial interpolates its function at Chebyshev's points, which comes within a small factor of the best
polynomial of its degree. Behind each stands its largest relative error before rounding, as a share of the function
that it serves. Needs mpmath.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath
from mpmath import mpf

mpmath.mp.dps = 60

PARTS = 64
"""In so many parts of equal size the exponential divides an octave."""


def chebyshev(function: Callable[[mpf], mpf], low: mpf, high: mpf, number: int) -> list[mpf]:
    """Coefficients, lowest power first, of the polynomial through ``number`` Chebyshev points in [low, high]."""
    points = [
        (low + high) / 2 + (high - low) / 2 * mpmath.cos(mpmath.pi * (2 * i + 1) / (2 * number)) for i in range(number)
    ]
    powers = mpmath.matrix([[point**power for power in range(number)] for point in points])
    return list(mpmath.lu_solve(powers, mpmath.matrix([function(point) for point in points])))


def largest_error(
    function: Callable[[mpf], mpf], share: Callable[[mpf], mpf], found: list[mpf], low: mpf, high: mpf
) -> float:
    """Largest error of the polynomial times ``share`` on a grid without 0."""
    points = [low + (high - low) * mpf(i) / 501 for i in range(1, 501)]
    return float(max(abs((mpmath.polyval(found[::-1], x) - function(x)) * share(x)) for x in points))


def split(value: mpf, bits: int) -> tuple[float, mpf]:
    """The leading ``bits`` of ``value``, and the rest."""
    unit = mpf(2) ** (int(mpmath.floor(mpmath.log(value, 2))) + 1 - bits)
    head = mpmath.floor(value / unit) * unit
    return float(head), value - head


def main() -> None:
    """Print all constants."""
    quarter, reach = mpmath.pi / 4, mpmath.log(2) / (2 * PARTS)
    narrow = (mpmath.sqrt(2) - 1) / (mpmath.sqrt(2) + 1)

    def sin_rest(z: mpf) -> mpf:
        r = mpmath.sqrt(z)
        return (mpmath.sin(r) / r - 1) / z

    def cos_rest(z: mpf) -> mpf:
        return (mpmath.cos(mpmath.sqrt(z)) - 1 + z / 2) / z**2

    def exp_rest(r: mpf) -> mpf:
        return (mpmath.exp(r) - 1 - r) / r**2

    def log_rest(z: mpf) -> mpf:
        s = mpmath.sqrt(z)
        return (mpmath.log((1 + s) / (1 - s)) / s - 2) / z

    # What an error of the polynomial is of the function: of sin it is r z P / sin r, and so on.
    fits = {
        "SIN": (sin_rest, lambda z: z, mpf(0), quarter**2, 7),
        "COS": (cos_rest, lambda z: z**2 / mpmath.cos(mpmath.sqrt(z)), mpf(0), quarter**2, 6),
        "EXP": (exp_rest, lambda r: r**2 / mpmath.exp(r), -reach, reach, 4),
        "LOG": (log_rest, lambda z: z / 2, mpf(0), narrow**2, 7),
    }
    for name, (function, share, low, high, number) in fits.items():
        found = chebyshev(function, low, high, number)
        error = math.log2(largest_error(function, share, found, low, high))
        print(f"{name} = (  # 2^{error:.1f}")
        for coefficient in found:
            print(f"    {float(coefficient)!r},")
        print(")")
    first, rest = split(mpmath.pi / 2, 33)
    second, rest = split(rest, 33)
    print(f"PI_2 = ({first!r}, {second!r}, {float(rest)!r})")
    print(f"TWO_PER_PI = {float(2 / mpmath.pi)!r}")
    first, rest = split(mpmath.log(2), 32)
    print(f"LN_2 = ({first!r}, {float(rest)!r})")
    first, rest = split(mpmath.log(2) / PARTS, 32)
    print(f"PART = ({first!r}, {float(rest)!r})")
    print(f"PER_PART = {float(PARTS / mpmath.log(2))!r}")
    powers = [mpf(2) ** (mpf(i) / PARTS) for i in range(PARTS)]
    for name, values in (("POWERS", powers), ("REST", [power - mpf(float(power)) for power in powers])):
        print(f"{name} = (")
        for value in values:
            print(f"    {float(value)!r},")
        print(")")


if __name__ == "__main__":
    main()
