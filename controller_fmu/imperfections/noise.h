/* The normal numbers of NumPy's frozen RandomState on PCG64 (O'Neill, 2014): 128-bit congruential generator, output
 * XSL-RR, then Marsaglia's polar method. Written with 64-bit words: not all compilers have longer ones. */
#ifndef NOISE_H
#define NOISE_H

#include <stdint.h>

#include "elementary.h"

typedef struct {
    uint64_t high, low;
} Wide;

static uint64_t high_product(uint64_t a, uint64_t b)
{
    const uint64_t a_0 = a & 0xffffffff, a_1 = a >> 32, b_0 = b & 0xffffffff, b_1 = b >> 32;
    const uint64_t first = a_1 * b_0 + (a_0 * b_0 >> 32), second = a_0 * b_1 + (first & 0xffffffff);
    return a_1 * b_1 + (first >> 32) + (second >> 32);
}

/* Uniform in [0, 1), with 53 bits. */
static double uniform(Wide *state, Wide increment)
{
    const Wide a = *state, b = {0x2360ed051fc65da4, 0x4385df649fccf645};
    state->low = a.low * b.low + increment.low;
    state->high = high_product(a.low, b.low) + a.high * b.low + a.low * b.high + increment.high;
    state->high += state->low < increment.low;
    const uint64_t mixed = state->high ^ state->low;
    const unsigned turn = (unsigned)(state->high >> 58);
    return (double)((mixed >> turn | mixed << ((64 - turn) & 63)) >> 11) / 9007199254740992.0;
}

/* Two independent standard normal numbers, in NumPy's order. */
static void normal_pair(Wide *state, Wide increment, double pair[2])
{
    double x[2], r_2;
    do {
        x[0] = 2.0 * uniform(state, increment) - 1.0;
        x[1] = 2.0 * uniform(state, increment) - 1.0;
        r_2 = x[0] * x[0] + x[1] * x[1];
    } while (r_2 >= 1.0 || r_2 == 0.0);
    const double f = sqrt(-2.0 * elementary_log(r_2) / r_2);
    pair[0] = f * x[1];
    pair[1] = f * x[0];
}

#endif
