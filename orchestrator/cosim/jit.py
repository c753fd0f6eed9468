"""Numba: compiled functions whose cache notices every change, and calls of C functions by address."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ..errors import InputError
from ..folders import cache_folder, source_hash

F = TypeVar("F", bound=Callable[..., Any])


@functools.cache
def _cache_of_these_sources() -> str:
    """A folder named by the hash of this package's sources. Numba itself looks only at the file of the function
    it compiles and would run stale machine code after a change in a helper from another module.

    Empty where there is no cache folder: this runs while modules are imported, and who needs files will tell."""
    try:
        return str(cache_folder() / "numba" / source_hash([Path(__file__).parent])[:16])
    except InputError:
        return ""


def compiled(function: F) -> F:
    """``function`` as machine code in IEEE arithmetic (no fast-math), cached on disk.

    It may not allocate arrays: without Numba's runtime there is no counting of references to arrays, which takes
    longer than the master loop itself.
    """
    return _compiled(function)


def inlined(function: F) -> F:
    """Like :func:`compiled`, and copied into its callers: an argument with many arrays is costly to hand over."""
    return _compiled(function, forceinline=True)


def _compiled(function: F, **options: bool) -> F:
    before, folder = numba.config.CACHE_DIR, _cache_of_these_sources()
    numba.config.CACHE_DIR = folder
    # Said aloud, as Numba hands a caller's fast-math on to what it calls, and to the cache of that.
    ieee = {"fastmath": False, "error_model": "numpy", "_nrt": False}
    try:
        return numba.njit(cache=bool(folder), **ieee, **options)(function)
    finally:
        numba.config.CACHE_DIR = before


@intrinsic
def call_status(typingctx, address, arguments):
    """Call the C function at the integer ``address`` with the tuple ``arguments``; returns its status.

    The status is an enumeration; as an unsigned number every illegal one is above the legal ones.

    Integers of 64 bits also stand for pointers and ``size_t``, which the platforms' calling conventions pass
    alike. The address is a run-time value: one compilation serves every FMU.
    """
    signature = types.int64(address, arguments)

    def generate(context, builder, signature, values):
        pointer, packed = values
        c_arguments = [builder.extract_value(packed, i) for i in range(len(arguments))]
        c_type = ir.FunctionType(ir.IntType(32), [argument.type for argument in c_arguments])
        status = builder.call(builder.inttoptr(pointer, c_type.as_pointer()), c_arguments)
        return builder.zext(status, ir.IntType(64))

    return signature, generate
