"""Public bug reports of importers and exporters, the property that each is about, and an FMU that has it.

Titles are those of the reports. An FMU that is neither refused nor warned of has the score of its law, the paper's PID.
What ``test_import_corpus.py`` and ``test_archive.py`` try is not repeated here.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import fmpy
from exporters.description_edits import DESCRIPTION, Edit, declare, each, unit

from .specimens import GAINS, NAME, SUFFIX, Change, Contents, OfTheProject, Specimen, needing, other_library


@dataclass(frozen=True)
class Report:
    """A bug report and what was made of it."""

    where: str
    """Repository and number, as GitHub writes it: ``owner/name#1``; a pull request has ``owner/name!1``."""
    title: str
    has: str
    """The FMU's property, in a sentence without a subject."""
    specimen: Specimen | OfTheProject
    refused: str = ""
    """What the sentence says with which the FMU is refused, or a case of it ends."""
    warned: str = ""
    """What a check warns of, where the FMU has another law than the PID because of its property."""
    before: Specimen | None = None
    """What is evaluated before it."""
    cache: str = ""
    """Name of the folder that FMUs are extracted to."""

    @property
    def link(self) -> str:
        """The report's address."""
        repository, kind, number = re.fullmatch(r"(.+)([#!])(\d+)", self.where).groups()  # type: ignore[union-attr]
        return f"https://github.com/{repository}/{'issues' if kind == '#' else 'pull'}/{number}"


# ---- Changes of files ----

PLATFORM = fmpy.platform
BINARY = f"binaries/{PLATFORM}/{NAME}{SUFFIX}"


def adding(name: str, data: bytes) -> Change:
    """With one more file."""
    return lambda contents: {**contents, name: data}


def moved(old: str, new: str) -> Change:
    """With another name of a file."""
    return lambda contents: {new if name == old else name: data for name, data in contents.items()}


def binary(data: Callable[[], bytes]) -> Change:
    """With another library, which is made when it is needed."""
    return lambda contents: {**contents, BINARY: data()}


def written(old: bytes, new: bytes) -> Change:
    """With other bytes in the description."""

    def change(contents: Contents) -> Contents:
        assert old in contents[DESCRIPTION], old
        return {**contents, DESCRIPTION: contents[DESCRIPTION].replace(old, new)}

    return change


# ---- Changes of descriptions ----


def variable(name: str, tag: str = "Real", causality: str = "local", start: str = "", **attributes: str) -> Edit:
    """With one more variable of FMI 2.0."""

    def edit(root: Element) -> None:
        variables = root.find("ModelVariables")
        assert variables is not None
        references = [int(other.attrib["valueReference"]) for other in variables]
        given = {"name": name, "valueReference": str(max(references) + 1), "causality": causality}
        scalar = SubElement(variables, "ScalarVariable", given | attributes)
        SubElement(scalar, tag, {"start": start} if start else {})

    return edit


def variable_3(name: str, tag: str, **attributes: str) -> Edit:
    """With one more variable of FMI 3.0."""

    def edit(root: Element) -> None:
        variables = root.find("ModelVariables")
        assert variables is not None
        SubElement(variables, tag, {"name": name, "valueReference": "100", "causality": "local"} | attributes)

    return edit


def attribute(path: str, **values: str) -> Edit:
    """With attributes of an element; ``.`` is the root."""

    def edit(root: Element) -> None:
        element = root.find(path)
        assert element is not None, path
        element.attrib.update(values)

    return edit


def references(change: Callable[[int], int]) -> Edit:
    """With other value references."""
    return each(lambda v: v.set("valueReference", str(change(int(v.attrib["valueReference"])))))


def with_model_exchange(root: Element) -> None:
    root.insert(0, Element("ModelExchange", modelIdentifier="Specimen_ModelExchange"))


def with_a_display_unit(root: Element) -> None:
    """An angle shown in degrees, once with a definition and once without one."""
    for definition in root.iterfind("UnitDefinitions/Unit[@name='rad']"):
        SubElement(definition, "DisplayUnit", name="deg", factor="57.29577951308232", offset="10")
    for number, scalar in enumerate(root.iterfind("ModelVariables/ScalarVariable")):
        real = scalar[0]
        if real.get("unit") == "rad":
            real.set("displayUnit", "deg" if number % 2 else "undefined")


