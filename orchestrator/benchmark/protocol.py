"""A protocol is a file: which configurations, systems and tests make an evaluation, and how they are judged."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from fnmatch import fnmatchcase
from fractions import Fraction
from importlib import resources
from pathlib import Path
from typing import Annotated, Any
from typing import Protocol as Interface

import msgspec
from msgspec import inspect, structs

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..bounded import read_toml
from ..codec import Finite, Malformed, Natural, NonNegative, Positive, Struct, convert, to_json
from ..errors import InputError
from .case import CRITERIA, REQUIREMENTS, Again, Disturbance, Test


def allowed(problem: str, kind: type) -> str:
    """The names or values that a ``kind`` allows at the place that ``problem``, a message of msgspec, tells; empty if
    they are not a list."""
    # msgspec names what is wrong, but not what would be right.
    place = re.search(r" - at `\$(.*)`$", problem)
    place_type = _at(inspect.type_info(kind), place[1] if place else "")
    if isinstance(place_type, inspect.StructType) and "unknown field" in problem:
        return ", ".join(field.name for field in place_type.fields)
    if isinstance(place_type, inspect.LiteralType):
        return ", ".join(map(str, place_type.values))
    return ""


def _at(kind: inspect.Type, path: str) -> inspect.Type | None:
    """The type at a ``path`` such as ``.tests[0].sweep`` below ``kind``; None if there is none."""
    inner: inspect.Type | None = kind
    for name, _ in re.findall(r"\.(\w+)|(\[[^]]*\])", path):
        if isinstance(inner, inspect.StructType) and name:
            inner = next((field.type for field in inner.fields if field.name == name), None)
        elif isinstance(inner, inspect.DictType):
            inner = inner.value_type
        elif isinstance(inner, inspect.VarTupleType):
            inner = inner.item_type
        else:
            return None
    return inner


FILES = resources.files(__package__) / "protocols"

UNCERTAIN = tuple(dict.fromkeys(name.partition("[")[0] for name in NOMINAL if "[" in name))
"""Symbols of the plant's parameters that each axis has its own value of."""

