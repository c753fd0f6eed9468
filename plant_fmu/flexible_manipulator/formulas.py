"""Sine, cosine, exponential, logarithm and length from exact operations, the same bits on every platform.

The functions of C libraries differ in their last bits. Those here are made of +, -, *, / and the square root, which
IEEE 754 defines to the last bit, of powers of two, and of comparisons; no product and sum may be fused.
controller_fmu/c_interface/elementary.h has the same formulas in C. Errors are below 0.9 units in the last place (ulp)
over the stated ranges (tests/test_elementary.py). The coefficients are computed by
benchmarks/elementary_coefficients.py; the reductions are those of Cody and Waite, Software Manual for the Elementary
Functions (1980).

:mod:`.elementary` has them compiled.
"""

from __future__ import annotations

import math

ANGLE_MAX = 1e6
"""Largest size of an angle [rad] for :func:`sin_cos`."""

EXP_MIN, EXP_MAX = -708.0, 709.0
"""Between them :func:`exp` is within its error; below it is 0, above infinite."""

LOG_MIN, LOG_MAX = 2.2250738585072014e-308, 1.7976931348623157e308
"""Range of :func:`log`: positive normal numbers."""

ROUND = 6755399441055744.0
"""1.5 * 2^52: added and subtracted again, it rounds to the nearest whole number."""

PI_2_1, PI_2_2, PI_2_3 = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
"""pi / 2 in parts, the first two of 33 bits."""

TWO_PER_PI = 0.6366197723675814
LN_2_1, LN_2_2 = 0.6931471803691238, 1.9082149292705877e-10
"""ln 2 in two parts, the first of 32 bits."""

PART_1, PART_2 = 0.01083042469326756, 2.9815858269852933e-12
"""ln 2 / 64 in two parts, the first of 32 bits."""

PER_PART = 92.33248261689366

POWERS = (
    1.0,
    1.0108892860517005,
    1.0218971486541166,
    1.0330248790212284,
    1.0442737824274138,
    1.0556451783605572,
    1.0671404006768237,
    1.0787607977571199,
    1.0905077326652577,
    1.102382583307841,
    1.1143867425958924,
    1.1265216186082418,
    1.1387886347566916,
    1.1511892299529827,
    1.1637248587775775,
    1.1763969916502812,
    1.189207115002721,
    1.202156731452703,
    1.215247359980469,
    1.22848053610687,
    1.241857812073484,
    1.255380757024691,
    1.2690509571917332,
    1.2828700160787783,
    1.2968395546510096,
    1.3109612115247644,
    1.3252366431597413,
    1.339667524053303,
    1.3542555469368927,
    1.3690024229745905,
    1.383909881963832,
    1.3989796725383112,
    1.4142135623730951,
    1.42961333839197,
    1.4451808069770467,
    1.460917794180647,
    1.4768261459394993,
    1.4929077282912648,
    1.5091644275934228,
    1.5255981507445384,
    1.5422108254079407,
    1.559004400237837,
    1.5759808451078865,
    1.593142151342267,
    1.6104903319492543,
    1.6280274218573478,
    1.645755478153965,
    1.6636765803267364,
    1.681792830507429,
    1.7001063537185235,
    1.718619298122478,
    1.7373338352737062,
    1.7562521603732995,
    1.7753764925265212,
    1.7947090750031072,
    1.8142521755003989,
    1.8340080864093424,
    1.8539791250833855,
    1.8741676341103,
    1.8945759815869656,
    1.9152065613971474,
    1.9360617934922943,
    1.9571441241754002,
    1.978456026387951,
)
"""2^(i / 64), rounded."""

POWERS_REST = (
    0.0,
    -1.5234778603368577e-17,
    5.109225028973444e-17,
    7.600838874027088e-18,
    8.551889705537965e-17,
    1.759325738772092e-18,
    -7.899853966841582e-17,
    -6.656660436056593e-17,
    -3.046782079812471e-17,
    5.2660368715706944e-17,
    1.0410278456845571e-16,
    5.165856758795457e-17,
    8.912812676025408e-17,
    3.250710218863827e-17,
    3.8292048369240935e-17,
    5.554203254218079e-17,
    3.982015231465646e-17,
    6.644981499252301e-17,
    -7.712630692681488e-17,
    -1.89878163130253e-17,
    4.658027591836937e-17,
    -6.7113898212968784e-18,
    2.667932131342186e-18,
    1.713594918243561e-17,
    2.5382502794888315e-17,
    -7.181536135519454e-17,
    -2.8587312100388614e-17,
    8.927282594831732e-17,
    7.70094837980299e-17,
    9.593797919118849e-17,
    -6.770511658794786e-17,
    -9.614213209051323e-17,
    -9.667293313452913e-17,
    -1.2031642489053655e-17,
    -3.0237581349939873e-17,
    -5.600377186075216e-17,
    -3.483994556892796e-17,
    1.4192920154284036e-17,
    -1.016455327754295e-16,
    -1.1024941712342561e-16,
    7.949834809697621e-17,
    3.7812070533575275e-17,
    -1.0136916471278304e-17,
    -1.0094406542311964e-16,
    2.4707192569797888e-17,
    -6.712955084707084e-17,
    -1.0125679913674773e-16,
    5.8909926967131e-17,
    8.199010020581497e-17,
    -8.0237193703977e-18,
    -1.851380418263111e-17,
    3.164389299292957e-17,
    2.960140695448873e-17,
    6.429731796556572e-17,
    1.8227458427912087e-17,
    -9.969531538920349e-17,
    3.283107224245627e-17,
    9.761887490727594e-17,
    -6.122763413004143e-17,
    3.4034035352165297e-17,
    -1.0619946056195963e-16,
    1.0332385960676326e-16,
    8.960767791036668e-17,
    4.0388753109278167e-17,
)
"""What was rounded off."""