def with_an_inverse_display_unit(root: Element) -> None:
    definitions = Element("UnitDefinitions")
    radian = SubElement(definitions, "Unit", name="rad")
    SubElement(radian, "BaseUnit", rad="1")
    SubElement(radian, "DisplayUnit", name="per radian", factor="1", inverse="true")
    root.insert(1, definitions)
    for scalar in root.iterfind("ModelVariables/Float64"):
        if scalar.attrib["name"].startswith("q_m"):
            scalar.attrib.update(unit="rad", displayUnit="per radian")


def with_a_mode(root: Element) -> None:
    """A type of FMI 3.0 with two items."""
    types = Element("TypeDefinitions")
    mode = SubElement(types, "EnumerationType", name="Mode")
    for number in (1, 2):
        SubElement(mode, "Item", name=f"mode {number}", value=str(number))
    root.insert(1, types)


def with_annotations_in_the_wrong_place(root: Element) -> None:
    annotations = Element("VendorAnnotations")
    SubElement(annotations, "Tool", name="a tool")
    root.insert(0, annotations)


def sharing_a_reference(root: Element) -> None:
    """The reference and the measurement of axis 1 are the same variable."""
    scalars = {scalar.attrib["name"]: scalar for scalar in root.iterfind("ModelVariables/ScalarVariable")}
    scalars["q_m[1]"].set("valueReference", scalars["q_m_ref[1]"].attrib["valueReference"])


def aliased(root: Element) -> None:
    """Each variable has another name, as that of a local variable."""
    variables = root.find("ModelVariables")
    assert variables is not None
    for scalar in list(variables):
        given = {"name": f"motor.{scalar.attrib['name']}", "valueReference": scalar.attrib["valueReference"]}
        SubElement(SubElement(variables, "ScalarVariable", given, causality="local"), "Real")


def measured_under_an_alias(root: Element) -> None:
    """``q_m[1]`` is the other name of a variable."""
    for scalar in root.iterfind("ModelVariables/Float64"):
        if scalar.attrib["name"] == "q_m[1]":
            scalar.set("name", "motor.phi")
            SubElement(scalar, "Alias", name="q_m[1]")


def twice(name: str) -> Edit:
    """With a second variable of this name."""

    def edit(root: Element) -> None:
        variable(name, causality="input", start="0.0", variability="continuous")(root)

    return edit


OTHER_GAINS = b"40.0 25.0 1.4\n12.0 8.0 0.4\n"
QUOTED = ("'a\"b'", "'c d'", "'h\\'i //j'", "'*/ no code'", "'stupid,name'", "'<&>'", "'q_m[1]'")

