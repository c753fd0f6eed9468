"""The head that all documents have: what was tried under which conditions, with what, and what that took.

All values are in SI units; None stands for a value that does not exist.
"""

from __future__ import annotations

from typing import Literal

from ..benchmark.results import Rules
from ..codec import Finite, Natural, NonNegative, Scalar, Struct
from ..loop.behaviour import CarryOver, ComputingTime


class BoundRecord(Struct):
    """The variables of the controller that a connector is bound to, how they were found, what could not be checked."""

    variables: tuple[str, ...]
    found: str
    notes: tuple[str, ...] = ()


class FmuRecord(Struct):
    """An FMU as used."""

    file: str
    sha256: str
    fmi_version: str
    generation_tool: str | None


class ControllerRecord(FmuRecord):
    """The controller, with its path as it was given, its mapping and connectors; a connector is None if an optional
    one is absent. ``library`` says where its library comes from: the FMU's binary, its sources, or its binary for
    Windows under Wine.

    ``parameters`` are the values that were given, in the FMU's units and with the types of its variables: a number for
    an item of an enumeration, hexadecimal digits for a Binary. ``held`` are the inputs that nothing drives, with the
    values that they kept; None for one without a start value."""

    parameters: dict[str, Scalar]
    path: str
    mapping: dict[str, str]
    connectors: dict[str, BoundRecord | None]
    library: Literal["native", "source", "wine"] = "native"
    held: dict[str, Scalar | None] = {}


class PlantRecord(FmuRecord):
    """The plant, with the ``parameters`` that were changed and all its nominal ones, in SI units.

    ``build`` is "python" or "native", of the same equations, or "file"; ``model`` is the SHA-256 of these equations'
    sources, or of the file ``path``.
    """

    parameters: dict[str, Finite]
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
