/* A case: a flat block of numbers that begins with the Rules, then has the parts as loop_begin reads them. */
#ifndef CASE_H
#define CASE_H

#include "judging.h"

enum { BLOCK = 16384 /* numbers */ };

typedef struct {
    double reason, verdict, time, judged_until; /* the end of what was simulated [s], and of the windows; else NaN */
    double figures[FIGURES];
} Outcome;

extern double block[BLOCK];
extern Outcome outcome;

/* The components of a force in a direction, as they stand in a block [N]. */
extern double force[2];
void force_of(double size, double phi_F);

/* Simulates and judges what the block says. The record stays until the next call. */
void simulate_case(void);

#endif
