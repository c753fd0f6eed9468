"""Turn sources into FMUs: Python slaves through pythonfmu, C models through the machine's compiler.

Both ways end in the same two steps: the model description is completed (units, initial unknowns, a GUID that
follows from the contents) and the archive is written such that equal sources give equal bytes.
"""

from controller_fmu.export.archive import BuildError
from controller_fmu.export.c_fmu import c_fmu
from controller_fmu.export.compiler import NoCompilerError, find_compiler
from controller_fmu.export.dialects import Dialect
from controller_fmu.export.python_fmu import python_fmu

__all__ = ["BuildError", "Dialect", "NoCompilerError", "c_fmu", "find_compiler", "python_fmu"]
