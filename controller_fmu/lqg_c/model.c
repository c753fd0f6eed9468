/* The LQG with a dither against friction as a model for the FMI glue: twin of controller_fmu/friction. */
#include "model.h"

#include <stdio.h>
#include <string.h>

#include "design.h"

static const double STEP_TOLERANCE = 1e-9;
static const double TORQUE_LIMIT[AXES] = {35.0, 20.0};

typedef struct {
    Variables of;

    Law law;
    double vector[LAW]; /* z, u, e */
    double T_s, u_0[AXES];
    double period, full, forget, level, sample; /* of the dither: [samples], [m], [1], [m], a whole number */
} DitheredLqg;

const size_t model_size = sizeof(DitheredLqg);
const size_t model_variables = sizeof(Variables) / sizeof(double);

size_t model_extent(unsigned value_reference) { return 1; } /* described with scalars only */

void model_start(void *model) { memcpy(model, START, sizeof START); }

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

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    DitheredLqg *lqg = model;
    Variables *of = &lqg->of;
    *lqg = (DitheredLqg){.of = *of, .T_s = of->T_s};
    for (int i = 0; i < AXES; i++)
        of->u_m[i] = lqg->u_0[i] = of->u_m0[i];
    if (!check(of, message)) return false;
    lqg->period = of->period / of->T_s;
    lqg->full = of->off + of->rise;
    lqg->forget = exp(-of->T_s / of->memory);
    if (design(of, &lqg->law)) return true;
    snprintf(message, MODEL_MESSAGE_SIZE,
             "the Riccati equation has no stabilizing solution that the doubling algorithm could find");
    return false;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    DitheredLqg *lqg = model;
    Variables *of = &lqg->of;
    if (!(fabs(h - lqg->T_s) <= STEP_TOLERANCE * lqg->T_s)) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.17g s at t = %.17g s refused: the communication step must equal the sample time "
                 "T_s = %.17g s",
                 h, t, lqg->T_s);
        return false;
    }
    double next[LAW] = {0.0};
    for (int i = 0; i < AXES; i++)
        lqg->vector[E + i] = of->q_m[i] - of->q_m_ref[i];
    for (int row = 0; row < LAW; row++)
        for (int j = 0; j < LAW; j++)
            next[row] += lqg->law.of[row][j] * lqg->vector[j];
    lqg->level = fmax(hypot(next[E], next[E + 1]), lqg->forget * lqg->level);
    const double strength = fmin(fmax((lqg->level - of->off) / (lqg->full - of->off), 0.0), 1.0);
    const double shake = strength * sin(2.0 * PI * fmod(lqg->sample, lqg->period) / lqg->period);
    lqg->sample += 1.0;
    for (int i = 0; i < AXES; i++) {
        const double wanted = lqg->u_0[i] + next[U + i] + of->amplitude[i] * shake;
        of->u_m[i] = fmin(fmax(wanted, -TORQUE_LIMIT[i]), TORQUE_LIMIT[i]);
        next[U + i] = of->u_m[i] - lqg->u_0[i];
    }
    for (int i = 0; i < LAW; i++)
        lqg->vector[i] = next[i];
    return true;
}

double model_sample_time(const void *model) { return ((const DitheredLqg *)model)->T_s; }
