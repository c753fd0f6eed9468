"""The PID from Modelica source: rumoca emits C for the sampled block, this project's FMI glue makes it an FMU.

rumoca 0.10.2 refuses sampled blocks for its own FMI targets (``fmi2``, ``fmi3``: "does not support feature
'clocks'"); its target ``embedded-c-galec`` takes them. That C has the arithmetic of the Modelica source in single
precision; compiled with ``float`` as ``double`` it gives the law's torques to the last bit.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import build_fmus

from .native import describe
from .recipe import Recipe

PACKAGE = Path(build_fmus.__file__).parent / "examples" / "modelica" / "FlexibleManipulator.mo"
BLOCK = "FlexibleManipulator.DiagonalPID"
SOURCES = Path(__file__).parent / "sources" / "rumoca"


def _make(target: Path) -> Path:
    import rumoca

    block = rumoca.Session().load(PACKAGE, model=BLOCK)
    with tempfile.TemporaryDirectory() as folder:
        description = Path(folder, "modelDescription.xml")
        description.write_bytes(describe(axes=2))
        sources = list(SOURCES.glob("*.[ch]"))
        for emitted in block.codegen("embedded-c-galec").files:
            source = Path(folder, emitted.path)
            if source.suffix in (".c", ".h"):
                source.write_text(f'#include "double_precision.h"\n{emitted.content}')
                sources.append(source)
        return build_fmus.c_fmu(sources, description, target)


RECIPES = (Recipe("rumoca", _make, modules=("rumoca",), needs_compiler=True),)
