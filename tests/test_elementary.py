"""The own elementary functions: their errors, the same bits in C, Python and machine code, and no library's instead.

Errors are in units in the last place of the true value. The reference are numbers of 80 bits, whose own error of 2^-11
such units does not count; near multiples of pi / 2, where a sine of 80 bits is not enough, it is mpmath.
"""

import ctypes
import math
from pathlib import Path

import mpmath
import numba
import numpy as np
import pytest
from support.elementary_points import COUNT, Points, neighbours, points, within

import build_fmus
from controller_fmu.export import C_INTERFACE
from controller_fmu.export.c_fmu import FLAGS
from controller_fmu.export.compiler import run_compiler
from plant_fmu.flexible_manipulator import formulas
from plant_fmu.flexible_manipulator.elementary import exp, log, sin_cos
from plant_fmu.flexible_manipulator.jit import callable_from_compiled, compiled

LARGEST_ERROR = 0.9
STUB = Path(__file__).parent / "stubs" / "elementary.c"

WIDE = np.longdouble
needs_wide = pytest.mark.needs("x86_64-linux")  # where this type has 80 bits

callable_from_compiled(formulas.rounded_off)
hypot = compiled(formulas.hypot)


@numba.njit(error_model="numpy")
def in_machine_code(which, x, y):
    """Values of one of NAMES over arrays."""
    found = np.empty(x.size)
    for i in range(x.size):
        if which == 0:
            found[i] = sin_cos(x[i])[0]
        elif which == 1:
            found[i] = sin_cos(x[i])[1]
        elif which == 2:
            found[i] = exp(x[i])
        elif which == 3:
            found[i] = log(x[i])
        else:
            found[i] = hypot(x[i], y[i])
    return found


NAMES = ("sin", "cos", "exp", "log", "hypot")
IN_PYTHON = (
    lambda x, y: formulas.sin_cos(x)[0],
    lambda x, y: formulas.sin_cos(x)[1],
    lambda x, y: formulas.exp(x),
    lambda x, y: formulas.log(x),
    formulas.hypot,
)
IN_C = ("first_sin", "first_cos", "first_exp", "first_log", "elementary_hypot")


def true_values(name, at):
    x, y = at.x.astype(WIDE), at.y.astype(WIDE)
    return np.sqrt(x * x + y * y) if name == "hypot" else getattr(np, name)(x)


def error(found, true):
    """In units in the last place of the true values, which are wide numbers."""
    exponent = np.maximum(np.frexp(true)[1], -1021)
    return np.abs((found.astype(WIDE) - true) / np.ldexp(WIDE(1.0), exponent - 53)).astype(float)


@needs_wide
@pytest.mark.parametrize("name", NAMES)
def test_errors_are_below_the_stated_one(name):
    at = points(name)
    assert at.x.size >= COUNT
    errors = error(in_machine_code(NAMES.index(name), at.x, at.y), true_values(name, at))
    worst = int(np.argmax(errors))
    assert errors[worst] < LARGEST_ERROR, (at.x[worst], at.y[worst])
    assert errors.max() > 0.49, "the reference is not the function itself"


def error_of_one(found, true):
    """The same for one value in mpmath."""
    if true == 0:
        return abs(found)
    exponent = max(mpmath.frexp(true)[1], -1021)
    return float(abs(mpmath.mpf(found) - true) / mpmath.ldexp(1, exponent - 53))


def test_errors_near_multiples_of_a_quarter_turn():
    chance = np.random.default_rng(6)
    multiples = np.concatenate([np.arange(-64, 65), chance.integers(-636_619, 636_620, 1500)])
    with mpmath.workdps(60):
        x = within(neighbours([float(int(k) * mpmath.pi / 2) for k in multiples]), -1e6, 1e6)
        sines, cosines = (in_machine_code(which, x, x) for which in (0, 1))
        for angle, sine, cosine in zip(x.tolist(), sines.tolist(), cosines.tolist(), strict=True):
            assert error_of_one(sine, mpmath.sin(angle)) < LARGEST_ERROR, angle
            assert error_of_one(cosine, mpmath.cos(angle)) < LARGEST_ERROR, angle


OUTSIDE = np.array(
    [math.nan, math.inf, -math.inf, 1e300, -1e300, 1.1e6, -1.1e6, -708.5, 709.5, 0.0, -0.0, -1.0, 5e-324, 2e-308]
)
"""Beyond the range of one function or another."""


