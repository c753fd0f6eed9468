"""Slaves whose library is loaded by the host: the classes of each standard, with their library in another process.

For a Model Exchange controller, the loop gets functions of the host as C functions of this process: each is a callback
into Python, which asks the host.
"""

from __future__ import annotations

import ctypes
import functools
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import Crash, InputError
from .. import log
from .. import port as ports
from ..host.wine import CONNECT, Ask, Function, Library
from ..port import Port
from ..variables import Variable
from .base import Slave, Values

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


class Hosted(Slave):
    """What a slave does otherwise if its library is in the host. In co-simulation, the host makes the three calls of a
    step; in Model Exchange the loop makes each through a callback into Python."""

    def _load(self) -> Any:
        # Without FMPy's constructor, which loads the library into this process.
        fmu = self.fmpy_class.__new__(self.fmpy_class)
        self._library = Library(self.archive.name, self.archive.library_file, _keep)
        fmu.guid, fmu.modelIdentifier = self.archive.description.guid, self.archive.interface.modelIdentifier
        fmu.unzipDirectory, fmu.instanceName = str(self.archive.folder), fmu.modelIdentifier
        fmu.fmiCallLogger, fmu.requireFunctions, fmu.callbacks, fmu.component = None, True, None, None
        fmu.dll, fmu._functions = self._library, {}
        fmu._loadFunctions()
        return fmu

    def set(self, values: Values) -> None:
        """Set variables; raises :class:`~orchestrator.errors.InputError` for texts, which the host is not sent."""
        for variable in values:
            # They are pointers to pointers, which the host's protocol does not carry.
            if variable.type in ("String", "Binary"):
                message = f"{self.archive.name}: {variable.name} is a {variable.type}, which cannot be set under Wine."
                raise InputError(message, "not-settable", self.archive.name, variable.name)
        super().set(values)

    def messages(self) -> tuple[str, ...]:
        """What the instance has said last, also in the loop; raises :class:`~orchestrator.errors.Crash` if the host is
        gone."""
        self._library.call("", 0, [])
        return log.last_lines()

    def lost(self) -> Crash:
        """What became of the host, which gives no answer."""
        return self._library.host.lost()

    def address(self, function: str) -> int:
        """The address of a function in the host; in Model Exchange that of a callback here."""
        # There the host makes the three calls of a step itself: one change of process in place of three.
        if self.archive.kind == "CoSimulation":
            return self._remote(function)
        pointer = callback(function, lambda name, given: self._library.call(name, self._remote(name), given))
        self._callbacks[function] = pointer  # kept alive while compiled code has its address
        return ctypes.cast(pointer, ctypes.c_void_p).value or 0

    def _remote(self, function: str) -> int:
        remote: Function = self._fmu._functions[function]
        return remote.address

    def port(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Port:
        self._callbacks: dict[str, Any] = {}
        port = super().port(inputs, outputs)
        if self.archive.kind != "CoSimulation":
            return port
        version = int(self.archive.major_version)
        sizes = port.input_values.size, port.output_values.size, int(port.single[0]), int(port.single[1])
        words = (
            version,
            port.instance,
            port.set_values,
            port.do_step,
            port.get_values,
            *sizes,
            len(inputs),
            len(outputs),
        )
        references = port.inputs.tobytes() + port.outputs.tobytes()
        self._library.host.ask(CONNECT, struct.pack("=11Q", *words) + references)
        functions = np.zeros(5, dtype=np.int64)
        functions[ports.REQUESTS], functions[ports.ANSWERS] = self._library.host.requests, self._library.host.answers
        return port._replace(
            stepping=ports.HOSTED,
            set_values=ports.c_function("write"),
            get_values=ports.c_function("read"),
            functions=functions,
        )


def _keep(line: bytes) -> None:
    """Keep a message that the host has formatted, and printed."""
    log.current.keep(line)


@functools.cache
def hosted(kind: type[Slave]) -> type[Hosted]:
    """The class ``kind`` with its library in the host."""
    return type(f"Hosted{kind.__name__}", (Hosted, kind), {})
