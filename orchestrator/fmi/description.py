"""Reading an FMU's model description, with the flaws of exporters that change no meaning put right.

One table has what an FMU may declare to be able to, or to need, in FMI 1.0, 2.0 and 3.0, and what the master makes of
it: one row for each attribute and element that the standards' schemas have for it. A row that is refused says by an
XPath which elements of a description ask for it: nothing that the master does not do is simulated as if it did. The
page ``docs/capabilities.md`` is made from this table.
"""

from __future__ import annotations

import gc
import io
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import fmpy
from fmpy.model_description import ModelDescription
from lxml import etree

from ..errors import InputError
from .entries import DESCRIPTION, DESCRIPTIONS, Damaged, files_of, unpacked

Standing = Literal["supported", "honoured", "harmless", "refused"]
"""What the master makes of it: it uses it; it keeps to what it asks for; it does without, as the standard allows; it
refuses the FMU."""

INTERFACES = {
    "1": ("Implementation/CoSimulation_StandAlone/Capabilities", "Implementation/CoSimulation_Tool/Capabilities"),
    "2": ("CoSimulation", "ModelExchange"),
    "3": ("CoSimulation", "ModelExchange"),
}
"""Elements of a description with flags, by major version of FMI; the first that is there is the one that is used."""

MAX_NAMED = 3
"""Largest number of variables that a refusal names."""


@dataclass(frozen=True)
class Capability:
    """A flag or a feature: its name in the standard, the major ``versions`` of FMI that have it ("23"), what the master
    makes of it, and how that shows.

    ``refused`` is the XPath of the elements, from the root of a description, that ask for what is refused.
    """

    name: str
    versions: str
    standing: Standing
    text: str
    refused: str = ""


FLAGS = (
    Capability("modelIdentifier", "123", "supported", "It names the library that is loaded."),
    Capability(
        "needsExecutionTool",
        "23",
        "honoured",
        "`check` names it. If the FMU cannot be instantiated, the message names the tool. Under Wine it is refused.",
    ),
    Capability(
        "canBeInstantiatedOnlyOncePerProcess", "123", "honoured", "Each simulation and each probe has its own process."
    ),
    Capability(
        "canHandleVariableCommunicationStepSize",
        "123",
        "honoured",
        "All steps of a controller are equal: one step is one sample. A plant in a file that does not declare it is "
        "refused, because events divide its steps.",
    ),
    Capability(
        "fixedInternalStepSize",
        "3",
        "honoured",
        "It is the sample time, unless another one is given, which must be a multiple of it: else the FMU is refused.",
    ),
    Capability(
        "canRunAsynchronuously",
        "12",
        "harmless",
        "The master waits for each step. A step that returns `fmi2Pending` ends the simulation with an error that "
        "names it.",
    ),
    Capability(
        "mightReturnEarlyFromDoStep",
        "3",
        "harmless",
        "The master does not allow an early return. A step that returns early all the same ends the simulation with an "
        "error that says so.",
    ),
    Capability("canReturnEarlyAfterIntermediateUpdate", "3", "harmless", "The master asks for no intermediate update."),
    Capability("providesIntermediateUpdate", "3", "harmless", "The master gives no callback, so there is none."),
    Capability(
        "recommendedIntermediateInputSmoothness", "3", "harmless", "Inputs are held over a step, like those of a drive."
    ),
    Capability(
        "hasEventMode",
        "3",
        "harmless",
        "The master does not use event mode, and says so: the FMU handles its events in its steps. One that waits for "
        "event mode all the same ends the case.",
    ),
    Capability("canHandleEvents", "1", "harmless", "The master sends no events."),
    Capability("canSignalEvents", "1", "harmless", "A step that ends before its time ends the simulation."),
    Capability("canRejectSteps", "1", "harmless", "The master repeats no steps."),
    Capability("canInterpolateInputs", "12", "harmless", "The master sets no derivatives of inputs."),
    Capability("maxOutputDerivativeOrder", "123", "harmless", "The master asks for no derivatives of outputs."),
    Capability(
        "canNotUseMemoryManagementFunctions",
        "12",
        "harmless",
        "The master offers these functions, and the FMU may do without.",
    ),
    Capability("canGetAndSetFMUstate", "2", "harmless", "The master does not save states."),
    Capability("canSerializeFMUstate", "2", "harmless", "The master does not save states."),
    Capability("canGetAndSetFMUState", "3", "harmless", "The master does not save states."),
    Capability("canSerializeFMUState", "3", "harmless", "The master does not save states."),
    Capability("providesDirectionalDerivative", "2", "harmless", "The master asks for none."),
    Capability("providesDirectionalDerivatives", "3", "harmless", "The master asks for none."),
    Capability("providesAdjointDerivatives", "3", "harmless", "The master asks for none."),
    Capability("providesPerElementDependencies", "3", "harmless", "The master asks for none."),
    Capability("providesEvaluateDiscreteStates", "3", "harmless", "The master does not evaluate states in advance."),
    Capability(
        "completedIntegratorStepNotNeeded",
        "2",
        "honoured",
        "In Model Exchange, completed steps are told unless it is true.",
    ),
    Capability(
        "needsCompletedIntegratorStep", "3", "honoured", "In Model Exchange, completed steps are told if it is true."
    ),
)
"""Attributes of the elements for co-simulation and Model Exchange."""

