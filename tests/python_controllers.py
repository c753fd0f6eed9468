"""Small controllers in Python, made into FMUs by pythonfmu: u_m = u_m0 + K (q_m_ref - q_m), and whatever else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from controller_fmu.export import python_fmu

SCRIPT = """
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
{imports}

UNITS = {{"q_m_ref": "rad", "q_m": "rad", "u_m": "N.m", "u_m0": "N.m", "K": "N.m/rad"}}


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(step_size={step})
        self.own = {{}}
        for name, causality, variability in (
            ("q_m_ref", "input", "continuous"),
            ("q_m", "input", "continuous"),
            ("u_m", "output", "continuous"),
            ("u_m0", "parameter", "fixed"),
        ):
            for i in (1, 2):
                self.add(f"{{name}}[{{i}}]", causality, variability)
        self.add("K", "parameter", "fixed", {gain})
        for i in (1, 2):
            self.own[f"u_m[{{i}}]"] = 0.0
        if self.instance_name != "dummyInstance":  # not while it is built
            self.begin()

    def add(self, name, causality, variability, start=0.0):
        self.own[name] = start
        self.register_variable(
            Real(
                name,
                causality=Fmi2Causality[causality],
                variability=Fmi2Variability[variability],
                getter=lambda: self.own[name],
                setter=lambda value: self.own.__setitem__(name, value),
            )
        )

    def law(self):
        own = self.own
        for i in (1, 2):
            own[f"u_m[{{i}}]"] = own[f"u_m0[{{i}}]"] + own["K"] * (own[f"q_m_ref[{{i}}]"] - own[f"q_m[{{i}}]"])

    def begin(self):
        {begin}

    def exit_initialization_mode(self):
        {initialize}

    def do_step(self, current_time, step_size):
        {step_body}
"""


def python_controller(
    folder: Path,
    name: str = "Proportional",
    gain: float = 1.0,
    step: float = 0.25e-3,
    imports: str = "",
    begin: str = "pass",
    initialize: str = "pass",
    step_body: str = "self.law(); return True",
    modules: Mapping[str, str] | None = None,
    target: Path | None = None,
) -> Path:
    """Build ``folder/NAME.fmu`` (or ``target``) of a controller with gain ``gain`` [N.m/rad].

    ``begin``, ``initialize`` and ``step_body`` are what its methods do, on one line; ``modules`` travel with it, text
    by name, and ``imports`` are lines at its head.
    """
    sources = folder / "sources" / (target or Path(name)).stem
    sources.mkdir(parents=True)
    bodies = {"begin": begin, "initialize": initialize, "step_body": step_body}
    script = sources / f"{name.lower()}.py"
    script.write_text(SCRIPT.format(name=name, gain=gain, step=step, imports=imports, **bodies))
    files = []
    for module, text in (modules or {}).items():
        files.append(sources / f"{module}.py")
        files[-1].write_text(text)
    return python_fmu(script, files, script.stem, target or folder / f"{name}.fmu")
