/* What the random calls of all FMI versions share: numbers, arrays that end where they say, and the watch over each call:
 * its processor time, its status, its message. */
#ifndef HARNESS_H
#define HARNESS_H

#include <math.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include "fmu.h" /* written by the test from the model description */

enum { LIMIT_SECONDS = 1, KEPT_STATES = 4, STATUS_OK = 0, STATUS_DISCARD = 2, STATUS_ERROR = 3 };

/* ---- Random numbers: splitmix64 (Steele, Lea, Flood), the same on all machines ---- */

static uint64_t seed;

static uint64_t next_random(void)
{
    uint64_t z = seed += 0x9e3779b97f4a7c15;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9;
    z = (z ^ z >> 27) * 0x94d049bb133111eb;
    return z ^ z >> 31;
}

static size_t below(size_t n) { return (size_t)(next_random() % n); }
static bool one_in(size_t n) { return below(n) == 0; }
static double uniformly(double least, double most) { return least + (most - least) * ((double)(next_random() >> 11) * 0x1p-53); }

/* Any number at all, those that go wrong more often than others. */
static double any_number(void)
{
    static const double notable[] = {0.0,   -0.0,  1.0,   -1.0,   STEP_SIZE, 2.0 * STEP_SIZE, 0.5 * STEP_SIZE, -STEP_SIZE,
                                     1e-9,  1e300, -1e300, 1e12,  1e6,       5e-324,          4294967295.0,    1e9};
    switch (below(8)) {
    case 0: return NAN;
    case 1: return one_in(2) ? INFINITY : -INFINITY;
    case 2: case 3: case 4: return notable[below(sizeof notable / sizeof *notable)];
    case 5: {
        const uint64_t bits = next_random();
        double number;
        memcpy(&number, &bits, sizeof number);
        return number;
    }
    default: return uniformly(-10.0, 10.0);
    }
}

/* ---- Arrays on the heap, so that AddressSanitizer sees what is read or written beyond them ---- */

static void *block(size_t bytes)
{
    void *memory = malloc(bytes ? bytes : 1);
    if (!memory) abort();
    return memset(memory, 0xa5, bytes);
}

/* ---- The watch ---- */

static const char *function = "";
static unsigned long calls, errors, messages;
static double longest;
static const char *longest_function = "";
static struct timespec begun;

static void fail(const char *what)
{
    fprintf(stderr, "%s: %s (call %lu)\n", function, what, calls);
    exit(1);
}

static void too_long(int number)
{
    static const char text[] = ": the call took more than 1 s of processor time\n";
    if (write(2, function, strlen(function)) < 0 || write(2, text, sizeof text - 1) < 0) _exit(4);
    _exit(3);
}

static void begin_call(const char *name)
{
    static const struct itimerval limit = {.it_value = {.tv_sec = LIMIT_SECONDS}};
    function = name;
    calls++;
    setitimer(ITIMER_PROF, &limit, NULL);
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begun);
}

static void end_call(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    const double taken = (double)(now.tv_sec - begun.tv_sec) + 1e-9 * (double)(now.tv_nsec - begun.tv_nsec);
    if (taken > longest) longest = taken, longest_function = function;
}

/* Takes a message of the FMU, which must be one for the format of a logger. */
static void note_message(const char *message)
{
    messages++;
    if (!message || !*message) fail("the message is empty");
    if (strchr(message, '%')) fail("the message contains a format");
}

static unsigned long messages_before;
static void *passed; /* the instance that the call gets */

static int judged(int status, bool logs)
{
    end_call();
    errors += status == STATUS_ERROR;
    if (status != STATUS_OK && status != STATUS_DISCARD && status != STATUS_ERROR) fail("no status that the FMU has");
    if (!passed && status != STATUS_ERROR) fail("no error without an instance");
    if (passed && logs && status == STATUS_ERROR && messages == messages_before) fail("an error without a message");
    return status;
}

