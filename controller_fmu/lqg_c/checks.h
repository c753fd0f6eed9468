/* What a model of the LQG refuses: parameters out of their range, and steps that are none of its samples. */
#ifndef CHECKS_H
#define CHECKS_H

#include <math.h>
#include <stdio.h>

#include "interface.h" /* written by the build: Variables, RANGES */
#include "model.h"

static const double STEP_TOLERANCE = 1e-9;

static bool check(const Variables *of, char message[MODEL_MESSAGE_SIZE])
{
    if (!(of->T_s > 0.0 && isfinite(of->T_s))) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "parameter T_s = %.17g s: the sample time must be positive and finite", of->T_s);
        return false;
    }
    for (size_t i = 0; i < sizeof RANGES / sizeof *RANGES; i++) {
        const double value = ((const double *)of)[RANGES[i].reference];
        if (value >= RANGES[i].least && isfinite(value)) continue;
        snprintf(message, MODEL_MESSAGE_SIZE, "parameter %s = %.17g %s: it must be finite and at least %g",
                 RANGES[i].name, value, RANGES[i].unit, RANGES[i].least);
        return false;
    }
    return true;
}

static bool check_step(double T_s, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    if (fabs(h - T_s) <= STEP_TOLERANCE * T_s) return true;
    snprintf(message, MODEL_MESSAGE_SIZE,
             "step of %.17g s at t = %.17g s refused: the communication step must equal the sample time "
             "T_s = %.17g s",
             h, t, T_s);
    return false;
}

#endif
