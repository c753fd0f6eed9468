/* Sine, cosine, exponential, logarithm, length and hyperbolic tangent from exact operations, the same bits on every
 * platform: twin of plant_fmu/flexible_manipulator/formulas.py, where ranges, errors and sources are told.
 *
 * Compile without contraction to fused multiply-add (-ffp-contract=off) and without fast-math. There are no branches, so that
 * compilers can compute several numbers side by side.
 */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#ifndef LANES /* benchmarks/lanes_cpp computes eight arms side by side from the same sources: its numbers have these of their own */
static inline double choose(bool condition, double then, double otherwise) { return condition ? then : otherwise; }

static inline bool any(bool condition) { return condition; }

/* What is the same for all of them, and one of 64. No function: with one, GCC 12 no longer computes several exponentials side by
 * side, and a step of the plant takes 11 % longer. */
typedef double Constant;

#define entry(table, at) (table)[at]
#endif

static const double ELEMENTARY_ROUND = 6755399441055744.0; /* 1.5 * 2^52 */
static const double ELEMENTARY_ANGLE_MAX = 1e6, ELEMENTARY_EXP_MIN = -708.0, ELEMENTARY_EXP_MAX = 709.0;
static const double ELEMENTARY_LN_2_1 = 0.6931471803691238, ELEMENTARY_LN_2_2 = 1.9082149292705877e-10;

/* 2^(i / 64), rounded, and what was rounded off. */
static const Constant ELEMENTARY_POWERS[64] = {
    1.0, 1.0108892860517005, 1.0218971486541166, 1.0330248790212284, 1.0442737824274138, 1.0556451783605572,
    1.0671404006768237, 1.0787607977571199, 1.0905077326652577, 1.102382583307841, 1.1143867425958924,
    1.1265216186082418, 1.1387886347566916, 1.1511892299529827, 1.1637248587775775, 1.1763969916502812,
    1.189207115002721, 1.202156731452703, 1.215247359980469, 1.22848053610687, 1.241857812073484, 1.255380757024691,
    1.2690509571917332, 1.2828700160787783, 1.2968395546510096, 1.3109612115247644, 1.3252366431597413,
    1.339667524053303, 1.3542555469368927, 1.3690024229745905, 1.383909881963832, 1.3989796725383112,
    1.4142135623730951, 1.42961333839197, 1.4451808069770467, 1.460917794180647, 1.4768261459394993, 1.4929077282912648,
    1.5091644275934228, 1.5255981507445384, 1.5422108254079407, 1.559004400237837, 1.5759808451078865,
    1.593142151342267, 1.6104903319492543, 1.6280274218573478, 1.645755478153965, 1.6636765803267364, 1.681792830507429,
    1.7001063537185235, 1.718619298122478, 1.7373338352737062, 1.7562521603732995, 1.7753764925265212,
    1.7947090750031072, 1.8142521755003989, 1.8340080864093424, 1.8539791250833855, 1.8741676341103, 1.8945759815869656,
    1.9152065613971474, 1.9360617934922943, 1.9571441241754002, 1.978456026387951,
};
static const Constant ELEMENTARY_POWERS_REST[64] = {
    0.0, -1.5234778603368577e-17, 5.109225028973444e-17, 7.600838874027088e-18, 8.551889705537965e-17,
    1.759325738772092e-18, -7.899853966841582e-17, -6.656660436056593e-17, -3.046782079812471e-17,
    5.2660368715706944e-17, 1.0410278456845571e-16, 5.165856758795457e-17, 8.912812676025408e-17, 3.250710218863827e-17,
    3.8292048369240935e-17, 5.554203254218079e-17, 3.982015231465646e-17, 6.644981499252301e-17, -7.712630692681488e-17,
    -1.89878163130253e-17, 4.658027591836937e-17, -6.7113898212968784e-18, 2.667932131342186e-18, 1.713594918243561e-17,
    2.5382502794888315e-17, -7.181536135519454e-17, -2.8587312100388614e-17, 8.927282594831732e-17,
    7.70094837980299e-17, 9.593797919118849e-17, -6.770511658794786e-17, -9.614213209051323e-17, -9.667293313452913e-17,
    -1.2031642489053655e-17, -3.0237581349939873e-17, -5.600377186075216e-17, -3.483994556892796e-17,
    1.4192920154284036e-17, -1.016455327754295e-16, -1.1024941712342561e-16, 7.949834809697621e-17,
    3.7812070533575275e-17, -1.0136916471278304e-17, -1.0094406542311964e-16, 2.4707192569797888e-17,
    -6.712955084707084e-17, -1.0125679913674773e-16, 5.8909926967131e-17, 8.199010020581497e-17, -8.0237193703977e-18,
    -1.851380418263111e-17, 3.164389299292957e-17, 2.960140695448873e-17, 6.429731796556572e-17, 1.8227458427912087e-17,
    -9.969531538920349e-17, 3.283107224245627e-17, 9.761887490727594e-17, -6.122763413004143e-17,
    3.4034035352165297e-17, -1.0619946056195963e-16, 1.0332385960676326e-16, 8.960767791036668e-17,
    4.0388753109278167e-17,
};

