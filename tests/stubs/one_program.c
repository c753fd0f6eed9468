/* The program of controller_fmu/closed_loop from a command line: one_program FILE.
 *
 * tests/support/one_program.py writes the FILE: cases one after the other, for each the count of its numbers and their
 * bits in hexadecimal. For each case a line is printed: the hash of its trajectory, and the bits of its outcome. In the
 * hash are, of each sample, the torque disturbance u_d, then the angles q_m and the position X at its end, and the
 * torques that the controller asks for. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "case.h"

static uint64_t number(FILE *file)
{
    uint64_t value;
    if (fscanf(file, "%" SCNx64, &value) != 1) exit(4);
    return value;
}

static uint64_t bits(double value)
{
    uint64_t word;
    memcpy(&word, &value, sizeof word);
    return word;
}

/* FNV-1a over words of 64 bits. */
static void add(uint64_t *hash, const double pair[2])
{
    for (int i = 0; i < 2; i++)
        *hash = (*hash ^ bits(pair[i])) * UINT64_C(0x100000001b3);
}

int main(int count, char *arguments[])
{
    FILE *file = count == 2 ? fopen(arguments[1], "r") : NULL;
    if (!file) return 2;
    for (uint64_t left = number(file); left > 0; left--) {
        const uint64_t numbers = number(file);
        for (uint64_t i = 0; i < numbers; i++) {
            const uint64_t word = number(file);
            if (i < BLOCK) memcpy(&block[i], &word, sizeof word);
        }
        simulate_case();
        uint64_t hash = UINT64_C(0xcbf29ce484222325);
        for (long k = 0; k < record.sample; k++) {
            add(&hash, record.u_d[k]);
            add(&hash, record.q_m[k + 1]);
            add(&hash, record.X[k + 1]);
            add(&hash, record.command[k]);
        }
        printf("%016" PRIx64, hash);
        const double *values = (const double *)&outcome;
        for (size_t i = 0; i < sizeof outcome / sizeof *values; i++)
            printf(" %016" PRIx64, bits(values[i]));
        printf("\n");
    }
    fclose(file);
    return 0;
}