SQRT_1_2 = 0.7071067811865476
SPLIT = 134217729.0
"""2^27 + 1, with which Veltkamp's method splits a number in two halves."""


def sin_cos(x: float) -> tuple[float, float]:
    """``(sin x, cos x)`` for an angle ``x`` [rad] of at most ANGLE_MAX; not a number beyond."""
    if not abs(x) <= ANGLE_MAX:
        return math.nan, math.nan
    # x = k pi / 2 + (y + tail), the products of k and the first two parts being exact
    k = (x * TWO_PER_PI + ROUND) - ROUND
    first, second = x - k * PI_2_1, k * PI_2_2
    near = first - second  # exact where |second| > |first|, so that Fast2Sum gives what is rounded off in all cases
    tail = -(second + (near - first)) - k * PI_2_3
    y = near + tail
    tail = (near - y) + tail
    z = y * y
    odd = -2.5052106232447578e-08 + z * (1.6058531618986147e-10 + z * -7.586697117706918e-13)
    odd = -0.00019841269841265065 + z * (2.7557319219339167e-06 + z * odd)
    odd = -0.16666666666666666 + z * (0.008333333333333331 + z * odd)
    even = -2.7557317271729793e-07 + z * (2.08761462684032e-09 + z * -1.1382632425521717e-11)
    even = -0.0013888888888887398 + z * (2.480158729876569e-05 + z * even)
    even = 0.041666666666666664 + z * even
    half = 0.5 * z
    sine = y + (y * z * odd + tail * (1.0 - half))
    rest = 1.0 - half
    cosine = rest + (((1.0 - rest) - half) + (z * z * even - y * tail))
    quarter = int(k) & 3
    if quarter == 0:
        return sine, cosine
    if quarter == 1:
        return cosine, -sine
    if quarter == 2:
        return -sine, -cosine
    return -cosine, sine


def exp(x: float) -> float:
    """e^x."""
    if not EXP_MIN <= x <= EXP_MAX:
        return x if x != x else (0.0 if x < 0.0 else math.inf)
    k = (x * PER_PART + ROUND) - ROUND
    r = (x - k * PART_1) - k * PART_2
    rest = (0.49999999999985073 + 0.16666666666664534 * r) + r * r * (0.04166670739519196 + 0.008333339151693497 * r)
    whole = int(k)
    power = POWERS[whole & 63]
    return (power + (POWERS_REST[whole & 63] + power * (r + r * r * rest))) * power_of_two(whole >> 6)


def power_of_two(k: int) -> float:
    """2^k for -1022 <= k <= 1023, which are normal numbers."""
    return math.ldexp(1.0, k)


def log(x: float) -> float:
    """Natural logarithm of ``x`` in [LOG_MIN, LOG_MAX]; not a number outside."""
    if not LOG_MIN <= x <= LOG_MAX:
        return math.nan
    fraction, k = math.frexp(x)
    if fraction < SQRT_1_2:
        fraction, k = 2.0 * fraction, k - 1
    f = fraction - 1.0
    s = f / (2.0 + f)
    z = s * s
    rest = 0.18182889125261723 + z * (0.15331721600556042 + z * 0.14616449685043406)
    rest = 0.39999999999899505 + z * (0.28571428625975487 + z * (0.2222221113479508 + z * rest))
    rest = z * (0.666666666666667 + z * rest)
    half = 0.5 * f * f
    return k * LN_2_1 - ((half - (s * (half + rest) + k * LN_2_2)) - f)


def hypot(x: float, y: float) -> float:
    """sqrt(x^2 + y^2) for sizes that are 0 or between 1e-140 and 1e140."""
    p, q = x * x, y * y
    total = p + q
    root = math.sqrt(total)
    if not root > 0.0:
        return root
    # One step of Newton's method with what was rounded off in the squares, their sum and the square of the root
    back = total - p
    lost = (p - (total - back)) + (q - back)
    square = root * root
    rest = ((total - square) - rounded_off(root, square)) + (lost + rounded_off(x, p) + rounded_off(y, q))
    return root + rest / (2.0 * root)


def rounded_off(x: float, square: float) -> float:
    """x^2 - ``square`` exactly, where ``square`` is x * x rounded (Dekker)."""
    scaled = SPLIT * x
    high = scaled - (scaled - x)
    low = x - high
    return ((high * high - square) + 2.0 * high * low) + low * low