static inline uint64_t elementary_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline double elementary_number(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* Of an angle [rad] of at most ELEMENTARY_ANGLE_MAX. */
static inline void elementary_sin_cos_within(double x, double *sine, double *cosine)
{
    const double shifted = x * 0.6366197723675814 + ELEMENTARY_ROUND, k = shifted - ELEMENTARY_ROUND;
    const double first = x - k * 1.5707963267341256, second = k * 6.077100506303966e-11;
    const double near = first - second, lost = -(second + (near - first)) - k * 2.0222662487959506e-21;
    const double y = near + lost, tail = (near - y) + lost, z = y * y;
    const double odd_3 =
        -0.00019841269841265065 +
        z * (2.7557319219339167e-06 +
             z * (-2.5052106232447578e-08 + z * (1.6058531618986147e-10 + z * -7.586697117706918e-13)));
    const double odd = -0.16666666666666666 + z * (0.008333333333333331 + z * odd_3);
    const double even_2 = 2.480158729876569e-05 +
                          z * (-2.7557317271729793e-07 + z * (2.08761462684032e-09 + z * -1.1382632425521717e-11));
    const double even = 0.041666666666666664 + z * (-0.0013888888888887398 + z * even_2);
    const double half = 0.5 * z, rest = 1.0 - half;
    const uint64_t s = elementary_bits(y + (y * z * odd + tail * (1.0 - half)));
    const uint64_t c = elementary_bits(rest + (((1.0 - rest) - half) + (z * z * even - y * tail)));
    /* The last bits of `shifted` are those of k: odd quarters exchange the two, and signs follow. */
    const uint64_t quarter = elementary_bits(shifted), swap = 0 - (quarter & 1), other = (s ^ c) & swap;
    *sine = elementary_number(s ^ other ^ (quarter & 2) << 62);
    *cosine = elementary_number(c ^ other ^ ((quarter + 1) & 2) << 62);
}

static inline void elementary_sin_cos(double x, double *sine, double *cosine)
{
    elementary_sin_cos_within(x, sine, cosine);
    const bool within = fabs(x) <= ELEMENTARY_ANGLE_MAX;
    *sine = choose(within, *sine, NAN);
    *cosine = choose(within, *cosine, NAN);
}

static inline double elementary_sin(double x)
{
    double sine, cosine;
    elementary_sin_cos(x, &sine, &cosine);
    return sine;
}

static inline double elementary_cos(double x)
{
    double sine, cosine;
    elementary_sin_cos(x, &sine, &cosine);
    return cosine;
}

/* Of x between ELEMENTARY_EXP_MIN and ELEMENTARY_EXP_MAX. */
static inline double elementary_exp_within(double x)
{
    const double shifted = x * 92.33248261689366 + ELEMENTARY_ROUND, k = shifted - ELEMENTARY_ROUND;
    const double r = (x - k * 0.01083042469326756) - k * 2.9815858269852933e-12;
    const double rest =
        (0.49999999999985073 + 0.16666666666664534 * r) + r * r * (0.04166670739519196 + 0.008333339151693497 * r);
    /* The last bits of `shifted` are those of k. */
    const uint64_t bits = elementary_bits(shifted), part = bits & 63;
    const double power = entry(ELEMENTARY_POWERS, part), power_of_two = elementary_number(((bits >> 6) + 1023) << 52);
    return (power + (entry(ELEMENTARY_POWERS_REST, part) + power * (r + r * r * rest))) * power_of_two;
}

static inline double elementary_exp(double x)
{
    const double within = choose(x > ELEMENTARY_EXP_MAX, INFINITY, elementary_exp_within(x));
    return choose(x < ELEMENTARY_EXP_MIN, 0.0, within);
}

/* Of a positive normal number; not a number otherwise. */
static inline double elementary_log(double x)
{
    const bool normal = x >= 2.2250738585072014e-308 && x <= 1.7976931348623157e308;
    const uint64_t bits = elementary_bits(x), mantissa = bits & 0xfffffffffffff;
    const double half_to_1 = elementary_number(mantissa | (uint64_t)1022 << 52);
    /* As the last bits of 2^52, the exponent is a number. */
    const double exponent = elementary_number(bits >> 52 | (uint64_t)1075 << 52) - (4503599627370496.0 + 1022.0);
    const bool low = half_to_1 < 0.7071067811865476;
    const double fraction = choose(low, 2.0 * half_to_1, half_to_1), k = choose(low, exponent - 1.0, exponent);
    const double f = fraction - 1.0, s = f / (2.0 + f), z = s * s;
    const double rest_3 =
        0.2222221113479508 + z * (0.18182889125261723 + z * (0.15331721600556042 + z * 0.14616449685043406));
    const double rest =
        z * (0.666666666666667 + z * (0.39999999999899505 + z * (0.28571428625975487 + z * rest_3)));
    const double half = 0.5 * f * f;
    return choose(normal, k * ELEMENTARY_LN_2_1 - ((half - (s * (half + rest) + k * ELEMENTARY_LN_2_2)) - f), NAN);
}

/* x^2 - square exactly, where square is x * x rounded (Dekker). */
static inline double elementary_rounded_off(double x, double square)
{
    const double scaled = 134217729.0 * x, high = scaled - (scaled - x), low = x - high;
    return ((high * high - square) + 2.0 * high * low) + low * low;
}

static inline double elementary_hypot(double x, double y)
{
    const double p = x * x, q = y * y, total = p + q, root = sqrt(total);
    const double back = total - p, lost = (p - (total - back)) + (q - back), square = root * root;
    const double rest = ((total - square) - elementary_rounded_off(root, square)) +
                        (lost + elementary_rounded_off(x, p) + elementary_rounded_off(y, q));
    return choose(root > 0.0, root + rest / (2.0 * root), root);
}

/* Error below 2 units of the last place of 1. */
static inline double elementary_tanh(double x)
{
    const double fast = elementary_exp(-2.0 * fabs(x));
    return copysign((1.0 - fast) / (1.0 + fast), x);
}

/* x to a power, for x > 0: within 2 (1 + |power log x|) units in the last place. */
static inline double elementary_pow(double x, double power) { return elementary_exp(power * elementary_log(x)); }

#endif
