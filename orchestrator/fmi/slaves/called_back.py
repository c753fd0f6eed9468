"""Functions in a host as C functions of this process, for the loop that steps a Model Exchange controller: each is a
callback into Python, which asks the host."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

from ..host.remote import Ask

BROKEN = -1
"""What a callback returns if the host gives no answer; no FMU may return it."""

ARGUMENTS: Mapping[str, Sequence[Any]] = {
    "SetTime": (ctypes.c_int64, ctypes.c_double),
    "EnterEventMode": (ctypes.c_int64,),
    "EnterContinuousTimeMode": (ctypes.c_int64,),
    "NewDiscreteStates": (ctypes.c_int64,) * 2,
    "UpdateDiscreteStates": (ctypes.c_int64,) * 7,
    "CompletedIntegratorStep": (ctypes.c_int64, ctypes.c_uint8, ctypes.c_int64, ctypes.c_int64),
    **dict.fromkeys(("SetReal", "GetReal"), (ctypes.c_int64,) * 4),
    **{f"{call}{name}": (ctypes.c_int64,) * 5 for call in ("Set", "Get") for name in ("Float64", "Float32")},
}
"""Types by the function's name without its beginning; pointers are numbers."""

EVENT_INFO, FLAG, NUMBER = 40, 1, 8
"""Bytes of an fmi2EventInfo, of a Boolean of FMI 3, of a float64."""


def callback(function: str, ask: Ask) -> Any:
    """A ctypes function with the arguments of ``function``, such as ``fmi2SetTime``, as the loop calls it."""
    name = function[4:]
    kinds = ARGUMENTS[name]

    def called(*arguments: Any) -> int:
        try:
            sizes = _pointers(function, arguments)
            encoded = [
                _encoded(kind, value, sizes.get(i))
                for i, (kind, value) in enumerate(zip(kinds, arguments, strict=True))
            ]
            result, contents = ask(function, encoded)
            for i, content in zip(sorted(sizes), contents, strict=True):
                ctypes.memmove(arguments[i], content, len(content))
            return ctypes.c_int32(result & 0xFFFFFFFF).value
        except Exception:  # one that leaves a callback becomes 0 = OK for its caller in C
            return BROKEN

    return ctypes.CFUNCTYPE(ctypes.c_int32, *kinds)(called)


def _pointers(function: str, arguments: Sequence[Any]) -> dict[int, int]:
    """Sizes [bytes] of what the arguments with these numbers point to."""
    name = function[4:]
    if name == "NewDiscreteStates":
        return {1: EVENT_INFO}
    if name == "UpdateDiscreteStates":
        return {**dict.fromkeys(range(1, 6), FLAG), 6: NUMBER}
    if name == "CompletedIntegratorStep":
        size = FLAG if function.startswith("fmi3") else ctypes.sizeof(ctypes.c_int32)
        return {2: size, 3: size}
    if name.startswith(("Set", "Get")) and name != "SetTime":
        width = 4 if name.endswith("32") else NUMBER
        return {1: 4 * arguments[2], 3: width * arguments[-1 if len(arguments) == 5 else 2]}
    return {}


def _encoded(kind: Any, value: Any, size: int | None) -> tuple[bytes, int, bytes]:
    if size is not None:
        return b"b", size, ctypes.string_at(value, size)
    if kind is ctypes.c_double:
        return b"d", int.from_bytes(bytes(ctypes.c_double(value)), "little"), b""
    return b"i", value & 0xFFFFFFFFFFFFFFFF, b""
