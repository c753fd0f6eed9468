/* Closed loops of plant, imperfections and a controller in one program without any other software: closed_loop FILE.
 *
 * tests/support/one_program.py writes the FILE: cases one after the other, all numbers in hexadecimal, a double as its
 * bits. For each case a line with the hash of its trajectory is printed: of each sample the torque disturbance u_d, then
 * the angles q_m and the position X at its end, and the torques that the controller asks for. Values are exchanged in the order of docs/plant.md, in which the
 * result is that of the master loop. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "closed_loop.h"
#include "slaves.h" /* written with the units: SLAVES, the addresses of plant, imperfections, and the controllers */

enum { PLANT, IMPERFECTIONS, CONTROLLER, PARTS, PAIR = 2 };

static const Slave *const ALL[] = {SLAVES};

typedef struct {
    const Slave *slave;
    fmi2Component instance;
} Part;

/* Value references of pairs of variables. */
typedef struct {
    fmi2ValueReference from[PAIR], to[PAIR];
    int source, target;
} Line;

static void no_logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                      fmi2String message, ...)
{
    fprintf(stderr, "%s: %s\n", name, message);
}

static const fmi2CallbackFunctions HOST = {no_logger, calloc, free, NULL, NULL};

static void check(int status)
{
    if (status > fmi2Warning) {
        fprintf(stderr, "a call returned %d\n", status);
        exit(3);
    }
}

static uint64_t number(FILE *file)
{
    uint64_t value;
    if (fscanf(file, "%" SCNx64, &value) != 1) exit(4);
    return value;
}

static double real(FILE *file)
{
    const uint64_t bits = number(file);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* FNV-1a over words of 64 bits. */
static void add(uint64_t *hash, const double values[], int count)
{
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        *hash = (*hash ^ bits) * UINT64_C(0x100000001b3);
    }
}

static Part part(FILE *file)
{
    const Slave *slave = ALL[number(file)];
    const Part made = {slave, slave->instantiate("part", fmi2CoSimulation, slave->guid, "", &HOST, fmi2False, fmi2True)};
    if (!made.instance) exit(5);
    check(slave->setup(made.instance, fmi2False, 0.0, 0.0, fmi2False, 0.0));
    for (uint64_t left = number(file); left > 0; left--) {
        const fmi2ValueReference reference = (fmi2ValueReference)number(file);
        const double value = real(file);
        check(slave->set(made.instance, &reference, 1, &value));
    }
    check(slave->enter(made.instance));
    return made;
}

static void exchange(const Part parts[PARTS], const Line lines[], uint64_t count)
{
    for (uint64_t i = 0; i < count; i++) {
        double values[PAIR];
        const Part from = parts[lines[i].source], to = parts[lines[i].target];
        check(from.slave->get(from.instance, lines[i].from, PAIR, values));
        check(to.slave->set(to.instance, lines[i].to, PAIR, values));
    }
}

static void references(FILE *file, fmi2ValueReference of[PAIR])
{
    for (int i = 0; i < PAIR; i++)
        of[i] = (fmi2ValueReference)number(file);
}

static uint64_t simulated(FILE *file)
{
    const uint64_t samples = number(file), ticks = number(file);
    const double sample_time = real(file), tick = sample_time / (double)ticks;
    Part parts[PARTS];
    for (int i = 0; i < PARTS; i++)
        parts[i] = part(file);
    Line lines[16];
    const uint64_t count = number(file);
    for (uint64_t i = 0; i < count; i++) {
        lines[i].source = (int)number(file);
        references(file, lines[i].from);
        lines[i].target = (int)number(file);
        references(file, lines[i].to);
    }
    fmi2ValueReference q_m[PAIR], X[PAIR], u_c[PAIR], u_d[PAIR];
    references(file, q_m);
    references(file, X);
    references(file, u_c);
    references(file, u_d);

    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    exchange(parts, lines, count);
    for (int i = 0; i < PARTS; i++)
        check(parts[i].slave->leave(parts[i].instance));
    for (uint64_t k = 0; k < samples * ticks; k++) {
        double values[3 * PAIR];
        exchange(parts, lines, count);
        if (k % ticks == 0) {
            check(parts[IMPERFECTIONS].slave->get(parts[IMPERFECTIONS].instance, u_d, PAIR, values));
            add(&hash, values, PAIR);
        }
        for (int i = 0; i < PARTS; i++) {
            const double t = i == CONTROLLER ? (double)(k / ticks) * sample_time : (double)k * tick;
            if (i != CONTROLLER || k % ticks == 0)
                check(parts[i].slave->step(parts[i].instance, t, i == CONTROLLER ? sample_time : tick, fmi2True));
        }
        if ((k + 1) % ticks != 0) continue;
        check(parts[PLANT].slave->get(parts[PLANT].instance, q_m, PAIR, values));
        check(parts[PLANT].slave->get(parts[PLANT].instance, X, PAIR, values + PAIR));
        check(parts[CONTROLLER].slave->get(parts[CONTROLLER].instance, u_c, PAIR, values + 2 * PAIR));
        add(&hash, values, 3 * PAIR);
    }
    for (int i = 0; i < PARTS; i++)
        parts[i].slave->free(parts[i].instance);
    return hash;
}

int main(int count, char *arguments[])
{
    FILE *file = count == 2 ? fopen(arguments[1], "r") : NULL;
    if (!file) return 2;
    for (uint64_t left = number(file); left > 0; left--)
        printf("%016" PRIx64 "\n", simulated(file));
    fclose(file);
    return 0;
}
