"""The connectors of plant and controller, and which of an FMU's variables they are bound to, however exporters spell
them."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from fmpy.model_description import ModelDescription

from ..codec import Scalar
from ..errors import InputError, unknown
from .description import NEGATED
from .variables import Variable, conversion, repeated_names, variables

ARRAY = -1
"""Index of a whole array."""


COLUMN = re.compile(r"[\[(](\d+)(?:, ?|\]\[|\)\()[01][\])]$")
"""Indices of an element in a matrix's only column, which is the first, counted from 1 or 0."""


@dataclass(frozen=True)
class Spelling:
    """``base`` is a name without case and punctuation ("qm"), ``index`` the component's digit, ARRAY for an array."""

    base: str
    index: int


def spelling(name: str, array: bool) -> Spelling | None:
    """A variable's name apart from its spelling; None if it cannot be a component.

    ``q_m[1]``, ``q_m_1``, ``q_m1``, ``qm1``, ``q_m.axis1`` and ``Controller.q_m[1]`` all become ("qm", 1), and so do
    the elements of a matrix of one column, ``q_m[1,1]``, ``q_m[1][1]`` and ``q_m(1,1)``. The name of an ``array`` has
    no index. Enclosing components ("Controller.") do not count.
    """
    parts = name.split(".")
    local = COLUMN.sub(r"[\1]", parts[-1])
    if len(parts) > 1 and re.fullmatch(r"(?:axis|joint)?_?\d", local.lower()):
        local = parts[-2] + "_" + local
    words = re.findall(r"[a-z]+|\d+", local.lower())
    if array:
        return Spelling("".join(words), ARRAY)
    if not words or not words[-1].isdigit():
        return None
    number = words.pop()
    if words and words[-1] in ("axis", "joint"):
        words.pop()
    base = "".join(words) + number[:-1]
    return Spelling(base, int(number[-1])) if base else None


def canonical(name: str) -> str:
    """The ``base`` of a connector's own name: ``q_m_ref`` is "qmref"."""
    return "".join(re.findall(r"[a-z]+|\d+", name.lower()))


@dataclass(frozen=True)
class Connector:
    """A pair of real variables, ``name[1]`` and ``name[2]``, with the unit the master uses for it."""

    name: str
    causalities: tuple[str, ...]
    unit: str
    required: bool = True
    meaning: str = ""

    def components(self) -> tuple[str, str]:
        """FMI names of the two components."""
        return f"{self.name}[1]", f"{self.name}[2]"


PLANT: tuple[Connector, ...] = (
    Connector("u_m", ("input",), "N.m"),
    Connector("u_d", ("input",), "N.m"),
    Connector("F", ("input",), "N"),
    Connector("q_m", ("output",), "rad"),
    Connector("q_a", ("output",), "rad"),
    Connector("X", ("output",), "m"),
    Connector("q_m_ref", ("calculatedParameter", "output"), "rad"),
    Connector("u_m0", ("calculatedParameter", "output"), "N.m"),
    Connector("q_a_start", ("parameter",), "rad"),
)

_SETTABLE = ("input", "parameter")

CONTROLLER: tuple[Connector, ...] = (
    Connector("q_m", ("input",), "rad", False, "measured motor angles"),
    Connector("u_m", ("output",), "N.m", True, "motor torques to command"),
    Connector("q_m_ref", _SETTABLE, "rad", False, "motor angles to hold"),
    Connector("e", ("input",), "rad", False, "position error q_m_ref - q_m, instead of the two"),
    Connector("u_m0", _SETTABLE, "N.m", False, "torques in the initial steady state"),
    Connector("q_a_ref", _SETTABLE, "rad", False, "link angles in the initial steady state"),
)

SAMPLE_TIME = "T_s"
"""Optional scalar parameter of a controller: its sample time [s]."""


@dataclass(frozen=True)
class Bound:
    """A connector found in an FMU: one array or two scalars, and the factors from the FMU's units to the connector's.

    ``spelled`` is how it was found: "exact", "by spelling", or "mapped". ``notes`` are meant for the user.
    """

    connector: Connector
    variables: tuple[Variable, ...]
    factors: tuple[float, float]
    spelled: str
    notes: tuple[str, ...] = ()

    @property
    def is_parameter(self) -> bool:
        """Whether it is set before initialization rather than during it."""
        return self.variables[0].causality == "parameter"

    def values(self, pair: Iterable[float]) -> dict[Variable, list[Scalar]]:
        """A pair in the connector's unit as values of the FMU's variables."""
        elements: list[Scalar] = [value / factor for value, factor in zip(pair, self.factors, strict=True)]
        if len(self.variables) == 1:
            return {self.variables[0]: elements}
        return {variable: [element] for variable, element in zip(self.variables, elements, strict=True)}


Binding = Mapping[str, Bound]
"""Bound connectors by name; optional ones may be absent."""