def test_values_outside_the_ranges():
    nan, inf = math.nan, math.inf
    for x in (nan, inf, -inf, math.nextafter(formulas.ANGLE_MAX, inf), -1.1e6):
        assert all(map(math.isnan, formulas.sin_cos(x)))
    assert [formulas.exp(x) for x in (-inf, -708.5, 709.5, inf)] == [0.0, 0.0, inf, inf]
    assert math.isnan(formulas.exp(nan)) and formulas.exp(0.0) == 1.0
    for x in (nan, inf, 0.0, -0.0, -1.0, 2e-308):
        assert math.isnan(formulas.log(x))
    assert formulas.log(1.0) == 0.0 and formulas.hypot(0.0, 0.0) == 0.0
    assert formulas.hypot(-3.0, 4.0) == 5.0 and math.isnan(formulas.hypot(nan, 1.0))
    assert formulas.sin_cos(0.0) == (0.0, 1.0)


def assert_same_bits(found, wanted, x):
    """All bits of numbers; of what is none, only that it is none."""
    both_nan = np.isnan(found) & np.isnan(wanted)
    same = (found.view(np.int64) == wanted.view(np.int64)) | both_nan
    assert same.all(), [(float(x[i]), found[i], wanted[i]) for i in np.flatnonzero(~same)[:3]]


def with_outside(at):
    return Points(np.concatenate([OUTSIDE, at.x]), np.concatenate([OUTSIDE[::-1], at.y]))


@pytest.mark.parametrize("name", NAMES)
def test_machine_code_has_the_bits_of_python(name):
    at = with_outside(points(name))
    few = np.r_[:50, 50 : at.x.size : 40]
    at = Points(at.x[few], at.y[few])
    which = NAMES.index(name)
    with np.errstate(all="ignore"):
        in_python = np.array([IN_PYTHON[which](x, y) for x, y in zip(at.x.tolist(), at.y.tolist(), strict=True)])
    assert_same_bits(in_machine_code(which, at.x, at.y), in_python, at.x)


def library(compiler, folder):
    """The functions of ``elementary.h`` as the builders compile them."""
    file = folder / "elementary.so"
    run_compiler([*compiler, *FLAGS, f"-I{C_INTERFACE}", "-o", str(file), str(STUB), "-lm"], file)
    return ctypes.CDLL(str(file))


def in_c(functions, name, at):
    """Values of one of its functions over arrays."""
    found = np.empty_like(at.x)
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (at.x, at.y, found)]
    getattr(functions, f"all_{name}")(ctypes.c_size_t(at.x.size), *pointers)
    return found


@pytest.fixture(scope="module")
def own_library(tmp_path_factory):
    return library(build_fmus.find_compiler(), tmp_path_factory.mktemp("elementary"))


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", NAMES)
def test_c_has_the_bits_of_machine_code(name, own_library):
    at, which = with_outside(points(name)), NAMES.index(name)
    assert_same_bits(in_c(own_library, IN_C[which], at), in_machine_code(which, at.x, at.y), at.x)


LARGEST_ERROR_OF_TANH = 2.0 * 2.0**-52
"""Absolute."""


@pytest.mark.needs("compiler")
@needs_wide
def test_error_of_the_hyperbolic_tangent(own_library):
    chance = np.random.default_rng(7)
    x = np.concatenate([chance.uniform(-1.0, 1.0, COUNT // 2), chance.uniform(-25.0, 25.0, COUNT // 2), OUTSIDE[1:5]])
    found = in_c(own_library, "first_tanh", Points(x, x))
    assert np.abs(found - np.tanh(x.astype(WIDE))).max() < LARGEST_ERROR_OF_TANH
    special = np.array([math.nan, math.inf, -math.inf, 0.0, -0.0])
    found = in_c(own_library, "first_tanh", Points(special, special))
    assert np.isnan(found[0]) and found[1:].tolist() == [1.0, -1.0, 0.0, 0.0] and np.signbit(found[4])


@pytest.mark.needs("compiler")
@needs_wide
def test_error_of_the_power(own_library):
    chance = np.random.default_rng(8)
    x = np.exp(chance.uniform(-20.0, 20.0, COUNT))
    power = chance.uniform(-30.0, 30.0, COUNT)
    true = x.astype(WIDE) ** power.astype(WIDE)
    allowed = 2.0 * (1.0 + np.abs(power * np.log(x)))
    assert (error(in_c(own_library, "elementary_pow", Points(x, power)), true) < allowed).all()
    bad = Points(np.array([-1.0, 0.0, math.nan, math.inf]), np.full(4, 2.0))
    assert np.isnan(in_c(own_library, "elementary_pow", bad)).all()
