"""The variables of the imperfections FMU, in the order of its struct, and its description."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from controller_fmu.export.rows import head

_WORDS = "32-bit words, the highest first"

VARIABLES: tuple[tuple[str, int, str, str, float, str], ...] = (
    ("q_m", 2, "input", "rad", 0.0, "motor angles of the plant"),
    ("u_c", 2, "input", "N.m", 0.0, "torques that the controller asks for"),
    ("y", 2, "output", "rad", 0.0, "motor angles as they are measured, for the controller"),
    ("u_m", 2, "output", "N.m", 0.0, "torques as the drives give them, for the plant"),
    ("u_d", 2, "output", "N.m", 0.0, "torque disturbance, for the plant"),
    ("F", 2, "output", "N", 0.0, "force on the tool, for the plant"),
    ("q_m_ref", 2, "parameter", "rad", 0.0, "angles in the initial steady state"),
    ("u_m0", 2, "parameter", "N.m", 0.0, "torques in the initial steady state"),
    ("rate", 1, "parameter", "Hz", 4000.0, "steps of the plant per second; each is a tick"),
    ("ticks_per_sample", 1, "parameter", "1", 1.0, "ticks between two samples of the controller"),
    ("sensor_delay", 2, "parameter", "1", 0.0, "delay of the angles in ticks"),
    ("drive_delay", 2, "parameter", "1", 1.0, "delay of the torques in ticks, the one of their way here included"),
    ("angle_quantum", 1, "parameter", "rad", 0.0, "resolution of the angles, none if 0"),
    ("gain", 2, "parameter", "1", 1.0, "gain of the torques about u_m0"),
    ("limit", 2, "parameter", "N.m", 1e12, "limit of the torques"),
    ("torque_quantum", 2, "parameter", "N.m", 0.0, "resolution of the torques, none if 0"),
    ("sigma", 1, "parameter", "rad", 0.0, "standard deviation of the noise on the angles"),
    ("noise_state", 4, "parameter", "1", 0.0, f"state of PCG64, {_WORDS}"),
    ("noise_increment", 4, "parameter", "1", 0.0, f"increment of PCG64, {_WORDS}"),
    ("chirp_amplitude", 2, "parameter", "N.m", 0.0, "amplitude of the torque disturbance"),
    ("chirp_start", 1, "parameter", "s", 0.0, "begin of the torque disturbance"),
    ("chirp_stop", 1, "parameter", "s", 0.0, "end of the torque disturbance"),
    ("chirp_f_start", 1, "parameter", "Hz", 0.0, "frequency of the torque disturbance at its begin"),
    ("chirp_f_stop", 1, "parameter", "Hz", 0.0, "frequency of the torque disturbance at its end"),
    ("force", 2, "parameter", "N", 0.0, "force on the tool while it acts"),
    ("force_start", 1, "parameter", "s", 0.0, "begin of the force"),
    ("force_stop", 1, "parameter", "s", 0.0, "end of the force"),
)
"""Name, number of elements, causality, unit, start value, description."""

FEEDTHROUGH = {"y": "q_m", "u_m": "u_c"}
"""The input that an output depends on directly, element by element."""


def description() -> Element:
    """Return the FMI 2.0 description, which the build completes."""
    what = "What stands between controller and plant: noise, quantization, delays, gain, disturbances"
    root = head(what, 0.000125, "canHandleVariableCommunicationStepSize")
    listed = SubElement(root, "ModelVariables")
    outputs = SubElement(SubElement(root, "ModelStructure"), "Outputs")
    indices: dict[str, str] = {}
    for name, size, causality, unit, start, meaning in VARIABLES:
        for element in (f"{name}[{i}]" for i in range(1, size + 1)) if size > 1 else (name,):
            indices[element] = str(len(indices) + 1)
            kind = {"causality": causality, "variability": "fixed" if causality == "parameter" else "continuous"}
            variable = SubElement(listed, "ScalarVariable", {"name": element, **kind, "description": meaning})
            variable.set("valueReference", str(len(indices) - 1))
            real = SubElement(variable, "Real", unit=unit)
            if causality == "output":
                dependency = indices.get(element.replace(name, FEEDTHROUGH.get(name, ""), 1), "")
                SubElement(outputs, "Unknown", index=indices[element], dependencies=dependency)
            else:
                real.set("start", repr(start))
    return root
