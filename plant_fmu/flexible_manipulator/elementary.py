"""The functions of :mod:`.formulas` that compiled functions call.

Where Numba is installed, importing this module makes them known to it; they stay functions in Python for all others.
"""

from __future__ import annotations

from .formulas import exp, log, power_of_two, sin_cos
from .jit import callable_from_compiled, compiled_to_an_exponent

compiled_to_an_exponent(power_of_two)
for _function in (exp, log, sin_cos):
    callable_from_compiled(_function)

__all__ = ["exp", "log", "sin_cos"]
