"""Numba: compiled functions in IEEE arithmetic, and calls of C functions by address.

Machine code is cached in ``NUMBA_CACHE_DIR``; the processes that run simulations are started with
:func:`orchestrator.cache.compiled_code_folder` there.
"""

from __future__ import annotations

import platform
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
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


ROUNDING = {1: "downward", 2: "upward", 3: "towards zero"}

ARCHITECTURES = {
    "x86_64": ("llvm.x86.sse.stmxcsr", 13, {1: 1, 2: 2, 3: 3}, 1 << 15 | 1 << 6),
    "aarch64": ("llvm.aarch64.get.fpcr", 22, {1: 2, 2: 1, 3: 3}, 1 << 24),
}
"""By machine: what reads the control word, where in it the rounding mode begins and what its values stand for, and the
bits that treat denormal numbers as zero. Elsewhere nothing is read."""

CONTROL = ARCHITECTURES.get(platform.machine().replace("AMD64", "x86_64").replace("arm64", "aarch64"))


def _arithmetic(_typingctx: Any) -> tuple[Any, Callable[..., Any]]:
    """Rounding mode and treatment of denormal numbers, 0 as IEEE 754 has them by default."""

    def generate(_context: Any, builder: Any, _signature: Any, _values: Any) -> Any:
        word, i32 = ir.IntType(64), ir.IntType(32)
        if CONTROL is None:
            return word(0)
        name, shift, _, denormals = CONTROL
        mask = word(3 << shift | denormals)
        if CONTROL is not ARCHITECTURES["x86_64"]:
            return builder.and_(
                builder.call(builder.module.declare_intrinsic(name, (), ir.FunctionType(word, ())), ()), mask
            )
        # In the frame of the function that this is copied into: one in a loop would take stack in each pass.
        memory, pointer = cgutils.alloca_once(builder, i32), ir.IntType(8).as_pointer()
        store = builder.module.declare_intrinsic(name, (), ir.FunctionType(ir.VoidType(), [pointer]))
        builder.call(store, [builder.bitcast(memory, pointer)])
        return builder.and_(builder.zext(builder.load(memory), word), mask)

    return types.int64(), generate


arithmetic: Callable[[], int] = intrinsic(_arithmetic)


@compiled
def arithmetic_now() -> int:
    """The same for Python."""
    return arithmetic()


def arithmetic_words(changed: int) -> str:
    """What is not as usual in a word that :func:`arithmetic` read."""
    if CONTROL is None:
        return ""
    _, shift, modes, denormals = CONTROL
    rounding = ROUNDING.get(modes.get(changed >> shift & 3, 0))
    words = [f"rounding {rounding}"] if rounding else []
    return " and ".join([*words, *(["denormal numbers are zero"] if changed & denormals else [])])