KINDS = (
    Capability(
        "ModelExchange",
        "1",
        "refused",
        "It is FMI 1.0 for Model Exchange.",
        "/fmiModelDescription[starts-with(@fmiVersion, '1') and not(Implementation)]",
    ),
    Capability(
        "ModelExchange",
        "23",
        "supported",
        "Each sample is an event; CVode integrates between events and finds state events.",
    ),
    Capability("CoSimulation", "23", "supported", "One communication step is one sample."),
    Capability("CoSimulation_StandAlone", "1", "supported", "One communication step is one sample."),
    Capability("CoSimulation_Tool", "1", "honoured", "It runs where its tool is installed and is started by the FMU."),
    Capability(
        "manualStart",
        "1",
        "refused",
        "Its tool must be started by hand, but each simulation has a new process.",
        "Implementation/CoSimulation_Tool/Model[@manualStart='true' or @manualStart='1']",
    ),
    Capability(
        "ScheduledExecution",
        "3",
        "refused",
        "It is for scheduled execution only.",
        "ScheduledExecution[not(../CoSimulation) and not(../ModelExchange)]",
    ),
)
"""Kinds of FMUs."""

VARIABLES = (
    Capability("Real", "12", "supported", "Connectors are of this type. Others are set once and held."),
    Capability("Float64", "3", "supported", "Connectors are of this type or Float32. Others are set once and held."),
    Capability("Float32", "3", "supported", "As Float64, with values rounded to single precision."),
    Capability("Integer", "12", "supported", "Inputs and parameters are set once and held."),
    *(
        Capability(f"{sign}Int{bits}", "3", "supported", "Inputs and parameters are set once and held.")
        for bits in (8, 16, 32, 64)
        for sign in ("", "U")
    ),
    Capability("Boolean", "123", "supported", "Inputs and parameters are set once and held."),
    Capability("Enumeration", "123", "supported", "The same, by the name of an item or by its number."),
    Capability("String", "123", "supported", "The same; under Wine they cannot be set."),
    Capability("Binary", "3", "supported", "The same, in hexadecimal digits; under Wine they cannot be set."),
    Capability(
        "Clock",
        "3",
        "refused",
        "It has the clock {names}, which the benchmark does not activate: the controller would not compute.",
        "ModelVariables/Clock",
    ),
    Capability(
        "structuralParameter", "3", "harmless", "It keeps its start value, also where it is the dimension of an array."
    ),
    Capability("clocks", "3", "refused", "A variable with a clock needs the clock.", "ModelVariables/*[@clocks]"),
    Capability(
        "canHandleMultipleSetPerTimeInstant",
        "23",
        "honoured",
        "Inputs are set once in each sample, and before that in initialization, with the same values.",
    ),
    Capability("intermediateUpdate", "3", "harmless", "The variable is read and set between steps only."),
)
"""Types of variables, and attributes of variables that ask something of a master."""

