"""What slaves of all standards have in common: the life cycle, how it fails, why a loader refuses a library, and that
FMUs in Python keep to their own modules."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import platform
import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from ...codec import Scalar
from ...errors import BenchmarkError, Crash, FmuError, InputError
from .. import log, trace
from ..archive import Archive
from ..library import NATIVE, has_sources
from ..port import FATAL, Port, unconnected
from ..symbols import load_with_its_own
from ..variables import Variable


class PrivateModules:
    """The modules that one FMU imported from below ``folder``: Python FMUs in one process share one interpreter.

    pythonfmu puts an FMU's resources at the head of ``sys.path`` and imports from there. A second FMU with a module of
    the same name would silently run the first one's code. Here what an FMU imported from its own folder, and its
    folders on the path, are gone when another FMU has its turn, and come back when it is its own again, so nothing is
    imported twice.
    """

    _turns: ClassVar[list[PrivateModules]] = []
    """Whose turn it is, the last one's; those before it go on when it ends."""

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._has_resources = folder.is_dir()
        self._modules: dict[str, ModuleType] = {}
        self._covered: dict[str, ModuleType] = {}
        self._path: list[str] = []
        self._foreign: dict[str, ModuleType] = {}
        """Modules looked at before: there are hundreds, and this is done several times a simulation."""

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """Within, the FMU sees its own modules and folder; after it, nobody sees them.

        An FMU without resources has none.
        """
        if not self._has_resources:
            yield
            return
        if self._turns:
            self._turns[-1]._withdraw()
        self._turns.append(self)
        self._step_in()
        try:
            yield
        finally:
            self._withdraw()
            self._turns.pop()
            if self._turns:
                self._turns[-1]._step_in()

    def _step_in(self) -> None:
        self._covered = {name: sys.modules[name] for name in self._modules if name in sys.modules}
        sys.modules.update(self._modules)
        sys.path[:0] = self._path

    def _withdraw(self) -> None:
        unknown = {name: module for name, module in sys.modules.items() if self._foreign.get(name) is not module}
        imported = {name: module for name, module in unknown.items() if self._owns(getattr(module, "__file__", None))}
        self._modules.update(imported)
        for name in imported:
            del sys.modules[name], unknown[name]
        self._foreign.update(unknown)
        sys.modules.update(self._covered)
        self._path = list(dict.fromkeys(entry for entry in sys.path if self._owns(entry)))
        sys.path[:] = [entry for entry in sys.path if not self._owns(entry)]

    def _owns(self, path: str | None) -> bool:
        return str(path or "").startswith(self._folder)


Values = Mapping[Variable, Sequence[Scalar]]
"""Values of variables, all elements of each."""


NEWER_SYSTEM = re.compile(r"version [`'](GLIBC(?:XX)?_[\w.]+|CXXABI_[\w.]+)' not found")

MISSING_LIBRARY = re.compile(r"([^\s:/]+): cannot open shared object file")