REPORTS = (
    # Resources
    Report(
        "CATIA-Systems/FMPy#5",
        "Incomplete path to fmuResourceLocation",
        "reads a file from the location of its resources",
        Specimen("resources", changes=(adding("resources/gains.txt", GAINS),)),
    ),
    Report(
        "jondo2010/rust-fmi#52",
        "resourcePath incorrect when instantiating FMI3.0 FMUs",
        "appends the name of a file to the resource path of FMI 3.0",
        Specimen("resources", changes=(adding("resources/gains.txt", GAINS),), version="3.0"),
    ),
    Report(
        "CATIA-Systems/FMPy#236",
        "fmpy estimates resources in wrong location for Linux FMUs",
        "removes three slashes from the location, and so makes a relative name of it",
        Specimen("resources, three slashes removed", changes=(adding("resources/gains.txt", GAINS),)),
        "Not possible to open file",
    ),
    Report(
        "CATIA-Systems/FMIKit-Simulink#231",
        "FMI kit data paths issue",
        "opens a file by a name relative to the working folder",
        Specimen("resources by a relative name", changes=(adding("resources/gains.txt", GAINS),)),
        'Not possible to open file "resources/gains.txt"',
    ),
    Report(
        "modelica/Reference-FMUs#74",
        "Handle spaces (%20) in fmuResourceLocation URI",
        "lies in a folder with a space, and decodes the location of its resources",
        Specimen("resources", changes=(adding("resources/gains.txt", GAINS),)),
        cache="device 1",
    ),
    Report(
        "CATIA-Systems/FMPy#230",
        "Segfault on resource paths with spaces",
        "lies in a folder with a space, and does not decode the location of its resources",
        Specimen("resources, nothing decoded", changes=(adding("resources/gains.txt", GAINS),)),
        "Not possible to open file",
        cache="device 1",
    ),
    Report(
        "OpenModelica/OpenModelica#3809",
        "It seems that *all* generated FMUs have the same GUID",
        "has the names and the GUID of another FMU that was evaluated before",
        Specimen("resources", changes=(adding("resources/gains.txt", GAINS),)),
        before=Specimen("resources", changes=(adding("resources/gains.txt", OTHER_GAINS),)),
    ),
    Report(
        "modelica-tools/FMUComplianceChecker#33",
        "FMUChecker missing check for optional authority in fmuResourceLocation URI",
        "understands a location with an authority only",
        Specimen("an authority"),
    ),
    Report(
        "modelica/fmi-standard#814",
        "Inconsistency in fmuResourceLocation and resources folder?",
        "has no resources, and wants the location that it is given to exist",
        Specimen("the folder of resources exists"),
    ),
    # Callbacks
    Report(
        "OpenModelica/OMSimulator#1323",
        "OMSimulator crashes when FMU sends a log message without a category",
        "logs with NULL as category and name",
        Specimen("logs without a category"),
    ),
    Report(
        "modelica/fmi-standard#435",
        "Remove variable arguments from C-API",
        "logs with arguments of several types, and with a percent sign but no argument",
        Specimen("logs with arguments"),
    ),
    Report(
        "modelica/fmi-standard#29",
        "clarify lifetime of strings",
        "overwrites a message as soon as the logger has returned",
        Specimen("reuses what it logged"),
    ),
    Report(
        "viproma/cppfmu#5",
        "componentEnvironment points to an FMU-Internal data structure",
        "hands the logger a pointer of its own",
        Specimen("logs with its own pointer"),
    ),
    Report(
        "modelica/fmi-standard#1923",
        "Clarify lifetime of argument functions in fmi2Instantiate()",
        "keeps the pointer to the callback functions",
        Specimen("keeps the pointer to the callbacks"),
    ),
    Report(
        "modelica/fmi-standard#290",
        "Function allocateMemory must initialize with zeros?",
        "needs zeros in the memory that the importer gives",
        Specimen("memory of the importer"),
    ),
    Report(
        "OpenModelica/OpenModelica#9336",
        "Memory management issue with FMU (CVODE solver)",
        "gives memory of its own to the importer's freeMemory",
        Specimen("memory of its own, given back to the importer"),
    ),
    Report(
        "open-simulation-platform/proxy-fmu!56",
        "Fix vesselfmu hanging",
        "prints, also empty lines",
        Specimen("prints"),
    ),
    # Order of calls
    Report(
        "lbl-srg/EnergyPlusToFMU#11",
        "Stop time not defined",
        "needs a stop time",
        Specimen("needs a stop time"),
    ),
    Report(
        "modelica/fmi-standard#575",
        "Clarification of handling FMUs with constant step size and final step when rounding errors occur",
        "refuses a step that ends after the stop time, by however little",
        Specimen("ends at the stop time"),
    ),
    Report(
        "CATIA-Systems/FMPy#122",
        "fmi2SetupExperiment is no longer being called for CS",
        "needs fmi2SetupExperiment before the initialization",
        Specimen("needs a set-up"),
    ),
    Report(
        "modelica/fmi-standard#369",
        "Setting input start values before fmi2EnterInitializationMode",
        "refuses inputs before the initialization",
        Specimen("inputs from initialization on"),
    ),
    Report(
        "OpenModelica/OpenModelica#12893",
        "FMU Import: Fixed parameters written after fmi2ExitInitializationMode",
        "refuses fixed parameters after the initialization",
        Specimen("fixed parameters"),
    ),
    Report(
        "open-simulation-platform/cosim-cli#110",
        "run-single initializes FMU before setting initial values",
        "uses its parameters as soon as the initialization begins",
        Specimen("parameters used early"),
    ),
    Report(
        "modelica/fmi-guides#31",
        "Start values for inputs",
        "divides by an input during the initialization; the start value is zero",
        Specimen("divides by an input"),
    ),
    Report(
        "open-simulation-platform/libcosim#267",
        "JavaFMI FMUs chrases due to do use of std::numeric_limits<fmi2_real_t>::quiet_NaN()",
        "crashes if the stop time or the tolerance is not a number",
        Specimen("needs numbers for times"),
    ),
    Report(
        "OpenModelica/OpenModelica#10975",
        "FMU-export: Initialization causes SIGFPE throw",
        "divides zero by zero and compares with the result",
        Specimen("compares with NaN"),
    ),
    Report(
        "lbl-srg/EnergyPlusToFMU#33",
        "Communicationstepsize: %f is different from time step: %d in input file",
        "steps by 1 ms only, and its description says 0.25 ms",
        Specimen("a larger step"),
        "communicationStepSize: 0.000250 is different from time step: 0.001000",
    ),
    Report(
        "CATIA-Systems/FMPy#357",
        "`fmu.terminate` raises errors",
        "answers fmi2Terminate with an error",
        Specimen("an error at the end"),
    ),
    Report(
        "OpenModelica/OpenModelica#5130",
        "Segmentation fault when fmi2Terminate gets called twice",
        "crashes when it is terminated twice",
        Specimen("crashes at the second end"),
    ),
    Report(
        "viproma/cppfmu#3",
        "Segmentation fault when freeing the instance in pyfmi before exiting",
        "crashes when it is freed twice",
        Specimen("crashes when it is freed twice"),
    ),
    Report(
        "OpenModelica/OpenModelica!16321",
        "Comp/SimRT: Fix CVODE FMU crash on fmi2Terminate/fmi2Reset",
        "crashes in fmi2Terminate",
        Specimen("crashes at the end"),
        "in the call 'terminate' of the controller",
    ),
    Report(
        "CATIA-Systems/FMIKit-Simulink#31",
        "RTWSFCN FMU crashes on fmi2Reset()",
        "crashes in fmi2Reset",
        Specimen("crashes at a reset"),
    ),
    Report(
        "modelica/Reference-FMUs#204",
        "Internal time is not reset in reset function",
        "does not reset its time, and refuses another one",
        Specimen("time stays after a reset"),
    ),
    Report(
        "CATIA-Systems/FMPy#147",
        "Fmu crashes the python interpreter on freelibrary",
        "crashes when its library is unloaded",
        Specimen("crashes when it is unloaded"),
    ),
    Report(
        "modelica-tools/FMUComplianceChecker#48",
        "Compliance checker should signal crash on exit/unloading of FMU caused by OpenMP-spindown",
        "has threads that run on when its instance is freed",
        Specimen("lingers"),
    ),
    # Statuses
    Report(
        "CATIA-Systems/FMIKit-Simulink#311",
        "Continue fmi2DoStep() after warning in rtwsfcnfmi.tlc",
        "answers each step with fmi2Warning",
        Specimen("warns in each step"),
    ),
    Report(
        "CATIA-Systems/FMPy#353",
        "Handle fmi2Discard returned by fmi2DoStep()",
        "discards a step at 20 ms",
        Specimen("discards a step"),
        "fmi2DoStep returned discard",
    ),
    Report(
        "modelica-tools/FMUComplianceChecker#60",
        "How does FMUComplianceChecker Manage StepIncomplete?",
        "answers a step with fmi2Pending",
        Specimen("pending"),
        "fmi2DoStep returned pending",
    ),
    Report(
        "modelica/fmi-standard#273",
        "What is the meaning of fmi2Discard returned by fmi2GetReal?",
        "answers fmi2GetReal with fmi2Discard from 20 ms on",
        Specimen("values discarded"),
        "fmi2GetReal returned discard",
    ),
    Report(
        "OpenModelica/OpenModelica#9362",
        "Co-simulation fmu crash on Ubuntu 22.04",
        "jumps with longjmp to where it has never been",
        Specimen("jumps nowhere"),
        "the process was ended by SIGSEGV, in the call 'fmi2DoStep' of the controller",
    ),
    Report(
        "modelica/Reference-FMUs#647",
        "FMUSim GUI crashes when FMU returns NULL in instantiateXXX",
        "gives no instance, and no reason",
        Specimen("no instance"),
        "Usual reasons are a missing licence, a GUID that is not the binary's, or a missing file",
    ),
    Report(
        "CATIA-Systems/FMPy#167",
        "[ERROR] GUID of model is not correct",
        "has a library with another GUID than its description",
        Specimen("another GUID"),
        "GUID of model is not correct",
    ),
    Report(
        "CATIA-Systems/FMIKit-Simulink#430",
        "Inital constant value output",
        "puts out zero until its first step",
        Specimen("zero before the first step"),
    ),
    Report(
        "CATIA-Systems/FMIKit-Simulink#282",
        "time delay and duplicate output value in newest v3.0-alpha.1 build",
        "puts out each value one step late",
        Specimen("one step late"),
        warned="1 samples from a measurement to the torque",
    ),
    # Surroundings
    Report(
        "CATIA-Systems/FMPy#62",
        "OpenModelica FMU crashes on Linux",
        "cannot read numbers where the locale of numbers is another one than C",
        Specimen("a number with a decimal point"),
    ),
    Report(
        "OpenModelica/OMCompiler!2708",
        "A slow-but-working trick for proper local decimal separator handling (tickets 4020 and possibly 4631)",
        "changes the locale of its process",
        Specimen("a variable locale"),
    ),
    Report(
        "modelica/fmi-guides!19",
        "Add clarifications on global state",
        "changes the working folder of its process",
        Specimen("changes the folder"),
    ),
    # Libraries
    Report(
        "modelon-community/PyFMI#240",
        "Error on loading Fmu",
        "has no function fmi2GetStringStatus",
        Specimen(options=("-DNO_STRING_STATUS",)),
        "undefined symbol: fmi2GetStringStatus",
    ),
    Report(
        "OpenModelica/OpenModelica#8548",
        'Generated FMU points to undefined symbol "hybrj_" or "enorm_"',
        "calls a function that no library has",
        Specimen(options=("-DOTHER_LIBRARY",)),
        "undefined symbol: other_function",
    ),
    Report(
        "lbl-srg/MPCPy#169",
        "FMUs depend on libgfortran.so.3",
        "needs a library that is not installed",
        Specimen(changes=(binary(lambda: needing("libgfortran.so.3")),)),
        "libgfortran.so.3: cannot open shared object file",
    ),
    Report(
        "OpenModelica/OpenModelica#7005",
        'FMU export from OMEdit with external "C" shared library dependencies fails',
        "needs a library beside its own, and looks for it in a folder of its exporter",
        Specimen(
            changes=(
                binary(lambda: needing("libother.so", "-Wl,-rpath,/home/exporter/project")),
                lambda files: {**files, f"binaries/{PLATFORM}/libother.so": other_library("libother.so")},
            )
        ),
        "it needs libother.so, which the FMU has in",
    ),
    Report(
        "PySimulator/PySimulator#53",
        "FMUSimulator fails to load binary if it depends on other binaries",
        "needs a library beside its own, and looks for it there",
        Specimen(
            changes=(
                binary(lambda: needing("libother.so", "-Wl,-rpath,$ORIGIN")),
                lambda files: {**files, f"binaries/{PLATFORM}/libother.so": other_library("libother.so")},
            )
        ),
    ),
    Report(
        "ghorwin/MasterSim#25",
        "Fix problem when loading IBK-based FMUs with different IBK versions",
        "has functions and data with names that the C library and the mathematical library have, too",
        Specimen(options=("-DNAMES_OF_OTHERS",)),
    ),
    Report(
        "CATIA-Systems/FMPy#242",
        "Link against libm when compiling platform binaries on Linux",
        "uses the mathematical library and does not name it",
        Specimen(options=("-DLIBM",)),
    ),
    Report(
        "CATIA-Systems/FMPy#789",
        "FMI 3.0 binaries paths incorrect?",
        "is of FMI 3.0 and has its library in the folder of FMI 2.0",
        Specimen(changes=(moved(f"binaries/{fmpy.platform_tuple}/{NAME}{SUFFIX}", BINARY),), version="3.0"),
        f"has no binary for this platform, {fmpy.platform_tuple}; it has {PLATFORM}",
    ),
    Report(
        "CATIA-Systems/FMPy!884",
        "Load FMI 1.0/2.0 binaries from FMI 3.0 platform-tuple directories",
        "is of FMI 2.0 and has its library in the folder of FMI 3.0",
        Specimen(changes=(moved(BINARY, f"binaries/{fmpy.platform_tuple}/{NAME}{SUFFIX}"),)),
        f"has no binary for this platform, {PLATFORM}; it has {fmpy.platform_tuple}",
    ),
    Report(
        "OpenModelica/OpenModelica#16402",
        "[FMI] FMI 3.0 export on Windows writes binaries/x86_64-win instead of the x86_64-windows platform tuple",
        "has a library in a folder of no platform",
        Specimen(
            changes=(moved(f"binaries/{fmpy.platform_tuple}/{NAME}{SUFFIX}", f"binaries/x86_64-win/{NAME}.dll"),),
            version="3.0",
        ),
        f"has no binary for this platform, {fmpy.platform_tuple}; it has x86_64-win",
    ),
    # Descriptions
    Report(
        "modelon-community/fmi-library#217",
        "FMI Version Parsing Is Too Strict for FMI 3.0.x FMUs",
        'says fmiVersion="3.0.1"',
        Specimen(edits=(attribute(".", fmiVersion="3.0.1"),), version="3.0"),
    ),
    Report(
        "modelica/fmi-standard#388",
        "Clarifications regarding FMI version string: forward/backwards compatibility; version string.",
        'says fmiVersion="2.0.1"',
        Specimen(edits=(attribute(".", fmiVersion="2.0.1"),)),
        "Unsupported FMI version: 2.0.1",
    ),
    Report(
        "modelica/fmi-standard#95",
        "Handling international encodings",
        "has a description in ISO 8859-1",
        Specimen(
            changes=(
                written(b"encoding='UTF-8'", b"encoding='ISO-8859-1'"),
                written(b'modelName="Specimen"', 'modelName="Größe"'.encode("latin-1")),
            )
        ),
    ),
    Report(
        "CATIA-Systems/FMPy#596",
        "Handle FMUs with different model name and model identifier in CMake project generation",
        "has another modelName than modelIdentifier, and another file name",
        Specimen(edits=(attribute(".", modelName="Another model"),)),
    ),
    Report(
        "modelica/fmi-standard#178",
        "Different modelIdentifier for ME and CS should no longer be required",
        "is for both kinds, with a library for co-simulation alone",
        Specimen("co-simulation only", edits=(with_model_exchange,)),
    ),
    Report(
        "OpenModelica/OpenModelica#12344",
        "QuotedIdentifiers and FMU export",
        "has names with quotes, spaces, comments and angle brackets",
        Specimen(edits=tuple(variable(name) for name in QUOTED)),
    ),
    Report(
        "OpenModelica/OpenModelica#11265",
        "variable name of the exported .fmu not following FMI 2.0",
        "has names that are not structured",
        Specimen(edits=(variable("previous(x)"), variable("a/b"), variable("a[1, 2]"))),
    ),
    Report(
        "Kvixen/Simulix#28",
        "FMU Import in Amesim",
        "has two inputs of one name",
        Specimen(edits=(twice("q_m[1]"),)),
        "has more than one variable q_m[1]",
    ),
    Report(
        "CATIA-Systems/FMPy#774",
        "FMU 3.0 from Dymola does not pass validation",
        "has VendorAnnotations in the wrong place",
        Specimen(edits=(with_annotations_in_the_wrong_place,), version="3.0"),
    ),
    Report(
        "modelon-community/fmi-library#128",
        "Model structure is not valid due to detected errors. Cannot continue",
        "has attributes and causalities that FMI 2.0 does not know",
        Specimen(
            edits=(
                attribute("CoSimulation", stepSize="0.001"),
                variable("time", causality="independent", variability=""),
            )
        ),
    ),
    Report(
        "modelica/Reference-FMUs#405",
        "String datatype with Start value not working with fmpy error in Schema",
        "has the start value of a String of FMI 3.0 as an attribute",
        Specimen(edits=(variable_3("text", "String", start="1", variability="discrete"),), version="3.0"),
    ),
    Report(
        "modelon-community/fmi-library#207",
        "±∞ start values in FMI 3.0 model description are rejected",
        "has infinite start values",
        Specimen(
            edits=(variable_3("limit", "Float64", start="-INF", causality="parameter", variability="fixed"),),
            version="3.0",
        ),
    ),
    Report(
        "CATIA-Systems/FMPy#529",
        "Issue with Enumeration start value in FMI 3",
        "has an enumeration of FMI 3.0 with a start value",
        Specimen(
            edits=(
                with_a_mode,
                variable_3("mode", "Enumeration", declaredType="Mode", start="2", variability="discrete"),
            ),
            version="3.0",
        ),
    ),
    Report(
        "CATIA-Systems/FMPy#420",
        "Container FMU: Wrong handling of start value for Booleans",
        'has a Boolean with start="False"',
        Specimen(edits=(variable("flag", "Boolean", start="False", variability="discrete"),)),
    ),
    Report(
        "NTNU-IHB/PythonFMU#156",
        "String output not working",
        "has an output that is a String, and gives NULL for it",
        Specimen(edits=(variable("text", "String", causality="output", variability="discrete"),)),
    ),
    Report(
        "ThummeTo/FMI.jl#44",
        "Support for UInt Model Variable Identifiers",
        "has value references above 2147483647",
        Specimen("large value references", edits=(references(lambda old: 0x90000000 + old),)),
    ),
    Report(
        "CATIA-Systems/FMPy#266",
        "Validate restrictions for alias variables",
        "has two inputs with one value reference",
        Specimen(edits=(sharing_a_reference,)),
        "q_m[1] and q_m_ref[1] have the same value reference, 0",
    ),
    Report(
        "modelica/fmi-standard#80",
        "Errata for FMI 1.0 ME and CS",
        "is of FMI 1.0 and has an output that is a negated alias",
        OfTheProject("DiagonalPID_C_fmi1", (declare(r"u_m\[2\]", alias="negatedAlias"),)),
        "u_m[2] is declared as Real, negated alias, but u_m must be a real output",
    ),
    Report(
        "modelica/fmi-standard#225",
        "How to interpret and manage access rules regarding aliased variables with different causalities?",
        "has inputs and outputs that local variables share the value references of",
        Specimen(edits=(aliased,)),
    ),
    Report(
        "CATIA-Systems/FMPy#824",
        "Cannot read the result value of aliases variables with FMI3",
        "has the measurement as an alias of FMI 3.0 only",
        Specimen(edits=(measured_under_an_alias,), version="3.0"),
    ),
    Report(
        "OpenModelica/OpenModelica#8943",
        "displayUnit export to FMU",
        "has display units with an offset, and undefined ones",
        Specimen(edits=(with_a_display_unit,)),
    ),
    Report(
        "modelica/fmi-standard#1220",
        "Allow inverse display units",
        "has an inverse display unit",
        Specimen(edits=(with_an_inverse_display_unit,), version="3.0"),
    ),
    Report(
        "CATIA-Systems/FMPy#865",
        "wrong unit conversion for TemperatureDifference",
        "has a unit of angle with an offset",
        Specimen(edits=(unit("rad", "shifted", rad="1", offset="0.1"),)),
        "q_m[1] has the unit 'shifted', whose zero is not that of rad (offset 0.1)",
    ),
)
"""All of them; each is one property."""
