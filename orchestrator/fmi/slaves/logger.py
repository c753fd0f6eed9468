"""The functions that FMUs log through, in machine code.

An FMU may log from threads of its own while the loop waits for it, so these functions take no lock: a callback into
Python would wait for the interpreter's, which the loop holds, for ever. They write into the process's
:class:`~orchestrator.fmi.log.Log`; a message of status OK is counted only. Numba's compiler makes them, as C would need
one on this machine, and ctypes knows no callbacks with variable arguments, which FMI 1 and 2 hand to printf.
"""

from __future__ import annotations

import ctypes
import functools
import platform
import sys
from typing import Any

from fmpy import calloc, free
from llvmlite import binding, ir

from .. import log
from ..port import c_function
from ..trace import CONTROLLER, NOBODY, PLANT

I32, I64, BYTES = ir.IntType(32), ir.IntType(64), ir.IntType(8).as_pointer()

NAMES = {side: ctypes.create_string_buffer(log.TEXT - log.INSTANCE) for side in (NOBODY, PLANT, CONTROLLER)}
"""By side, the instance that its messages are said to be from in FMI 3, whose loggers are told of none."""

ANY = "any"
"""The logger of FMI 1 and 2, which serves all instances."""

_EMPTY, _FORMAT = ctypes.create_string_buffer(b""), ctypes.create_string_buffer(b"%s")
LIST_IS_POINTER = sys.platform == "win32" or (sys.platform == "darwin" and platform.machine() == "arm64")
"""Whether C's va_list is a pointer itself. Elsewhere it is a structure, which functions are given the address of."""


def callbacks(kind: type[ctypes.Structure]) -> ctypes.Structure:
    """FMPy's callbacks of FMI 1 or 2, all of them functions in C: FMPy's own are callbacks into Python, and an FMU may
    call any from its threads."""
    addresses = {"logger": logger(ANY)}
    for name, function in (("allocateMemory", calloc), ("freeMemory", free)):
        addresses[name] = ctypes.cast(function, ctypes.c_void_p).value or 0
    types: dict[str, Any] = dict(kind._fields_)  # type: ignore[arg-type]
    return kind(**{name: types[name](address) for name, address in addresses.items()})


def logger_3(side: int, instance: str) -> int:
    """The address of a logger of FMI 3 for the FMU of ``side``, whose messages are from ``instance``."""
    NAMES[side].value = instance.encode()[: len(NAMES[side]) - 1]
    return logger(str(side))


def logger(name: str) -> int:
    """The address of a logger."""
    return int(_engine().get_function_address(f"log_{name}"))


@functools.cache
def _engine() -> Any:
    """Holds the machine code."""
    module = ir.Module("log")
    _define(module, ANY, None)
    for side, instance in NAMES.items():
        _define(module, str(side), instance)
    machine = binding.Target.from_default_triple().create_target_machine(opt=1, jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(str(module)), machine)
    engine.finalize_object()
    return engine


def _define(module: ir.Module, name: str, instance: Any) -> None:
    """A logger: of FMI 3 with the name ``instance``, or with None that of FMI 1 and 2.

    ``void log(void *environment, [const char *instance,] int status, const char *category, const char *message, ...)``
    """
    variadic = instance is None
    arguments = [BYTES, BYTES, I32, BYTES, BYTES] if variadic else [BYTES, I32, BYTES, BYTES]
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), arguments, var_arg=variadic), f"log_{name}")
    status, message = function.args[-3], function.args[-1]
    builder = ir.IRBuilder(function.append_basic_block())
    head = builder.load(_at(builder, ctypes.addressof(log.place), BYTES.as_pointer()))
    # An atomic addition: other threads of the FMU may log at the same moment.
    _next(builder, head, log.COUNT)
    with builder.if_then(builder.icmp_signed(">", status, I32(0))):
        number = _next(builder, head, log.KEPT)
        slot = _field(builder, head, builder.mul(builder.and_(number, I64(log.SLOTS - 1)), I64(log.SLOT)), log.HEAD)
        done = builder.bitcast(slot, I64.as_pointer())
        # A reader in another process must see the slot as unfinished before
        # its bytes change, and as finished only after they have.
        builder.store_atomic(I64(0), done, "seq_cst", 8)
        named = _text(builder, function.args[1]) if variadic else _at(builder, ctypes.addressof(instance), BYTES)
        _print(builder, slot, log.INSTANCE, log.TEXT, named)
        if variadic:
            _print_list(builder, slot, _text(builder, message))
        else:
            _print(builder, slot, log.TEXT, log.SLOT, _text(builder, message))
        builder.store_atomic(builder.add(number, I64(1)), done, "release", 8)
    builder.ret_void()


def _at(builder: ir.IRBuilder, address: int, kind: ir.Type) -> Any:
    return builder.inttoptr(I64(address), kind)


def _field(builder: ir.IRBuilder, base: Any, offset: Any, more: int = 0) -> Any:
    return builder.gep(base, [builder.add(offset, I64(more))])


def _next(builder: ir.IRBuilder, head: Any, word: int) -> Any:
    """Count up a word of the log; what it was before."""
    place = builder.bitcast(_field(builder, head, I64(8 * word)), I64.as_pointer())
    return builder.atomic_rmw("add", place, I64(1), "monotonic")


def _text(builder: ir.IRBuilder, pointer: Any) -> Any:
    """``pointer``, or that to an empty text for NULL."""
    # OpenModelica/OMSimulator#1323: FMUs log with NULL in the place of a text, with which printf may crash.
    missing = builder.icmp_unsigned("==", builder.ptrtoint(pointer, I64), I64(0))
    return builder.select(missing, _at(builder, ctypes.addressof(_EMPTY), BYTES), pointer)


def _print(builder: ir.IRBuilder, slot: Any, begin: int, end: int, text: Any) -> None:
    snprintf = _at(
        builder, c_function("snprintf"), ir.FunctionType(I32, [BYTES, I64, BYTES], var_arg=True).as_pointer()
    )
    form = _at(builder, ctypes.addressof(_FORMAT), BYTES)
    builder.call(snprintf, [_field(builder, slot, I64(begin)), I64(end - begin), form, text])


def _print_list(builder: ir.IRBuilder, slot: Any, form: Any) -> None:
    """Print the function's own variable arguments."""
    vsnprintf = _at(builder, c_function("vsnprintf"), ir.FunctionType(I32, [BYTES, I64, BYTES, BYTES]).as_pointer())
    begin, end = (
        ir.Function(builder.module, ir.FunctionType(ir.VoidType(), [BYTES]), f"llvm.va_{name}")
        for name in ("start", "end")
    )
    with builder.goto_entry_block():
        memory = builder.alloca(ir.ArrayType(I64, 4))
        # The System V ABI of x86-64 has a va_list of 24 bytes, that of AArch64 one of 32.
        memory.align = 16
    variables = builder.bitcast(memory, BYTES)
    builder.call(begin, [variables])
    handed = builder.load(builder.bitcast(variables, BYTES.as_pointer())) if LIST_IS_POINTER else variables
    builder.call(vsnprintf, [_field(builder, slot, I64(log.TEXT)), I64(log.SLOT - log.TEXT), form, handed])
    builder.call(end, [variables])
