"""The PID from Modelica source: rumoca emits C for the sampled block, this project's FMI glue makes it an FMU.

rumoca 0.10.2 refuses sampled blocks for its own FMI targets (``fmi2``, ``fmi3``: "does not support feature
'clocks'"); its target ``embedded-c-galec`` takes them. That C has the arithmetic of the Modelica source in single
precision; compiled with ``float`` as ``double`` it gives the law's torques to the last bit.
"""

import tempfile
from pathlib import Path

from support.pid_fmus import T_S
from support.stub_fmus import CONTROLLER, build_model, description

import build_fmus

from .recipe import Recipe

PACKAGE = Path(build_fmus.__file__).parent / "examples" / "modelica" / "FlexibleManipulator.mo"
BLOCK = "FlexibleManipulator.DiagonalPID"
MODEL = Path(__file__).parent / "sources" / "rumoca_model.c"
DOUBLE_PRECISION = "#include <math.h>\n#include <stdbool.h>\n#include <stdint.h>\n#define float double\n"


def _make(target: Path) -> Path:
    import rumoca

    block = rumoca.Session().load(PACKAGE, model=BLOCK)
    with tempfile.TemporaryDirectory() as folder:
        sources = [MODEL]
        for emitted in block.codegen("embedded-c-galec").files:
            source = Path(folder, emitted.path)
            if source.suffix in (".c", ".h"):
                source.write_text(DOUBLE_PRECISION + emitted.content)
                sources.append(source)
        return build_model(sources, description(CONTROLLER, T_S), target)


RECIPES = (Recipe("rumoca", _make, needs=("rumoca", "compiler")),)