CAPABILITIES = (*FLAGS, *KINDS, *VARIABLES)


def refuse_unsupported(root: etree._Element, name: str) -> None:
    """Raise :class:`InputError` if the description of the FMU ``name`` asks for what is refused."""
    version = str(root.get("fmiVersion"))[:1]
    # What is not refused by name is simulated: a controller whose clock (FMI
    # 3.0) nobody ticks got a score as one that never computes.
    for row in CAPABILITIES:
        if row.standing != "refused" or version not in row.versions:
            continue
        elements = root.xpath(row.refused)
        assert isinstance(elements, list)
        if elements:
            named = [str(element.get("name")) for element in elements if isinstance(element, etree._Element)]
            more = f" and {len(named) - MAX_NAMED} more" if len(named) > MAX_NAMED else ""
            text = row.text.format(names=", ".join(named[:MAX_NAMED]) + more)
            message = f"{name} cannot be simulated. {text} Export it for co-simulation without this, as FMI 2.0 or 3.0."
            raise InputError(message, "unsupported-fmi", name, row.name)


def declared(root: etree._Element) -> Iterator[tuple[Capability, str]]:
    """The flags that a description sets for the kind that is used, with their values; those at their default do not
    count."""
    version = str(root.get("fmiVersion"))[:1]
    rows = {row.name: row for row in FLAGS if version in row.versions and row.name != "modelIdentifier"}
    # A file for both kinds is used for co-simulation; flags of the other kind say nothing about the run.
    element = next((one for path in INTERFACES.get(version, ()) if (one := root.find(path)) is not None), None)
    for key, value in () if element is None else element.attrib.items():
        if str(key) in rows and str(value) not in ("false", "0"):
            yield rows[str(key)], str(value)


COMBINATIONS: Mapping[str, tuple[str, ...]] = {
    "parameter": ("fixed", "tunable"),
    "calculatedParameter": ("fixed", "tunable"),
    "structuralParameter": ("fixed", "tunable"),
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "local": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "independent": ("continuous",),
}
"""The variabilities that FMI 2.0 and 3.0 allow, by causality."""

NEGATED = "negated alias"
"""The causality that is read of an FMI 1.0 variable with the opposite sign of another one."""

GIVEN = ("parameter", "structuralParameter", "input")
"""Causalities of variables whose initial value is given, not calculated."""


def read_description(file: Path) -> ModelDescription:
    """The model description of an FMU, or of the folder that one was extracted to.

    Raises :class:`InputError` if it is missing or cannot be understood. The schema is not enforced: many exporters'
    descriptions have harmless flaws. A check lists them.
    """
    documents = _documents(file)
    root = _root(file, documents)
    refuse_unsupported(root, file.name)
    # After the refusal: what is refused is told of the file as it is.
    _put_right(root)
    try:
        # FMPy would say: 'NoneType' object has no attribute 'startswith'.
        if root.get("fmiVersion") is None:
            raise ValueError("it has no fmiVersion")
        if root.find("ModelVariables") is None:
            raise ValueError("it has no ModelVariables")
        _check_sizes(root)
        changed = {**documents, DESCRIPTION: etree.tostring(root, encoding="utf-8")}
        with uncollected():  # of 100,000 variables all stay, and looking for garbage takes as long as reading them
            # Without the schema: attributes of vendors, VendorAnnotations in the wrong place (CATIA-Systems/FMPy#774)
            # and unknown causalities (modelon-community/fmi-library#128) change no meaning.
            return fmpy.read_model_description(_archive(changed), validate=False)
    except Exception as problem:  # FMPy raises what it likes for everything a description can get wrong
        message = f"The {DESCRIPTION} of {file.name} cannot be used: {problem or type(problem).__name__}. "
        message += "Check it with: python -m fmpy validate."
        raise InputError(message, "bad-description", file.name) from problem