class Slave(ABC):
    """One loaded FMU, of which one instance at a time is alive.

    A subclass says how its standard instantiates, initializes and steps.
    """

    fmpy_class: Any
    """What holds the library."""

    stepping: int
    """How the compiled loop steps it, see :mod:`orchestrator.fmi.port`."""

    broken = False
    """Whether a call has returned the status fatal. No call may follow, not even to free the instance: where a
    law in Python had raised, pythonfmu ended the process there, seldom, and a case was told as a crash."""

    with_sizes = False
    _stop_time = 0.0
    calls: Mapping[str, str]
    """FMI names of the functions behind "set", "step" and "get"."""

    def __init__(self, archive: Archive, side: int = trace.NOBODY) -> None:
        """Load the FMU's library; raises what :func:`.refusal` gives if the platform's loader refuses it."""
        self.archive, self.side = archive, side
        self._modules = PrivateModules(archive.folder / "resources")
        trace.current.note(side, "loading its library")
        log.watch_files()
        folder = os.getcwd()
        try:
            self._fmu = self._load()
        except (Crash, FmuError):
            raise
        except Exception as problem:
            raise refusal(archive, problem) from problem
        finally:
            os.chdir(folder)  # FMPy leaves a failed load inside the FMU's folder

    def _load(self) -> Any:
        """The FMPy object that holds the library."""
        library = self.archive.library_file
        load_with_its_own(library)
        fmu = self.fmpy_class(
            guid=self.archive.description.guid,
            modelIdentifier=self.archive.interface.modelIdentifier,
            unzipDirectory=str(library.parents[2]),  # where FMPy looks for a library of FMI 3, whatever its path
            libraryPath=str(library),
        )
        # The resources are there; only the library may lie elsewhere, if it was compiled here.
        fmu.unzipDirectory = str(self.archive.folder)
        return fmu

    @abstractmethod
    def _instantiate(self, stop_time: float) -> None:
        """Create the instance and set up the experiment."""

    @abstractmethod
    def _free(self) -> None:
        """Free the instance but leave the library loaded: FMPy's freeInstance unloads it, and the next instance
        would call into nothing."""

    @abstractmethod
    def _initialize(self, within: Values) -> None:
        """From the instantiated state to the first step, setting ``within`` on the way."""

    def set(self, values: Values) -> None:
        """Set variables."""
        reals = {variable: elements for variable, elements in values.items() if variable.is_real}
        if reals:
            references = [variable.reference for variable in reals]
            self._do(self._fmu.setReal, references, [element for array in reals.values() for element in array])
        for variable, elements in values.items():
            if not variable.is_real:
                self._set_other(variable, elements)

    def _set_other(self, variable: Variable, elements: Sequence[Scalar]) -> None:
        """Set a variable of a type that is not real."""
        # FMI 1.0 and 2.0 set an enumeration by the functions for integers.
        kind = "Integer" if variable.type == "Enumeration" else variable.type
        self._do(getattr(self._fmu, f"set{kind}"), [variable.reference], list(elements))

    def get(self, variables: Sequence[Variable]) -> list[float]:
        """Values of variables, the elements of arrays one after the other.

        Raises :class:`FmuError` for one that the FMU does not write.
        """
        return self._got(self.calls["get"], ctypes.c_double, variables)

    def _got(
        self, call: str, kind: type[ctypes.c_double | ctypes.c_float], variables: Sequence[Variable]
    ) -> list[float]:
        """The values that the function ``call`` writes into memory that holds none before."""
        references = (ctypes.c_uint32 * len(variables))(*(variable.reference for variable in variables))
        size = sum(variable.size for variable in variables)
        values = (kind * size)(*[math.nan] * size)
        sizes = (size,) if self.with_sizes else ()
        self._do(getattr(self._fmu, call), self._fmu.component, references, len(variables), values, *sizes)
        numbers: list[float] = list(values)
        if any(map(math.isnan, numbers)):
            names = ", ".join(variable.name for variable in variables)
            raise FmuError(f"{self.archive.name}: {call} gives no number for {names}", call, log.last_lines())
        return numbers

    def messages(self) -> tuple[str, ...]:
        """What the instance has said last."""
        return log.last_lines()

    def lost(self) -> Crash:
        """What became of the process that holds the library, if it is another one and gives no answer."""
        raise NotImplementedError

    def terminate(self) -> None:
        """End the simulation of the instance."""
        self._do(self._fmu.terminate)

    @abstractmethod
    def _reset(self, stop_time: float) -> None:
        """Bring the instance back to where ``_instantiate`` left it."""

    def reset(self) -> None:
        """Bring the instance back to before its initialization."""
        with self._modules.in_place(), self._reported("reset"):
            self._reset(self._stop_time)

    @contextmanager
    def instantiated(self, stop_time: float) -> Iterator[Slave]:
        """An instance for a simulation from 0 to ``stop_time`` [s], freed at the end."""
        # Else the messages of the simulation before would be told as this one's.
        log.current.clear()
        with self._modules.in_place(), self._reported("instantiation"):
            try:
                self._instantiate(stop_time)
            except Crash:
                raise
            except Exception as problem:
                raise RuntimeError(f"{problem}. {self._usual_reasons()}") from problem
        self._stop_time = stop_time
        try:
            yield self
        except Crash:  # the process ends, and its trace stays where that was
            raise
        except BaseException:
            self._end()
            raise
        self._end()

    def _end(self) -> None:
        if not self.broken:
            trace.current.note(self.side, "freeing the instance")
            self._free()

    def _usual_reasons(self) -> str:
        """Why FMUs give no instance: all they can say is NULL, and what they log."""
        reasons = (
            "Usual reasons are a missing licence, a GUID that is not the binary's, or a missing file: simulations "
            "run in an empty folder, so files belong in the FMU's resources."
        )
        if str(self.archive.interface.needsExecutionTool).lower() in ("true", "1"):
            tool = self.archive.description.generationTool or "its exporter's tool"
            reasons += f" The FMU declares that it needs a tool to run: is {tool} or its runtime installed here?"
        return reasons

    def initialize(self, before: Values, within: Values) -> None:
        """Initialize with the values ``before`` (parameters) and ``within`` initialization mode (inputs)."""
        self.set(before)
        # pythonfmu drops a reference too many where a slave raises in exitInitializationMode; a later collection of
        # garbage may end the process, so one that has met a refusal does without.
        collecting = gc.isenabled()
        gc.disable()
        with self._modules.in_place():
            self._initialize(within)
        if collecting:
            gc.enable()

    @contextmanager
    def own_modules(self) -> Iterator[None]:
        """Within, a Python FMU finds its own modules, also those it imports only now."""
        with self._modules.in_place():
            yield

    def port(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Port:
        """Native access for the compiled loop; signals and values are the same until scaled otherwise."""
        size_in, size_out = (sum(variable.size for variable in side) for side in (inputs, outputs))
        single = tuple(any(variable.type == "Float32" for variable in side) for side in (inputs, outputs))
        names = (self.calls["set"], self.calls["get"])
        set_values, get_values = (
            name.replace("64", "32") if narrow else name for name, narrow in zip(names, single, strict=True)
        )
        trace.current.expect(self.side, (set_values, self.calls["step"], get_values))
        written, read = ([variable.reference for variable in side] for side in (inputs, outputs))
        return unconnected(written, size_in, read, size_out)._replace(
            stepping=self.stepping,
            with_sizes=self.with_sizes,
            instance=self.instance,
            set_values=self.address(set_values),
            do_step=self._step_address(),
            get_values=self.address(get_values),
            functions=self._functions(),
            single=(single[0], single[1]),
            side=self.side,
            trace=trace.current.words,
        )

    def _step_address(self) -> int:
        return self.address(self.calls["step"])

    def _functions(self) -> np.ndarray:
        """Addresses of the functions of Model Exchange."""
        return np.zeros(5, dtype=np.int64)

    @property
    def instance(self) -> int:
        """The instance pointer as an integer."""
        component: Any = self._fmu.component
        return int(getattr(component, "value", component))

    def address(self, function: str) -> int:
        """Address of the C function ``function``, such as ``fmi2DoStep``."""
        return ctypes.cast(self._fmu._functions[function], ctypes.c_void_p).value or 0

    @contextmanager
    def _reported(self, call: str) -> Iterator[None]:
        """Whatever fails within becomes an :class:`FmuError` that names the FMU, the call, and the FMU's messages."""
        trace.current.note(self.side, call)
        try:
            yield
        except (Crash, FmuError):
            raise
        except Exception as problem:
            self.broken = self.broken or getattr(problem, "status", None) == FATAL  # FMPy's FMICallException
            raise FmuError(f"{self.archive.name}: {call} failed: {problem}", call, log.last_lines()) from None

    def _do(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a method of the FMPy object."""
        with self._reported(function.__name__):
            return function(*arguments)


def refusal(archive: Archive, problem: Exception) -> BenchmarkError:
    """The error for a library that cannot be loaded. An :class:`InputError` says what to do about a binary that was
    built for a newer system than this one, or one that needs a library beside it and does not look for it there."""
    message, newer = f"{archive.name} cannot be loaded: {problem}", NEWER_SYSTEM.search(str(problem))
    library = archive.library_file
    if (machine := _machine(library)) not in (None, _machine(Path(sys.executable))):
        message = f"{archive.name} cannot be loaded: its library {library.name} is for another kind of processor "
        message += f"(ELF machine {machine}). Export it for this one, {platform.machine()}."
        return InputError(message, "load", archive.name, library.name)
    if newer is not None:
        message = f"{archive.name} cannot be loaded: its binary needs {newer[1]}, which is newer than this system. "
        if archive.library == NATIVE and has_sources(archive.folder):
            return InputError(f"{message}Its sources are in it.", "newer-system", archive.name, newer[1])
        return InputError(
            f"{message}Export it on an older system, or with its sources.", "load", archive.name, newer[1]
        )
    if (missing := MISSING_LIBRARY.search(str(problem))) is not None:
        places = [path for path in archive.folder.rglob(missing[1]) if path.is_file()]
        # The loader looks in the system's folders and in the library's RPATH;
        # beside the library it does not look by itself, as Windows does.
        if places:
            message = f"{archive.name} cannot be loaded: it needs {missing[1]}, which the FMU has in "
            message += (
                f"{places[0].parent.relative_to(archive.folder)}, but its library does not name the place. Link it "
            )
            message += "with the RPATH $ORIGIN (-Wl,-rpath,'$ORIGIN'), and put the other library beside it."
            return InputError(message, "load", archive.name, missing[1])
    return FmuError(message, "load")


def _machine(file: Path) -> int | None:
    """The processor that an ELF file is for, by its number there; None for a file of another kind."""
    try:
        with file.open("rb") as opened:
            head = opened.read(20)
    except OSError:
        return None
    # Bytes 18 and 19 of an ELF file are e_machine.
    return int.from_bytes(head[18:20], "little") if head[:4] == b"\x7fELF" and len(head) == 20 else None
