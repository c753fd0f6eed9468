"""Compilation by Numba where it is installed; the same source runs without it, slower."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

try:
    import llvmlite.ir
    import numba
    import numba.extending
except ImportError:
    numba = None

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """``function`` as machine code, cached on disk; unchanged where Numba is not installed.

    IEEE arithmetic is kept (no fast-math), so a result does not depend on the optimiser's choices. The function may
    not allocate arrays: it does without Numba's runtime, which would count references to those it is given. It is
    copied into its callers: calls took a fifth of the time of the plant (benchmarks/plant_speed.py).
    """
    if numba is None:
        return function
    # Fast-math is refused aloud, as Numba hands a caller's on to what it calls, and to the cache of that.
    options = {"fastmath": False, "error_model": "numpy", "_nrt": False, "forceinline": True}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to write the cache to: compile for this process alone
        return numba.njit(**options)(function)


def callable_from_compiled(function: Callable[..., Any]) -> None:
    """Let compiled functions call ``function``, which itself stays as it is."""
    if numba is not None:
        numba.extending.register_jitable(fastmath=False, error_model="numpy", forceinline=True)(function)


def compiled_to_an_exponent(function: Callable[[int], float]) -> None:
    """Let compiled functions call ``function``, which is 2^k for normal numbers, and put k where a number has its
    exponent. Numba calls a function of C for ``math.ldexp``, which took a fifth of the time of the plant."""
    if numba is None:
        return

    def exponent(_context: Any, k: Any) -> Any:
        def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            word = llvmlite.ir.IntType(64)
            bits = builder.shl(builder.add(values[0], word(1023)), word(52))
            return builder.bitcast(bits, llvmlite.ir.DoubleType())

        return numba.float64(numba.int64), generate

    with_exponent = numba.extending.intrinsic(exponent)
    numba.extending.overload(function)(lambda k: lambda k: with_exponent(k))