Range = tuple[Finite, Finite]
Bits = Annotated[int, msgspec.Meta(ge=0, le=52)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Sign = Annotated[int, msgspec.Meta(ge=-1, le=1)]


class Workspace(Struct):
    """Ranges of the link angles [degrees]."""

    q_a1_deg: Range
    q_a2_deg: Range


class Grid(Struct):
    """Number of equidistant angles per axis, the ends of the workspace included; ``also_deg`` lists further poses
    (q_a1, q_a2) [degrees]."""

    q_a1_points: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    q_a2_points: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    also_deg: tuple[Range, ...] = ()

    @property
    def size(self) -> int:
        """Number of poses."""
        return self.q_a1_points * self.q_a2_points + len(self.also_deg)


class Imperfections(Struct):
    """What stands between controller and plant, SI units; angle_range_deg in degrees."""

    sample_time: Fraction
    delay: Fraction
    noise_power: NonNegative
    angle_range_deg: Positive
    angle_bits: Bits
    torque_limit: tuple[Positive, Positive]
    torque_bits: Bits
    abort_distance: Positive


class Disturbances(Struct):
    """Force and chirp, with the ranges of what is drawn; SI units."""

    force: Finite
    t_1: Finite
    t_2: Finite
    chirp_amplitude: Range
    t_3_range: Range
    t_4: Finite
    chirp_frequencies: Range

    @property
    def chirp_starts(self) -> tuple[float, float]:
        """The range of t_3 [s] as far as the chirp begins before its end t_4, which a protocol of its own may have made
        earlier: a search ended with an error when it drew a later one."""
        low, high = self.t_3_range
        return min(low, self.t_4), min(high, self.t_4)


class Jitter(Struct):
    """By how much a draw may move what is listed: poses on both axes [degrees], mirrored at the workspace's ends; the
    parameters of systems inwards, as a share of their half-widths; the direction of the force [degrees]; and its begin
    and end together [s]. With ``tests``, the tests of a system differ in noise and disturbance: no test reveals
    the draws of another."""

    pose_deg: NonNegative = 0.0
    system: Share = 0.0
    direction_deg: NonNegative = 0.0
    force_time: NonNegative = 0.0
    tests: bool = False


class Selection(Struct):
    """What a protocol takes of the one it extends: patterns of the names of tests, and poses for all of these; nothing
    means all."""

    tests: tuple[str, ...] = ()
    poses: tuple[Natural, ...] = ()

    def of(self, test: Test) -> Test | None:
        """The test with these poses, or None if it is not taken."""
        taken = not self.tests or any(fnmatchcase(test.name, pattern) for pattern in self.tests)
        return (structs.replace(test, poses=self.poses) if self.poses else test) if taken else None


class Stability(Struct):
    """When a simulation counts as stable: limits [m] of the limit cycle and of the TCP error, each over the last
    seconds.

    Looked at are the last ``limit_cycle_windows`` windows, as many as fit. A motion that has fallen, from each to the
    next, below the share ``ring_down`` is no limit cycle. A motion of ``doubtful`` [m] and more that has not fallen
    below the share ``dying`` from each window to the next leaves a doubt, unless it is a limit cycle for sure (see
    :mod:`.doubt`): then the case is simulated until ``longest`` [s], if that is later than its end. The controller has
    recovered from the force when the TCP error stays below ``recovery_error`` [m].
    """

    limit_cycle: Positive
    limit_cycle_window: Positive
    ring_down: Positive
    recovery_error: Positive
    rest_error: Positive
    rest_window: Positive
    limit_cycle_windows: Annotated[int, msgspec.Meta(ge=2, le=100)] = 2
    doubtful: NonNegative = 0.0
    dying: NonNegative = 0.0
    longest: NonNegative = 0.0


class Settling(Struct):
    """B6: the loop has settled when the TCP error stays below ``error`` [m]."""

    error: Positive


class JudgingTables(Interface):
    """The tables of a protocol that the judgement of a simulation depends on. What judges is given no more than these,
    and the key of a stored case has all of them."""

    @property
    def settling(self) -> Settling:
        """By which B6 is measured."""

    @property
    def stability(self) -> Stability:
        """By which verdicts are given."""


class Criterion(Struct):
    """A target of Section 6: B_i with its weight in eq. (14)."""

    target: Positive
    weight: NonNegative
    unit: str
    title: str


class Protocol(Struct):
    """The contents of a protocol file.

    ``sets`` name lists of systems for the tests; ``uncertainty`` holds the half-widths of Table 1 relative to the
    nominal value, and ``systems`` the signs that put parameters at the ends of their ranges. ``reference`` is Table 2.
    """

    benchmark: str
    name: str
    description: str
    workspace: Workspace
    grid: Grid
    loop: Imperfections
    disturbance: Disturbances
    fixed_disturbance: Disturbance
    uncertainty: dict[str, NonNegative]
    systems: dict[str, dict[str, Sign]]
    sets: dict[str, tuple[str, ...]]
    stability: Stability
    settling: Settling
    tests: tuple[Test, ...]
    criteria: dict[str, Criterion]
    reference: dict[str, Finite]
    extends: str = ""
    jitter: Jitter = Jitter()
    selection: Selection = Selection()

    @property
    def sample_time(self) -> Fraction:
        """T_s [s]."""
        return self.loop.sample_time

    @property
    def case_count(self) -> int:
        """Number of cases of the whole protocol."""
        return sum(map(self.count, self.tests))

    def count(self, test: Test) -> int:
        """Number of cases of ``test``."""
        return (len(test.poses) or self.grid.size) * len(self.sets[test.systems])

    def test(self, name: str) -> Test:
        """The test called ``name``; raises :class:`InputError` with the names there are."""
        for test in self.tests:
            if test.name == name:
                return test
        names = [test.name for test in self.tests]
        message = f"The protocol {self.name} has no test {name}. It has: {', '.join(names)}."
        raise InputError(message, "no-test", self.name, name, names)


def names() -> tuple[str, ...]:
    """The protocols that come with the benchmark."""
    return tuple(sorted(file.name[: -len(".toml")] for file in FILES.iterdir() if file.name.endswith(".toml")))


def load(name: str | Path) -> Protocol:
    """The protocol called ``name``, or that of a file ``*.toml`` of the same form.

    Raises :class:`InputError` if there is none, or the file does not describe a protocol.
    """
    raw = _read(str(name))
    try:
        whole = convert(raw, Protocol)
        tests = tuple(test for test in map(whole.selection.of, whole.tests) if test is not None)
        protocol = structs.replace(whole, tests=tests)
        if not tests:
            raise Malformed("there are no tests")
        _check_criteria(protocol)
        _check_names("uncertainty", protocol.uncertainty, UNCERTAIN)
        for system, signs in protocol.systems.items():
            _check_names(f"the system {system}", signs, protocol.uncertainty)
        for test in protocol.tests:
            _check(protocol, test)
    except Malformed as problem:
        text = f"{name} does not describe a protocol: {problem}."
        if listed := allowed(str(problem), Protocol):
            text += f" Allowed: {listed}."
        raise InputError(text, "bad-protocol", name) from None
    except KeyError as problem:
        sets = ", ".join(whole.sets)
        text = f"{name} has no set of systems {problem}. It has: {sets}."
        raise InputError(text, "bad-protocol", name, problem.args[0], whole.sets) from None
    return protocol


def contents(name: str | Path) -> str:
    """What the results of the protocol called ``name`` depend on, in one line of JSON: all but its description. Raises
    as :func:`load` does."""
    return to_json(structs.replace(load(name), description=""), indent=None)


def _check_criteria(protocol: Protocol) -> None:
    """Raise what is wrong with the names of criteria and requirements."""
    named = (
        ("criteria", protocol.criteria),
        *((f"the criteria of {test.name}", test.criteria) for test in protocol.tests),
    )
    for where, names in named:
        _check_names(where, names, CRITERIA)
    for name, spec in protocol.criteria.items():
        if spec.unit != CRITERIA[name]:
            raise Malformed(f"criteria: the unit of {name} is {CRITERIA[name]}, not {spec.unit}")
    for test in protocol.tests:
        _check_names(f"the requirements of {test.name}", test.requirements, REQUIREMENTS)
    # Every report has the column of the paper.
    if absent := [name for name in (*protocol.criteria, "V") if name not in protocol.reference]:
        raise Malformed(f"reference has no value of {absent[0]}")


def _check_names(where: str, names: Iterable[str], legal: Collection[str]) -> None:
    if wrong := [name for name in names if name not in legal]:
        raise Malformed(f"{where}: there is no {wrong[0]}, only {', '.join(legal)}")


def _check(protocol: Protocol, test: Test) -> None:
    """Raise what is wrong with a test beside the other parts of its protocol."""
    protocol.sets[test.systems]
    least = 2.0 * protocol.stability.limit_cycle_window
    if test.poses and max(test.poses) >= protocol.grid.size:
        raise Malformed(f"the test {test.name} has a pose {max(test.poses)}; there are {protocol.grid.size}")
    if test.repeats and test.repeats not in {other.name for other in protocol.tests}:
        raise Malformed(f"the test {test.name} repeats {test.repeats}, which is no test")
    if test.again is not None:
        _check_again(protocol, test, test.again)
    # A verdict compares a window with the one before, so there must be two.
    if test.requirements and test.duration < least:
        raise Malformed(
            f"the test {test.name} of {test.requirements[0]} takes {float(test.duration):g} s, not {least:g}"
        )


def _check_again(protocol: Protocol, test: Test, again: Again) -> None:
    """Raise what is wrong with the times of disturbances that come again, whatever is drawn of them."""
    rules, late = protocol.disturbance, protocol.jitter.force_time
    begin, end = min(*rules.t_3_range, protocol.fixed_disturbance.t_3), rules.t_2 + late
    if not test.disturbed:
        raise Malformed(f"the test {test.name} has no disturbance that could come again")
    # What a force does is measured until the next disturbance begins.
    if not max(*rules.t_3_range, protocol.fixed_disturbance.t_3) <= rules.t_4 <= rules.t_1 - late:
        raise Malformed(f"the disturbance of the test {test.name} comes again, and its chirp is not before its force")
    if not end - begin <= again.period:
        raise Malformed(
            f"the disturbance of the test {test.name} takes {end - begin:g} s and comes again after {again.period:g} s"
        )
    if not end + (again.number - 1) * again.period < test.duration:
        raise Malformed(f"the test {test.name} ends before its {again.number} forces do")


def _read(name: str, above: tuple[str, ...] = ()) -> dict[str, Any]:
    """The tables of a protocol file, with those of the file it extends below them; those ``above`` extend this one."""
    if not name.endswith(".toml") and name not in names():
        raise InputError(
            f"There is no protocol {name}. Choose one of: {', '.join(names())}.", "no-protocol", "", name, names()
        )
    file = Path(name if name.endswith(".toml") else str(FILES / f"{name}.toml"))
    raw = read_toml(file, "bad-protocol")
    base = raw.get("extends")
    if not isinstance(base, str) or base == name:
        return raw
    # Found by name on the way up: files that extend each other would be read for ever.
    if base in above:
        raise InputError(f"{file} extends {base}, which extends it.", "bad-protocol", file, base)
    return _merged(_read(base, (*above, name)), raw)


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes`` on top, tables merged key by key."""
    merged = dict(base)
    for key, value in changes.items():
        both_tables = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if both_tables else value
    return merged