def bind(
    description: ModelDescription,
    connectors: tuple[Connector, ...],
    what: str,
    mapping: Mapping[str, str] | None = None,
) -> Binding:
    """Find the variables of all ``connectors`` in an FMU: as mapped, else by exact name, else by spelling.

    ``mapping`` gives the FMU's variable for a component ("q_m[1]") or, for an array, a connector ("q_m"); ``what``
    ("The controller x.fmu") begins messages. Raises :class:`InputError` if a required connector is missing, an optional
    one has only one of its components, two candidates spell the same, or a variable has another causality, type, size
    or kind of unit. What is mapped to one connector is not considered for others.
    """
    by_name = variables(description)
    mapping = _checked(mapping or {}, connectors, by_name, what)
    taken = frozenset(mapping.values())
    # A variable that is mapped as e must not be bound as q_m a second time only because it is spelled so.
    free = {name: variable for name, variable in by_name.items() if name not in taken} if taken else by_name
    binding: dict[str, Bound] = {}
    for connector in connectors:
        mapped = _mapped(connector, by_name, mapping, what)
        matched, spelled = (mapped, "mapped") if mapped else _find(connector, free, _spelled(description), what)
        if matched:
            binding[connector.name] = _bound(description, connector, matched, spelled, what)
        elif connector.required:
            raise _missing(connector, by_name, what)
    _check_distinct(description, binding, what)
    return binding


def bind_controller(description: ModelDescription, what: str, mapping: Mapping[str, str] | None = None) -> Binding:
    """:func:`bind` for a controller, which needs ``q_m``, or ``e`` in its place: one of the two is fed."""
    binding = bind(description, CONTROLLER, what, mapping)
    if "q_m" not in binding and "e" not in binding:
        raise _missing(CONTROLLER[0], variables(description), what)
    # Some controllers offer both. Fed twice, the position error would enter the law twice.
    if "e" in binding and "q_m" in binding:
        if "q_m_ref" not in binding:
            message = f"{what} has both inputs, q_m and e, but no q_m_ref. The benchmark feeds one of the two: "
            message += "give the controller q_m_ref and form the error inside, or leave q_m out."
            raise InputError(message, "connector-missing", what, "q_m_ref")
        return {name: bound for name, bound in binding.items() if name != "e"}
    return binding


def _checked(
    mapping: Mapping[str, str], connectors: tuple[Connector, ...], by_name: Mapping[str, Variable], what: str
) -> Mapping[str, str]:
    allowed = [name for connector in connectors for name in (connector.name, *connector.components())]
    for target, source in mapping.items():
        if target not in allowed:
            message = f"The mapping names {target}, which is not a connector."
            raise unknown(message, "no-connector", what, target, allowed)
        if source not in by_name:
            message = f"{what} has no variable {source}, to which {target} is mapped."
            raise unknown(message, "no-variable", what, source, by_name)
        other = next(name for name, variable in mapping.items() if variable == source)
        if other != target:
            message = f"The mapping has {source} for both {other} and {target}. Map each to a variable of its own."
            raise InputError(message, "bad-mapping", what, source)
    return mapping


def _mapped(
    connector: Connector, by_name: Mapping[str, Variable], mapping: Mapping[str, str], what: str
) -> list[Variable]:
    components = connector.components()
    if connector.name in mapping:
        return [by_name[mapping[connector.name]]]
    mapped = [by_name[mapping[name]] for name in components if name in mapping]
    if len(mapped) == 1:
        message = f"The mapping has only one of {components[0]} and {components[1]}. Give both."
        raise InputError(message, "bad-mapping", what, connector.name, components)
    return mapped


Spelled = Mapping[str, Sequence[tuple[int, Variable]]]
"""Variables that may be components, with their indices, by the base of their names."""


@functools.lru_cache(maxsize=16)
def _spelled(description: ModelDescription) -> Spelled:
    """The variables of an FMU by their spelling: it is bound for each simulation, and may have 100,000."""
    by_base: dict[str, list[tuple[int, Variable]]] = {}
    connectable = {NEGATED, *(causality for connector in (*PLANT, *CONTROLLER) for causality in connector.causalities)}
    for variable in variables(description).values():
        if variable.causality not in connectable:
            continue
        name = spelling(variable.name, variable.size > 1)
        if name is not None:
            by_base.setdefault(name.base, []).append((name.index, variable))
    return by_base


def _find(
    connector: Connector, by_name: Mapping[str, Variable], spelled: Spelled, what: str
) -> tuple[list[Variable], str]:
    whole = by_name.get(connector.name)
    arrays = [whole] if whole is not None and whole.size > 1 else []
    every = [f"{connector.name}[{index}]" for index in range(10)]
    scalars = [by_name[name] for name in every if name in by_name]
    for pair in (every[1:3], every[0:2]):  # exporters with zero-based arrays write q_m[0], q_m[1]
        if all(name in by_name for name in pair):
            if arrays:
                raise _ambiguous(connector, arrays, scalars, what)
            return scalars, "exact"
    return (arrays, "exact") if arrays else (_by_spelling(connector, by_name, spelled, what), "by spelling")


