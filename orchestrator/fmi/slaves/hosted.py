"""Slaves whose library is loaded by the host: the classes of each standard, with their library in another process."""

from __future__ import annotations

import ctypes
import functools
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import Crash, InputError
from .. import log
from .. import port as ports
from ..host.remote import CONNECT, Function, Library
from ..port import Port
from ..variables import Variable
from . import said
from .base import Slave, Values
from .called_back import callback


class Hosted(Slave):
    """What a slave does otherwise if its library is in the host. In co-simulation, the host makes the three calls of a
    step; in Model Exchange the loop makes each through a callback into Python."""

    def _load(self) -> Any:
        fmu = self.fmpy_class.__new__(self.fmpy_class)
        self._library = Library(self.archive.name, self.archive.library, _keep)
        fmu.guid, fmu.modelIdentifier = self.archive.description.guid, self.archive.interface.modelIdentifier
        fmu.unzipDirectory, fmu.instanceName = str(self.archive.folder), fmu.modelIdentifier
        fmu.fmiCallLogger, fmu.requireFunctions, fmu.callbacks, fmu.component = None, True, None, None
        fmu.dll, fmu._functions = self._library, {}
        fmu._loadFunctions()
        return fmu

    def set(self, values: Values) -> None:
        """Set variables; raises :class:`~orchestrator.errors.InputError` for texts, which the host is not sent."""
        for variable in values:
            if variable.type in ("String", "Binary"):
                message = f"{self.archive.name}: {variable.name} is a {variable.type}, which cannot be set under Wine."
                raise InputError(message, "not-settable", self.archive.name, variable.name)
        super().set(values)

    def messages(self) -> tuple[str, ...]:
        """What the instance has said last, also in the loop; raises :class:`~orchestrator.errors.Crash` if the host is
        gone."""
        self._library.call("", 0, [])
        return said.lines()

    def lost(self) -> Crash:
        """What became of the host, which gives no answer."""
        return self._library.host.lost()

    def address(self, function: str) -> int:
        """The address of a function in the host; in Model Exchange that of a callback here."""
        if self.archive.kind == "CoSimulation":
            return self._remote(function)
        found = callback(function, lambda name, given: self._library.call(name, self._remote(name), given))
        self._callbacks[function] = found  # kept alive while compiled code has its address
        return ctypes.cast(found, ctypes.c_void_p).value or 0

    def _remote(self, function: str) -> int:
        found: Function = self._fmu._functions[function]
        return found.address

    def port(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Port:
        self._callbacks: dict[str, Any] = {}
        own = super().port(inputs, outputs)
        if self.archive.kind != "CoSimulation":
            return own
        version = int(self.archive.major_version)
        sizes = own.input_values.size, own.output_values.size, int(own.single[0]), int(own.single[1])
        words = version, own.instance, own.set_values, own.do_step, own.get_values, *sizes, len(inputs), len(outputs)
        references = own.inputs.tobytes() + own.outputs.tobytes()
        self._library.host.ask(CONNECT, struct.pack("=11Q", *words) + references)
        functions = np.zeros(5, dtype=np.int64)
        functions[ports.REQUESTS], functions[ports.ANSWERS] = self._library.host.requests, self._library.host.answers
        return own._replace(
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
