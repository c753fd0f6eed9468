"""Small controllers in Python, made into FMUs by pythonfmu: u_m = u_m0 + K (q_m_ref - q_m), and whatever else."""

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
        for name in ("q_m_ref[1]", "q_m_ref[2]", "q_m[1]", "q_m[2]"):
            self.add(name, "input", "continuous")
        for name in ("u_m[1]", "u_m[2]"):
            self.add(name, "output", "continuous")
        for name in ("u_m0[1]", "u_m0[2]", "K"):
            self.add(name, "parameter", "fixed", {gain} if name == "K" else 0.0)
        if self.instance_name != "dummyInstance":  # not while it is built
            self.begin()

    def add(self, name, causality, variability, start=0.0):
        self.own[name] = start
        kind = {{"causality": Fmi2Causality[causality], "variability": Fmi2Variability[variability]}}
        access = {{"getter": lambda: self.own[name], "setter": lambda value: self.own.__setitem__(name, value)}}
        self.register_variable(Real(name, **kind, **access))

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
    for module, text in (modules or {}).items():
        (sources / f"{module}.py").write_text(text)
    files = [sources / f"{module}.py" for module in modules or {}]
    return python_fmu(script, files, script.stem, target or folder / f"{name}.fmu")
