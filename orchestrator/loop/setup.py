"""How a controller is used: its parameters, and which of its variables the connectors are bound to."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from ..codec import Scalar
from ..errors import InputError
from ..fmi.archive import Archive
from ..fmi.connectors import SAMPLE_TIME, Binding, Bound, bind_controller, canonical
from ..fmi.lookup import find_values
from ..fmi.variables import Variable, conversion, variables

STEP = 0.25e-3
"""Sample time [s] of the paper's controllers, which those have that declare no step."""


@dataclass(frozen=True)
class Setup:
    """How a controller is used: ``parameters`` by name (in the FMU's units), among them constants for inputs that
    nothing drives; ``mapping`` from connectors to its variables."""

    parameters: Mapping[str, Scalar] = field(default_factory=dict)
    mapping: Mapping[str, str] = field(default_factory=dict)


def controller_binding(controller: Archive, setup: Setup) -> Binding:
    """The controller's connectors.

    Raises :class:`~orchestrator.errors.InputError` if they do not fit, or ``setup`` gives a value to one of them.
    """
    binding = bind_controller(controller.description, f"The controller {controller.name}", setup.mapping)
    connected = {variable.name: name for name, bound in binding.items() for variable in bound.variables}
    for name in setup.parameters:
        # A start value for q_m would be overwritten in initialization: who gives one expects something else.
        connector = connected.get(name) or connected.get(name.partition("[")[0])
        if connector is not None:
            message = f"The controller {controller.name}: {name} is the connector {connector}, which the benchmark "
            message += "gives its value in every case."
            raise InputError(message, "connector-parameter", controller.name, name)
    return binding


def held_inputs(controller: Archive, setup: Setup, binding: Binding) -> dict[str, Scalar | None]:
    """The controller's inputs that nothing drives, those of arrays by element, with the values that they keep for the
    whole simulation: as ``setup`` gives them, else their start values, None for one without."""
    driven = {variable for bound in binding.values() for variable in bound.variables}
    held: dict[str, Scalar | None] = {}
    for variable in variables(controller.description).values():
        if variable.causality == "input" and variable not in driven:
            starts: Sequence[Scalar | None] = variable.start or (None,) * variable.size
            names = (
                [variable.name] if variable.size == 1 else [f"{variable.name}[{i + 1}]" for i in range(variable.size)]
            )
            held.update((name, setup.parameters.get(name, start)) for name, start in zip(names, starts, strict=True))
    return held


def effective(controller: Archive, setup: Setup) -> Setup:
    """``setup`` in a form that all its spellings share: what differs from the FMU as it is, sorted.

    A parameter that has its start value already is not among ``parameters``, which name single elements of arrays; the
    ``mapping`` is empty where the connectors are found without it, and names all of them otherwise. The FMU is then
    told the same in the same order, however it was spelled. Raises what :func:`controller_binding` and
    :func:`~orchestrator.fmi.lookup.find_values` raise.
    """
    what = f"The controller {controller.name}"
    binding = controller_binding(controller, setup)
    given = find_values(controller.description, setup.parameters, what)
    parameters = {
        name: value
        for variable, values in given.items()
        # One that is given is taken from the benchmark, which would give it another value.
        if repr(tuple(values)) != repr(variable.start) or _is_sample_time(variable)
        for name, value in zip(_elements(variable), values, strict=True)
    }
    with suppress(InputError):  # without the mapping, a connector may be missing or ambiguous
        if _variables(controller_binding(controller, Setup())) == _variables(binding):
            return Setup(dict(sorted(parameters.items())))
    mapping = {
        target: variable.name
        for connector, bound in binding.items()
        for target, variable in zip(_targets(connector, bound), bound.variables, strict=True)
    }
    return Setup(dict(sorted(parameters.items())), dict(sorted(mapping.items())))


def _elements(variable: Variable) -> tuple[str, ...]:
    """The names that set the elements of a parameter."""
    if variable.size == 1:
        return (variable.name,)
    return tuple(f"{variable.name}[{number}]" for number in range(1, variable.size + 1))


def _targets(connector: str, bound: Bound) -> tuple[str, ...]:
    """What a mapping calls the parts of a connector: itself if it is an array."""
    return (connector,) if len(bound.variables) == 1 else bound.connector.components()


def _variables(binding: Binding) -> dict[str, tuple[Variable, ...]]:
    return {connector: bound.variables for connector, bound in binding.items()}


def _is_sample_time(variable: Variable) -> bool:
    return canonical(variable.name.split(".")[-1]) == canonical(SAMPLE_TIME)


def sample_time_parameter(controller: Archive, setup: Setup) -> Variable | None:
    """The controller's parameter T_s, if it has one that ``setup`` leaves to the benchmark.

    The exact name takes precedence over others that spell the same, as with connectors. Raises
    :class:`~orchestrator.errors.InputError` if there are several of these, or if the only one has another start value
    than the controller's step: it may be the time constant of a filter, or count milliseconds.
    """
    declared = variables(controller.description).values()
    parameters = [v for v in declared if v.causality == "parameter" and v.is_real and v.size == 1]
    alike = [v for v in parameters if _is_sample_time(v)]
    candidates = [v for v in alike if v.name == SAMPLE_TIME] or alike
    if any(v.name in setup.parameters for v in candidates):
        return None
    if len(candidates) > 1:
        names = ", ".join(v.name for v in candidates)
        message = f"The controller {controller.name} has more than one candidate for its sample time {SAMPLE_TIME}: "
        raise InputError(
            f"{message}{names}.", "ambiguous-sample-time", controller.name, SAMPLE_TIME, (v.name for v in candidates)
        )
    if not candidates:
        return None
    (T_s,) = candidates
    # One that only spells like T_s (of a filter, or in milliseconds) was once
    # overwritten: V 11930 and 118.9, where the law's score is 122.2.
    if T_s.name != SAMPLE_TIME and T_s.start and not _is_step(controller, T_s):
        value = f"{T_s.numbers[0]:g} {T_s.unit or ''}".rstrip()
        message = f"The controller {controller.name} has a parameter {T_s.name} = {value}: by its name it is the "
        message += "sample time, by its value it is not."
        raise InputError(message, "ambiguous-sample-time", controller.name, SAMPLE_TIME, (T_s.name,))
    return T_s


def _is_step(controller: Archive, variable: Variable) -> bool:
    """Whether a parameter starts with the step that the FMU declares, the benchmark's if it declares none."""
    experiment, step = controller.description.defaultExperiment, STEP
    with suppress(AttributeError, ValueError, TypeError):  # what is no number, another check tells
        step = float(experiment.stepSize)
    unit = conversion(controller.description, variable.unit, "s", f"{controller.name}: {variable.name}")
    return math.isclose(variable.numbers[0] * unit.factor, step, rel_tol=1e-5)
