"""A simulation whose controller is the caller: the master loop waits for each torque."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from greenlet import GreenletExit, getcurrent, greenlet

from ..errors import Crash
from ..fmi import port, trace
from ..fmi.slaves import Slave
from .closed_loop import SampleArrays
from .controller import Steady
from .master import simulate
from .scenario import Pair, Scenario
from .setup import Setup
from .trajectory import Trajectory

PIPE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)
"""The C functions read and write, as the loop calls them."""


class _Caller(NamedTuple):
    """Stands for the archive of the controller, which has none, in messages."""

    name: str = "The caller"


class Stepwise:
    """The simulation of ``scenario``, which goes on from sample to sample as torques are given.

    The master loop runs in a greenlet, a stack of its own that is switched to and from in a microsecond, which threads
    take fifty of. It reaches the caller as it does a controller in another process, with functions that switch in
    the place of the pipes: so it is the same loop, and the numbers are the same to the last bit.

    ``observe`` is that of :func:`~orchestrator.loop.master.simulate`. The plant must not be in another simulation.
    """

    broken = False
    archive, calls = _Caller(), {"set": "step", "step": "step", "get": "step"}
    steady: Steady
    """The plant's steady state, known from :meth:`begin` on."""
    trajectory: Trajectory | None = None
    """What the simulation has left behind, once it has ended."""

    def __init__(self, plant: Slave, scenario: Scenario, observe: Sequence[str] = ()) -> None:
        def run() -> None:
            with suppress(Crash):  # the caller has ended it
                self.trajectory = simulate(plant, self, scenario, observe=observe, watch=self._watch)

        self._loop = greenlet(run)
        self._port = port.unconnected((0, 0), 2, (0, 0), 2)
        # Kept: the loop has their addresses alone.
        self._pipes = PIPE(self._write), PIPE(self._read)

    def begin(self) -> Pair | None:
        """Initialize the plant; returns what :meth:`step` does, and raises what the simulation raises."""
        return self._resume()

    def step(self, u_m: Pair) -> Pair | None:
        """Command the torques ``u_m`` [N.m] for the sample; returns the motor angles [rad] measured at the next one,
        or None if the simulation has ended."""
        return self._resume(u_m)

    def position(self, sample: int) -> np.ndarray:
        """Position X of the tool [m] at a sample that was reached."""
        return self._record.outputs[sample, 2:4]

    def observed(self, sample: int) -> tuple[float, ...]:
        """The plant's outputs ``observe`` at a sample that was reached."""
        return tuple(self._record.outputs[sample, 4:].tolist())

    def close(self) -> None:
        """End the simulation where it is."""
        # A greenlet is false before its start and after its end.
        if self._loop:
            self._resume(None)

    def _resume(self, *torques: Pair | None) -> Pair | None:
        # A greenlet that ends returns to its parent, which must be the one that waits now and not the one that made it.
        self._loop.parent = getcurrent()
        measured: Pair | None = self._loop.switch(*torques)
        return measured

    def _watch(self, record: SampleArrays) -> None:
        self._record = record

    def _write(self, _pipe: int, _at: int, size: int) -> int:
        return size

    def _read(self, _pipe: int, _at: int, size: int) -> int:
        info = self._port.info
        assert self._loop.parent is not None
        try:
            u_m = self._loop.parent.switch((float(info[1]), float(info[2])))
        except GreenletExit:  # nothing refers to this simulation any more
            return -1
        if u_m is None:
            return -1
        info[:4] = port.GET, 0.0, *u_m
        return size

    @contextmanager
    def prepared(
        self, setup: Setup, steady: Steady, sample_time: Fraction, stop_time: float, first: Pair | None
    ) -> Iterator[port.Port]:
        """The loop's way to the caller."""
        self.steady = steady
        write, read = (ctypes.cast(pipe, ctypes.c_void_p).value or 0 for pipe in self._pipes)
        yield self._port._replace(
            stepping=port.REMOTE, set_values=write, get_values=read, side=trace.CONTROLLER, trace=trace.current.words
        )

    def messages(self) -> tuple[str, ...]:
        """The caller logs nothing."""
        return ()

    def terminate(self) -> None:
        """There is nothing to end."""

    def lost(self) -> Crash:
        """The error of a simulation that the caller has ended."""
        return Crash("the caller has ended the simulation")