def _check_sizes(root: etree._Element) -> None:
    """Raise :class:`ValueError` for an array whose size is that of a variable without a start value, or of none."""
    starts: dict[str | None, str | None] = {}
    for size in root.iterfind("ModelVariables/*/Dimension[@valueReference]"):
        # Only if there is such an array: the dictionary of 100,000 variables is not for nothing.
        if not starts:
            starts = {
                variable.get("valueReference"): variable.get("start") for variable in root.iterfind("ModelVariables/*")
            }
        reference, name = size.get("valueReference"), size.getparent().get("name")
        if reference not in starts:
            raise ValueError(f"the size of {name} is a variable that does not exist (value reference {reference})")
        if starts[reference] is None:
            raise ValueError(f"the size of {name} is a variable without a start value (value reference {reference})")


@contextmanager
def uncollected() -> Iterator[None]:
    """Within, no garbage is looked for."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def declared_capabilities(file: Path) -> list[tuple[Capability, str]]:
    """The flags that an FMU's description sets for the kind that is used, with their values."""
    return list(declared(_root(file, _documents(file))))


def illegal_combinations(description: ModelDescription) -> list[str]:
    """What each variable is, with its name, whose causality and variability the standard does not combine.

    FMI 1.0 has other words, and none are found there.
    """
    if str(description.fmiVersion).startswith("1"):
        return []
    return [
        f"{variable.name}: {variable.variability} {variable.causality}"
        for variable in description.modelVariables
        if variable.variability not in COMBINATIONS.get(variable.causality, ())
    ]


def _root(file: Path, documents: Mapping[str, bytes]) -> etree._Element:
    """The root of a description, without the namespace that some exporters give all elements."""
    if DESCRIPTION not in documents:
        message = f"{file.name} is not an FMU: the archive has no {DESCRIPTION}."
        raise InputError(message, "not-an-fmu", file.name)
    try:
        root = etree.fromstring(documents[DESCRIPTION])
    except etree.XMLSyntaxError as problem:
        message = f"The {DESCRIPTION} of {file.name} is not well-formed XML ({problem}). Export the FMU again."
        raise InputError(message, "bad-description", file.name) from None
    namespace = etree.QName(root).namespace
    if namespace is not None:
        for element in root.iter(f"{{{namespace}}}*"):
            element.tag = etree.QName(element).localname
        etree.cleanup_namespaces(root)
    return root


def _put_right(root: etree._Element) -> None:
    """Tell FMPy what it would look up for ``initial``."""
    version = str(root.get("fmiVersion"))
    if version.startswith("1"):
        # FMPy drops this word. The variable has the value of another one with the opposite sign: were it bound as it
        # stands, the loop would run with a wrong sign. With a causality of its own it cannot be bound.
        for variable in root.iterfind("ModelVariables/*[@alias='negatedAlias']"):
            variable.set("causality", NEGATED)
        return
    for variable in root.iterfind("ModelVariables/*"):
        causality = variable.get("causality", "local")
        legal = COMBINATIONS.get(causality, ())
        default = "continuous" if version.startswith("2") else "".join(legal[:1])  # FMI 3.0's is always a legal one
        # FMPy looks the default of `initial` up by causality and variability, and fails for pairs that the standard
        # does not combine, which exporters write all the same.
        if variable.get("initial") is None and variable.get("variability", default) not in legal:
            variable.set("initial", "exact" if causality in GIVEN else "calculated")


def _documents(file: Path) -> dict[str, bytes]:
    """The files of an FMU that are parsed, by name."""
    if file.is_dir():
        return {name: (file / name).read_bytes() for name in DESCRIPTIONS if (file / name).is_file()}
    try:
        with zipfile.ZipFile(file) as archive:
            return {name: unpacked(archive, entry) for name, entry in files_of(archive).items() if name in DESCRIPTIONS}
    except Damaged as problem:
        message = f"{file.name} cannot be read: {problem}. Export the FMU again."
        raise InputError(message, "cannot-extract", file.name) from problem


def _archive(documents: Mapping[str, bytes]) -> io.BytesIO:
    """An archive in memory, which is what FMPy reads both documents from."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, text in documents.items():
            archive.writestr(name, text)
    return buffer
