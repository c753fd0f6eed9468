"""The PID as a C model behind this project's own FMI glue, with the choices that foreign exporters make otherwise."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from pid_fmus import GAINS, T_S

import build_fmus
from controller_fmu.export import Dialect
from controller_fmu.export.description import to_bytes

from .recipe import Timing

SOURCES = Path(__file__).parent / "sources" / "c_pid"
LAW = Path(build_fmus.__file__).parent / "controller_fmu" / "pid_c"
DEGREE = math.pi / 180.0

_CONNECTORS = (
    ("q_m_ref", "input", "continuous", "rad"),
    ("q_m", "input", "continuous", "rad"),
    ("u_m", "output", "discrete", "N.m"),
    ("u_m0", "parameter", "fixed", "N.m"),
)


@dataclass(frozen=True)
class CModel:
    """The choices ``sources/c_pid/model.c`` leaves open."""

    axes: tuple[int, ...] = (0, 1)
    """Which axes' gains; one axis has scalar names (``q_m``), several have structured ones (``q_m[1]``)."""
    angle: float = 1.0
    """What the binary takes for one unit of angle [rad]; the description says rad all the same."""
    torque: float = 1.0
    """What the binary takes for one unit of torque [N.m]."""
    timing: Timing = Timing.STEP_START
    dialect: Dialect = Dialect()

    def build(self, target: Path) -> Path:
        """Compile the model into the FMU ``target``."""
        with tempfile.TemporaryDirectory() as folder:
            description, choices = Path(folder, "modelDescription.xml"), Path(folder, "build.h")
            description.write_bytes(describe(len(self.axes)))
            choices.write_text(self._choices())
            sources = [SOURCES / "model.c", LAW / "pid.c", LAW / "pid.h", choices]
            return build_fmus.c_fmu(sources, description, target, self.dialect)

    def _choices(self) -> str:
        gains = ", ".join(
            "{" + ", ".join(repr(GAINS[name][axis]) for name in ("K_p", "K_i", "K_d", "z_p")) + f", {T_S!r}}}"
            for axis in self.axes
        )
        values = {
            "AXES": len(self.axes),
            "GAINS": "{" + gains + "}",
            "ANGLE": repr(self.angle),
            "TORQUE": repr(self.torque),
            "SAMPLES_AT_INITIALIZATION": int(self.timing is Timing.INITIALIZATION),
            "SAMPLES_TWICE_FIRST": int(self.timing is Timing.TWICE_FIRST),
        }
        return "".join(f"#define {name} {value}\n" for name, value in values.items())


def describe(axes: int) -> bytes:
    """Return the description of a C model whose struct begins with q_m_ref, q_m, u_m, u_m0, each for all axes."""
    root = Element("fmiModelDescription", fmiVersion="2.0", modelName="", guid="")
    root.set("variableNamingConvention", "structured")
    SubElement(root, "CoSimulation", modelIdentifier="", canGetAndSetFMUstate="true", canSerializeFMUstate="true")
    SubElement(SubElement(root, "LogCategories"), "Category", name="logStatusError")
    SubElement(root, "DefaultExperiment", stepSize=repr(T_S))
    listed = SubElement(root, "ModelVariables")
    outputs = SubElement(SubElement(root, "ModelStructure"), "Outputs")
    for name, causality, variability, unit in _CONNECTORS:
        for index in range(1, axes + 1):
            variable = SubElement(
                listed,
                "ScalarVariable",
                name=f"{name}[{index}]" if axes > 1 else name,
                valueReference=str(len(listed)),
                causality=causality,
                variability=variability,
            )
            real = SubElement(variable, "Real", unit=unit)
            if causality == "output":
                SubElement(outputs, "Unknown", index=str(len(listed)))
            else:
                real.set("start", "0")
    return to_bytes(root)
