"""Compiled functions keep IEEE arithmetic, whoever calls them."""

import numba
import pytest

from orchestrator import jit as master
from plant_fmu.flexible_manipulator import jit as plant


def lost(a, b):
    """What rounding takes from ``b`` in a + b; nothing where sums are rearranged."""
    return (a + b) - a - b


@pytest.mark.parametrize("compiled", [master.compiled, master.inlined, plant.compiled])
def test_fast_math_of_a_caller_is_not_inherited(compiled):
    function = compiled(lost)
    assert function.py_func is lost

    @numba.njit(fastmath=True)
    def careless(a, b):
        return function(a, b)

    assert careless(1e16, 1.0) == -1.0  # compiled for this caller first
    assert function(1e16, 1.0) == -1.0