/* Calls a function of the standard that returns a status. */
#define CALL(name, ...) (begin_call(#name), messages_before = messages, judged((int)name(__VA_ARGS__), of->logs))

/* ---- An instance, and what is done to it ---- */

typedef struct {
    void *c;
    bool logs;                  /* it was instantiated with a logger that is switched on */
    bool legal;                 /* the next call gets arguments that are allowed in the right state */
    void *states[KEPT_STATES];  /* saved, NULL where there is none */
    unsigned char *bytes;       /* of a serialized state, NULL if there is none */
    size_t size;
} Instance;

typedef int Operation(Instance *of);

typedef struct {
    const char *name;
    Operation *call;
} Named;

/* The instance, or none at all. */
static void *self(const Instance *of) { return passed = of->legal || !one_in(50) ? of->c : NULL; }

/* A time, the right one where the call is to be legal [s]. */
static double some_time(const Instance *of)
{
    if (of->legal || one_in(2)) return ((Component *)of->c)->memory->time;
    return any_number();
}

static double some_step(const Instance *of) { return of->legal || one_in(2) ? STEP_SIZE : any_number(); }

/* ---- Value references and values ---- */

typedef struct {
    unsigned *references;
    size_t n, n_values;
    double *values;
    void *freed[2];
} Values;

static size_t extent_of(unsigned reference) { return reference < REFERENCES ? EXTENTS[reference] : 0; }

/* Of one of the listed variables, or of anything; in FMI 1 and 2 the two numbers are one. */
static Values some_values(const Instance *of, const unsigned listed[], size_t count)
{
    Values v = {.n = of->legal ? 1 : below(5)};
    v.references = v.freed[0] = block(v.n * sizeof(unsigned));
    for (size_t i = 0; i < v.n; i++) {
        v.references[i] = (of->legal || !one_in(3)) && count ? listed[below(count)] : (unsigned)below(REFERENCES + 3);
        if (!of->legal && one_in(20)) v.references[i] = (unsigned)next_random();
        v.n_values += FMI_VERSION == 3 ? extent_of(v.references[i]) : 1;
    }
    if (FMI_VERSION == 3 && !of->legal && one_in(5)) v.n_values = below(8);
    v.values = v.freed[1] = block(v.n_values * sizeof(double));
    const bool wild = !of->legal && one_in(2);
    for (size_t i = 0; i < v.n_values; i++)
        v.values[i] = wild ? any_number() : uniformly(-0.1, 0.1);
    if (!of->legal && one_in(20)) v.references = NULL;
    if (!of->legal && one_in(20)) v.values = NULL;
    return v;
}

static void free_values(Values v)
{
    free(v.freed[0]);
    free(v.freed[1]);
}

/* Where a result goes, or NULL. */
static void *result(const Instance *of, void *address) { return of->legal || !one_in(10) ? address : NULL; }

/* ---- Saved states ---- */

/* What is no state of this FMU, but as long as the head of one. */
static uint64_t foreign[64];

static void **some_state(Instance *of) { return &of->states[below(KEPT_STATES)]; }

static void *some_saved(Instance *of)
{
    for (size_t i = 0; i < KEPT_STATES; i++)
        if (of->states[i] && (of->legal || one_in(2))) return of->states[i];
    return one_in(2) ? NULL : (void *)foreign;
}

static unsigned char *some_bytes(Instance *of, size_t *size)
{
    *size = of->size;
    if (!of->legal && one_in(3)) *size = below(2 * of->size + 2);
    unsigned char *bytes = block(*size);
    if (of->bytes) memcpy(bytes, of->bytes, *size < of->size ? *size : of->size);
    if (!of->legal && *size)
        for (size_t k = below(4); k > 0; k--)
            bytes[below(*size)] ^= (unsigned char)(1u << below(8));
    return bytes;
}

static void keep_bytes(Instance *of, unsigned char *bytes, size_t size)
{
    free(of->bytes);
    of->bytes = bytes;
    of->size = size;
}

#endif
