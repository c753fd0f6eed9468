"""An ordinary controller under names that no connector has."""

from pathlib import Path
from xml.etree.ElementTree import Element

from exporters.description_edits import edited

NAMES = {
    "q_m[1]": "Gelenk <links> Winkel",
    "q_m[2]": 'Gelenk "rechts" Winkel',
    "q_m_ref[1]": "Soll & 1",
    "q_m_ref[2]": "Soll & 2",
    "u_m[1]": "Moment A",
    "u_m[2]": "Moment B",
    "u_m0[1]": "Vorgabe A",
    "u_m0[2]": "Vorgabe B",
    "K_p[1]": "Verstärkung",
}
"""The FMU's names by those of the paper's PID."""

BINDING = {name: NAMES[name] for name in NAMES if not name.startswith("K_p")}


def unusual(pid: Path, target: Path) -> Path:
    """The paper's PID with other names."""

    def rename(root: Element) -> None:
        root.set("variableNamingConvention", "flat")
        for variable in root.iter("ScalarVariable"):
            variable.set("name", NAMES.get(variable.get("name", ""), variable.get("name", "")))

    return edited(pid, target, rename)
