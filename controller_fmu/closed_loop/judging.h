/* What is read off a simulation, as in orchestrator/benchmark/metrics.py, one_pass.py and doubt.py, and with the same
 * bits: tests/test_playground.py compares every case of the protocols. */
#ifndef JUDGING_H
#define JUDGING_H

#include "closed_loop.h"

enum { DIRECTIONS = 32, WINDOWS = 100 /* at most */ };

/* The figures of a case; those that its test does not ask for, or that do not exist, are not a number. */
typedef enum {
    B1,
    B2,
    B3,
    B4,
    B5,
    B6,
    B7,
    SETTLED, /* 1 or 0 */
    LIMIT_CYCLE,
    LIMIT_CYCLE_RATIO,
    LIMIT_CYCLE_FREQUENCY,
    LIMIT_CYCLE_DECAY,
    LIMIT_CYCLE_AT_END,
    REST_ERROR,
    RECOVERY,
    RESIDUAL_VIBRATION,
    FIGURES
} Figure;

/* By what a case is judged, in the order in which a case begins with it: SI units, all numbers. */
typedef struct {
    double samples, latest;              /* of the case; and until which it may be simulated in doubt, 0: not further */
    double numerator, denominator;       /* of the sample time [s] */
    double ticks;                        /* steps of the plant in a sample */
    double abort_distance;
    double chirp_start, force_start, force_stop;
    double settling_error, recovery_error, rest_error, rest_window;
    double limit_cycle, limit_cycle_window, limit_cycle_windows, ring_down, doubtful, dying;
    double left;                         /* windows between the case's own end and the latest one */
    double asked;                        /* the figures that the test asks for, as bits */
} Rules;

/* By direction, the amplitudes in the last windows [m]. */
typedef struct {
    int windows;
    double of[DIRECTIONS][WINDOWS];
} Curves;

/* What a case came to at its end. */
typedef enum { QUIET, RING_DOWN, CYCLE, UNSTABLE, NO_REST, NO_VERDICT } Verdict;

/* Fill the figures from the record; `curves` has no windows where no limit cycle is looked for. */
void measure(const Rules *rules, double figures[FIGURES], Curves *curves);

/* Whether the case has to be simulated further. */
bool in_doubt(const Rules *rules, const double figures[FIGURES], const Curves *curves);

Verdict verdict(const Rules *rules, const double figures[FIGURES]);

#endif