def _by_spelling(connector: Connector, by_name: Mapping[str, Variable], spelled: Spelled, what: str) -> list[Variable]:
    candidates: dict[int, list[Variable]] = {}
    for index, variable in spelled.get(canonical(connector.name), ()):
        if variable.name in by_name and variable.causality in (*connector.causalities, NEGATED):
            candidates.setdefault(index, []).append(variable)
    arrays = candidates.pop(ARRAY, [])
    scalars = [variable for _, alike in sorted(candidates.items()) for variable in alike]
    # To take either would be a guess: "Motor1.q_m" and "Filter.q_m[1]" spell
    # alike, and the wrong one closes another loop.
    if len(arrays) + max(map(len, candidates.values()), default=0) > 1:
        raise _ambiguous(connector, arrays, scalars, what)
    if arrays:
        return arrays
    # Exporters with zero-based arrays have 0 and 1. Of 0, 1 and 2 all go on, and the check of the size refuses them.
    if set(candidates) >= {1, 2} or set(candidates) == {0, 1}:
        return scalars
    if set(candidates) in ({0}, {1}, {2}) and not connector.required:
        message = f"{what} has {scalars[0].name}, but not the other component of {connector.name}."
        raise InputError(message, "connector-half", what, connector.name, [scalars[0].name])
    return []


def _ambiguous(connector: Connector, arrays: list[Variable], scalars: list[Variable], what: str) -> InputError:
    candidates = [variable.name for variable in (*arrays, *scalars)]
    message = f"{what} has more than one candidate for {connector.name}: {', '.join(candidates)}."
    value = connector.name if arrays else connector.components()[0]
    return InputError(message, "connector-ambiguous", what, value, candidates)


def _bound(
    description: ModelDescription, connector: Connector, matched: list[Variable], spelled: str, what: str
) -> Bound:
    causalities = " or ".join(connector.causalities)
    for variable in matched:
        if not variable.is_real or variable.causality not in connector.causalities:
            message = f"{what}: {variable.name} is declared as {variable.type}, {variable.causality}, but "
            message += f"{connector.name} must be a real {causalities} [{connector.unit}]. "
            message += "Change its declaration and export the FMU again."
            raise InputError(message, "connector-type", what, variable.name)
    size = sum(variable.size for variable in matched)
    if size != 2:
        names = ", ".join(variable.name for variable in matched)
        message = f"{what}: {names} has {size} elements, but {connector.name} needs 2, one per axis."
        raise InputError(f"{message} Change its dimension and export the FMU again.", "connector-size", what, names)
    # One call sets both components, and each FMI 3.0 function is for one type.
    if len({variable.type for variable in matched}) > 1:
        message = f"{what}: {matched[0].name} and {matched[1].name} differ in type. Give both the same."
        raise InputError(message, "connector-type", what, matched[0].name)
    units = [
        conversion(description, variable.unit, connector.unit, f"{what}: {variable.name}")
        for variable in matched
        for _ in range(variable.size)
    ]
    notes = tuple(dict.fromkeys(unit.note for unit in units if unit.note))
    return Bound(connector, tuple(matched), (units[0].factor, units[1].factor), spelled, notes)


def _check_distinct(description: ModelDescription, binding: Binding, what: str) -> None:
    """Raise :class:`InputError` if a name or, of variables that are set, a value reference stands for two variables.

    The standards forbid both. Either would be a silent mistake: the wrong one of two variables, or a measurement that
    overwrites its reference.
    """
    bound = [variable for one in binding.values() for variable in one.variables]
    for variable in bound:
        # Kvixen/Simulix#28: two inputs of one name. The dictionary of variables keeps
        # the last, so the loop would feed one of them and say nothing.
        if variable.name in repeated_names(description):
            message = (
                f"{what} has more than one variable {variable.name}. Rename all but one, and export the FMU again."
            )
            raise InputError(message, "connector-ambiguous", what, variable.name, (variable.name,))
    owners: dict[int, str] = {}
    for variable in bound:
        # CATIA-Systems/FMPy#266: of two inputs with one reference, the second call overwrites the first. FMI 2.0
        # (2.2.7) allows aliases, but not of two that are set.
        if variable.causality in _SETTABLE and owners.setdefault(variable.reference, variable.name) != variable.name:
            first = owners[variable.reference]
            message = f"{what}: {first} and {variable.name} have the same value reference, {variable.reference}, "
            message += "so they cannot have values of their own. Export the FMU again."
            raise InputError(message, "bad-description", what, variable.name)


def _missing(connector: Connector, by_name: Mapping[str, Variable], what: str) -> InputError:
    first, second = connector.components()
    candidates = [name for name, v in by_name.items() if v.causality in connector.causalities]
    causalities = " or ".join(connector.causalities)
    message = f"{what} has no {causalities} {first}, {second} [{connector.unit}] ({connector.meaning})."
    error = unknown(message, "connector-missing", what, first, candidates)
    error.value = connector.name
    return error
