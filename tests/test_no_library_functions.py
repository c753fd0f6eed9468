"""No compiled FMU of the benchmark calls a function of the C library whose last bits are the library's own."""

import re
from pathlib import Path

import fmpy
import pytest
from random_calls.fmus import FMUS
from support.elf import undefined_symbols

import build_fmus
from controller_fmu.export import unpack
from controller_fmu.export.c_fmu import FLAGS
from controller_fmu.export.compiler import run_compiler

pytestmark = pytest.mark.needs("compiler", "linux")

INEXACT = frozenset(
    f"{name}{kind}"
    for name in (
        *("sin", "cos", "sincos", "tan", "asin", "acos", "atan", "atan2", "sinpi", "cospi", "tanpi"),
        *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
        *("exp", "exp2", "exp10", "expm1", "log", "log2", "log10", "log1p", "pow", "cbrt", "hypot"),
        *("erf", "erfc", "tgamma", "lgamma", "j0", "j1", "jn", "y0", "y1", "yn"),
    )
    for kind in ("", "f", "l")
)
"""Mathematical functions of C whose results IEEE 754 does not define. The others, such as sqrt, fabs, floor, ceil,
rint, fmod, fmin, fmax, copysign, ldexp, frexp and fma, are exact or correctly rounded."""


def inexact(library):
    """The functions of INEXACT that a library asks for, also under glibc's names such as ``__exp_finite``."""
    return {symbol for symbol in undefined_symbols(library) if re.sub(r"^__|_finite$", "", symbol) in INEXACT}


def binary(fmu):
    """This machine's library in an FMU."""
    parts = unpack(fmu)
    (path,) = (name for name in parts if name.startswith("binaries/") and name.endswith(fmpy.sharedLibraryExtension))
    return parts[path]


@pytest.mark.parametrize("name", FMUS)
def test_no_binary_asks_for_an_inexact_function(name, tmp_path):
    own = binary(FMUS[name](tmp_path))
    assert inexact(own) == set()
    assert undefined_symbols(own) & {"malloc", "calloc", "free"}, "there are symbols to look at"


def test_a_sine_of_the_library_is_found(tmp_path):
    """In the imperfections, whose chirp is one."""
    fmu = build_fmus.build("Imperfections", tmp_path)
    for path, text in unpack(fmu).items():
        if path.startswith("sources/"):
            Path(tmp_path, path.removeprefix("sources/")).write_bytes(text.replace(b"elementary_sin(2.0", b"sin(2.0"))
    sources = sorted(file.name for file in tmp_path.glob("*.c"))
    file = tmp_path / "flawed.so"
    command = [*(build_fmus.find_compiler() or ()), *FLAGS, "-o", str(file), *sources, "-lm"]
    run_compiler(command, file, tmp_path)
    assert inexact(file.read_bytes()) == {"sin"}
