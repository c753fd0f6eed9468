"""Numba: compiled functions in IEEE arithmetic, and calls of C functions by address.

Machine code is cached in ``NUMBA_CACHE_DIR``; the processes that run simulations are started with
:func:`orchestrator.cache.compiled_code_folder` there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

F = TypeVar("F", bound=Callable[..., Any])

# Fast-math is ruled out explicitly: Numba passes a caller's on to what it calls, and to the cache of that. Without
# Numba's runtime no references to arrays are counted, which would take longer than the master loop itself; compiled
# functions cannot allocate arrays therefore.
OPTIONS = {"cache": True, "fastmath": False, "error_model": "numpy", "_nrt": False}


def compiled(function: F) -> F:
    """``function`` as machine code, cached on disk. It must not allocate arrays."""
    machine_code: F = numba.njit(**OPTIONS)(function)
    return machine_code


def inlined(function: F) -> F:
    """Like :func:`compiled`, but copied into its callers: passing an argument with many arrays is costly."""
    machine_code: F = numba.njit(forceinline=True, **OPTIONS)(function)
    return machine_code


def _call_status(_typingctx: Any, address: Any, arguments: Any) -> tuple[Any, Callable[..., Any]]:
    """Call the C function at the integer ``address`` with the tuple ``arguments``; returns its status.

    The status is an enumeration; as an unsigned number every illegal one is above the legal ones.

    Integers of 64 bits also stand for pointers and ``size_t``, which the platforms' calling conventions pass
    alike. The address is a run-time value: one compilation serves every FMU.
    """
    signature = types.int64(address, arguments)

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        pointer, packed = values
        c_arguments = [builder.extract_value(packed, i) for i in range(len(arguments))]
        c_type = ir.FunctionType(ir.IntType(32), [argument.type for argument in c_arguments])
        status = builder.call(builder.inttoptr(pointer, c_type.as_pointer()), c_arguments)
        return builder.zext(status, ir.IntType(64))

    return signature, generate


call_status: Callable[[int | np.int64, tuple[Any, ...]], int] = intrinsic(_call_status)
