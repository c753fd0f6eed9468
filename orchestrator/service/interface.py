"""What the form for a binding offers: the connectors, and an FMU's variables as far as they can be bound or set."""

from __future__ import annotations

from contextlib import suppress
from html import escape

from ..codec import Scalar
from ..errors import InputError
from ..fmi.connectors import CONTROLLER, Connector, bind
from ..fmi.variables import GIVEN, Variable, variables
from ..pairing.controller import Controller
from ..text import spelled
from .records import ConnectorRecord, Interface, VariableRecord

MOST = 500
"""Variables that a form offers; a page of 100,000 helps nobody. Inputs and outputs come first."""

MOST_TEXT = 30_000
"""Letters of all their names and units as a page has them, where an apostrophe has five: two thousand names of 74
letters made a page of 5.5 MB, and the service answers nobody for the second in which it makes one."""

MOST_NAMES = 5000
"""Letters of the names that a connector is bound to: two of 5 MB made a page of 100 MB."""

ORDER = ("input", "output", "parameter")


def interface_of(controller: Controller) -> Interface:
    """The interface of a ``controller``: what each connector is bound to now, as far as it is clear.

    Raises :class:`InputError` if its FMU cannot be opened.
    """
    by_name = variables(controller.archive.description)
    given: dict[str, Scalar] = {}
    mapping: dict[str, str] = {}
    with suppress(InputError):  # a mapping that does not fit is what the form is to mend
        given, mapping = dict(controller.setup.parameters), dict(controller.setup.mapping)
    listed = [variable for variable in by_name.values() if variable.causality in ORDER]
    listed.sort(key=lambda variable: ORDER.index(variable.causality))
    shown = [variable for variable in listed if variable.causality == "output" or variable.can_be_set]
    offered, letters = list[VariableRecord](), 0
    for record in map(_variable, shown[:MOST]):
        letters += len(escape(record.name + record.unit))
        if letters > MOST_TEXT:
            break
        offered.append(record)
    return Interface(
        connectors=tuple(_connector(controller, connector, mapping) for connector in CONTROLLER),
        variables=tuple(offered),
        left_out=len(shown) - len(offered),
        given=_of(given, {record.name for record in offered}),
    )


def _of(given: dict[str, Scalar], names: set[str]) -> dict[str, Scalar]:
    """The values of the variables ``names`` and of their elements: each look at a run reads them, and 30,000 of a
    binding took 0.6 s."""
    return {name: value for name, value in given.items() if name in names or name.rpartition("[")[0] in names}


def _connector(controller: Controller, connector: Connector, mapping: dict[str, str]) -> ConnectorRecord:
    """A connector alone: that another one is ambiguous does not hide what is known of this one."""
    bound: tuple[str, ...] = ()
    found = ""
    own = {name: mapping[name] for name in (connector.name, *connector.components()) if name in mapping}
    with suppress(InputError):
        binding = bind(controller.archive.description, (connector,), controller.file_name, own)
        if connector.name in binding:
            bound = tuple(variable.name for variable in binding[connector.name].variables)
            found = binding[connector.name].spelled
    if own and not bound:  # it does not fit, and is what was asked for
        bound, found = tuple(own.values()), "mapped"
    if sum(map(len, bound)) > MOST_NAMES:
        bound, found = (), ""
    return ConnectorRecord(
        connector.name, connector.unit, connector.meaning, connector.required, connector.causalities, bound, found
    )


def _variable(variable: Variable) -> VariableRecord:
    start = ", ".join(map(spelled, variable.start)) if variable.causality in GIVEN else ""
    return VariableRecord(
        variable.name, variable.causality, variable.type, variable.unit or "", variable.size, start[:500]
    )
