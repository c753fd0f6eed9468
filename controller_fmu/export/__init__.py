"""Turn sources into FMUs: Python slaves through pythonfmu, C models through the machine's compiler.

Both ways end in the same two steps: the model description is completed (units, initial unknowns, a GUID that
follows from the contents) and the archive is written such that equal sources give equal bytes.
"""

from controller_fmu.errors import BuildError, NoCompilerError
from controller_fmu.export.archive import content_guid, pack, unpack, write_atomically
from controller_fmu.export.c_fmu import C_INTERFACE, FMI_HEADERS, c_fmu
from controller_fmu.export.compiler import COMPILERS, find_compiler, run_compiler
from controller_fmu.export.dialects import Dialect
from controller_fmu.export.folder import build_folder
from controller_fmu.export.platforms import PLATFORMS
from controller_fmu.export.python_fmu import python_fmu

__all__ = ["COMPILERS", "C_INTERFACE", "FMI_HEADERS", "PLATFORMS", "BuildError", "Dialect", "NoCompilerError"]
__all__ += ["build_folder", "c_fmu", "content_guid", "find_compiler", "pack", "python_fmu", "run_compiler", "unpack"]
__all__ += ["write_atomically"]
