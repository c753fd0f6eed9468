"""The C header that tells the FMI glue whose binary it is, and what the model description declares."""

from __future__ import annotations

import hashlib
from xml.etree.ElementTree import Element

from controller_fmu.export.description import array_name, derivatives, variables
from controller_fmu.export.dialects import Dialect


def identity(name: str, guid: str, dialect: Dialect, scalars: Element, evaluates: bool) -> bytes:
    """Return the header ``identity.h``.

    Args:
        name: the model's identifier.
        guid: the one in the model description.
        dialect: which FMI it is built for.
        scalars: the description, FMI 2.0 with scalars, whose value references are the places in the model's struct.
        evaluates: whether the model has the function ``model_evaluate``.
    """
    references = [variable.attrib["valueReference"] for variable in variables(scalars)]
    states = [(references[state - 1], references[derivative - 1]) for state, derivative in derivatives(scalars)]
    direct = evaluates and any(output.get("dependencies") for output in scalars.iterfind("ModelStructure/Outputs/*"))
    interface = scalars.find("CoSimulation")
    free_steps = "" if interface is None else interface.get("canHandleVariableCommunicationStepSize", "")
    tag = hashlib.sha256(guid.encode()).hexdigest()[:16]
    lines = (
        f"#define MODEL_IDENTIFIER {name}",
        f'#define MODEL_GUID "{guid}"',
        f"#define MODEL_TAG UINT64_C(0x{tag})",
        f"#define MODEL_IS_MODEL_EXCHANGE {int(dialect.interface == 'ModelExchange')}",
        f"#define MODEL_FLOAT_BITS {dialect.float_bits}",
        f"#define MODEL_HAS_VARIABLE_STEPS {int(free_steps in ('true', '1'))}",
        f"#define MODEL_STATES {len(states)}",
        f"#define MODEL_EVALUATES {int(bool(states) or direct)}",
        f"#define MODEL_STATE_REFERENCES {', '.join(state for state, _ in states) or 0}",
        f"#define MODEL_DERIVATIVE_REFERENCES {', '.join(derivative for _, derivative in states) or 0}",
        f"#define MODEL_VARIABLES {', '.join(_declared(scalars, dialect, {state for state, _ in states}))}",
    )
    return "".join(f"{line}\n" for line in lines).encode()


def _declared(scalars: Element, dialect: Dialect, states: set[str]) -> list[str]:
    """The name, the number of elements, and when it may be set, of what is declared at each value reference from 0."""
    rows: dict[int, tuple[str, int, str]] = {}
    firsts: dict[str, int] = {}
    for variable in sorted(variables(scalars), key=lambda variable: int(variable.attrib["valueReference"])):
        reference = int(variable.attrib["valueReference"])
        name = array_name(variable) if dialect.arrays else variable.attrib["name"]
        first = firsts.setdefault(name, reference) if dialect.arrays else reference
        settable = _settable(variable, dialect, variable.attrib["valueReference"] in states)
        if first == reference:
            rows[reference] = (name, 1, settable)
        else:  # a later element of an array goes with the first one
            rows[first] = (name, rows[first][1] + 1, rows[first][2])
            rows[reference] = ("", 0, "NEVER")
    if dialect.version == 3:
        rows[len(rows)] = ("time", 1, "NEVER")
    return [f"{{{_literal(name)}, {extent}, {settable}}}" for _, (name, extent, settable) in sorted(rows.items())]


def _settable(variable: Element, dialect: Dialect, is_state: bool) -> str:
    """When a variable may be set, in the words of component.c."""
    causality, variability = variable.get("causality", "local"), variable.get("variability", "continuous")
    if variability == "constant":
        return "NEVER"
    if causality == "input":
        return "INPUT" if variability == "continuous" else "DISCRETE_INPUT"
    if causality == "parameter" and variability == "tunable":
        return "TUNABLE"
    initial = variable.get("initial", "exact" if causality == "parameter" else "calculated")
    start = {"exact": "AT_START", "approx": "AS_GUESS"}.get(initial, "NEVER")
    if dialect.interface == "ModelExchange" and is_state:
        return f"{start} | STATE" + (" | EVENT" if dialect.version == 3 else "")
    return start


def _literal(text: str) -> str:
    """``text`` as a string in C; a logger would read '%' as a format."""
    plain = "".join(
        chr(byte) if chr(byte).isalnum() and byte < 128 or byte in b" _.[](),-+*/" else f"\\{byte:03o}"
        for byte in text.replace("%", "").encode()
    )
    return f'"{plain}"'
