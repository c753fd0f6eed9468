"""The PID as a C model behind this project's own FMI glue, with the choices that foreign exporters make otherwise."""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

from support.pid_fmus import GAINS, T_S
from support.stub_fmus import CONTROLLER, build_model, description

import build_fmus
from controller_fmu.export import Dialect
from orchestrator.loop.behaviour import Convention

MODEL = Path(__file__).parent / "sources" / "pid_model.c"
LAW = Path(build_fmus.__file__).parent / "controller_fmu" / "pid_c"
DEGREE = math.pi / 180.0


@dataclass(frozen=True)
class CModel:
    """The choices ``sources/pid_model.c`` leaves open."""

    axes: tuple[int, ...] = (0, 1)
    """Which axes' gains; one axis has scalar names (``q_m``), several have structured ones (``q_m[1]``)."""
    angle: float = 1.0
    """What the binary takes for one unit of angle [rad]; the description says rad all the same."""
    torque: float = 1.0
    """What the binary takes for one unit of torque [N.m]."""
    convention: Convention = Convention.STEP_START
    dialect: Dialect = Dialect()

    def build(self, target: Path) -> Path:
        """Compile the model into the FMU ``target``."""
        rows = []
        for name, *others in CONTROLLER[::2]:
            connector = name.removesuffix("[1]")
            names = [f"{connector}[{i + 1}]" for i in range(len(self.axes))] if len(self.axes) > 1 else [connector]
            rows += [(each, *others) for each in names]
        described = description(rows, T_S, canGetAndSetFMUstate="true", canSerializeFMUstate="true")
        with tempfile.TemporaryDirectory() as folder:
            choices = Path(folder, "build.h")
            choices.write_text("".join(f"#define {name} {value}\n" for name, value in self._choices().items()))
            sources = [MODEL, LAW / "pid.c", LAW / "pid.h", choices]
            return build_model(sources, described, target, self.dialect)

    def _choices(self) -> dict[str, object]:
        gains = [[*(GAINS[name][axis] for name in ("K_p", "K_i", "K_d", "z_p")), T_S] for axis in self.axes]
        return {
            "AXES": len(self.axes),
            "GAINS": str(gains).translate(str.maketrans("[]", "{}")),
            "ANGLE": self.angle,
            "TORQUE": self.torque,
            "SAMPLES_AT_INITIALIZATION": int(self.convention is Convention.INITIALIZATION),
            "SAMPLES_TWICE_FIRST": int(self.convention is Convention.TWICE),
        }
