"""The head that all documents have: what was tried under which conditions, with what, and what that took.

All values are in SI units; None stands for a value that does not exist.
"""

from __future__ import annotations

from typing import Literal

from ..benchmark.results import Rules
from ..codec import Finite, Natural, NonNegative, Struct
from ..loop.carry_over import CarryOver
from ..loop.computing import ComputingTime


class BoundRecord(Struct):
    """The variables of the controller that a connector is bound to, how they were found, what could not be checked."""

    variables: tuple[str, ...]
    found: str
    notes: tuple[str, ...] = ()


class FmuRecord(Struct):
    """An FMU as used. ``parameters`` are those that were set: the controller's in its own units, the plant's in SI."""

    file: str
    sha256: str
    fmi_version: str
    generation_tool: str | None
    parameters: dict[str, Finite]


class ControllerRecord(FmuRecord):
    """The controller, with its path as it was given, its mapping and connectors; a connector is None if an optional
    one is absent. ``library`` says where its library comes from: the FMU's binary, its sources, or its binary for
    Windows under Wine."""

    path: str
    mapping: dict[str, str]
    connectors: dict[str, BoundRecord | None]
    library: Literal["native", "source", "wine"] = "native"


class PlantRecord(FmuRecord):
    """The plant, with all its nominal parameters.

    ``build`` is "python" or "native", of the same equations, or "file"; ``model`` is the SHA-256 of these equations'
    sources, or of the file ``path``.
    """

    nominal: dict[str, Finite]
    build: Literal["python", "native", "file"]
    model: str
    path: str = ""


class SampleTimeRecord(Struct):
    """The controller's sample time [s]."""

    seconds: NonNegative
    as_in_benchmark: bool


class Timing(Struct, kw_only=True):
    """When a study began, and what it took: ``wall_time`` [s] on ``workers`` processes.

    ``simulations`` counts those that were asked for, also where an earlier run had finished them; ``simulated_time``
    and ``simulation_time`` [s] are sums over them. ``computing_time`` is the controller's, per sample; None if it was
    not measured.
    """

    start: str
    wall_time: NonNegative
    workers: Natural
    simulations: Natural = 0
    simulated_time: NonNegative = 0.0
    simulation_time: NonNegative = 0.0
    computing_time: ComputingTime | None = None


class Head(Struct, kw_only=True):
    """What a document was made with.

    ``protocol_file`` is the path of a protocol that does not come with the benchmark; ``seed`` is None for several.
    ``carry_over`` tells whether state of the FMUs passed from one simulation to the next in the same process, and then
    each simulation had a process of its own: because the controller declares that a process can instantiate it only
    once, because a repeated simulation gave other numbers after others than in a fresh process (``"found"``), or other
    numbers each time. ``environment`` holds versions and platform, ``command`` the command line, if there was one.
    """

    benchmark: str
    protocol: str
    protocol_file: str = ""
    seed: Natural | None
    controller: ControllerRecord
    plant: PlantRecord
    sample_time: SampleTimeRecord
    rules: Rules
    carry_over: CarryOver = CarryOver.NOT_TESTED
    environment: dict[str, str]
    command: str = ""
    timing: Timing
