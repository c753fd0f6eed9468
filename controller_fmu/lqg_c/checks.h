/* What a model of the LQG refuses: parameters out of their range, and torques that are no numbers. */
#ifndef CHECKS_H
#define CHECKS_H

#include <math.h>
#include <stdio.h>

#include "interface.h" /* written by the build: Variables, RANGES */
#include "model.h"

static inline bool check_ranges(const Variables *of, char message[MODEL_MESSAGE_SIZE])
{
    if (!(of->T_s > 0.0 && isfinite(of->T_s))) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "parameter T_s = %.15g s: the sample time must be positive and finite", of->T_s);
        return false;
    }
    for (size_t i = 0; i < sizeof RANGES / sizeof *RANGES; i++) {
        const double value = ((const double *)of)[RANGES[i].reference];
        if (value >= RANGES[i].least && isfinite(value)) continue;
        snprintf(message, MODEL_MESSAGE_SIZE, "parameter %s = %.15g %s: it must be finite and at least %g",
                 RANGES[i].name, value, RANGES[i].unit, RANGES[i].least);
        return false;
    }
    return true;
}

/* What limits would make a torque of. */
static inline bool check_torque(int axis, double u_m, double t, char message[MODEL_MESSAGE_SIZE])
{
    if (isfinite(u_m)) return true;
    snprintf(message, MODEL_MESSAGE_SIZE, "u_m[%d] = %g N.m at t = %.15g s: the torque must be finite", axis + 1, u_m,
             t);
    return false;
}

#endif
