/* The LQG with a dither against friction as a model for the FMI glue: twin of controller_fmu/friction. */
#include "model.h"

#include <string.h>

#include "checks.h"
#include "design.h"
#include "elementary.h"

typedef struct {
    Variables of;

    Law law;
    double vector[LAW]; /* z, u, e */
    double T_s, u_0[AXES];
    double period, full, forget, level, sample; /* of the dither: [samples], [m], [1], [m], a whole number */
} DitheredLqg;

ASSERT_LAYOUT(starts_are_the_variables, sizeof START == sizeof(Variables));
ASSERT_LAYOUT(weights_are_side_by_side,
              offsetof(Variables, effort) + sizeof START[0] * AXES - offsetof(Variables, stiffness) == sizeof(Weights));

const size_t model_size = sizeof(DitheredLqg);
const size_t model_variables = sizeof(Variables) / sizeof(double);

void model_start(void *model) { memcpy(model, START, sizeof START); }

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    DitheredLqg *lqg = model;
    Variables *of = &lqg->of;
    *lqg = (DitheredLqg){.of = *of, .T_s = of->T_s};
    for (int i = 0; i < AXES; i++)
        of->u_m[i] = lqg->u_0[i] = of->u_m0[i];
    if (!check_ranges(of, message)) return false;
    lqg->period = of->period / of->T_s;
    lqg->full = of->off + of->rise;
    lqg->forget = elementary_exp(-of->T_s / of->memory);
    Weights weights;
    memcpy(&weights, of->stiffness, sizeof weights);
    return design(&weights, of->q_m_ref, of->u_m0, of->T_s, &lqg->law, message);
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    DitheredLqg *lqg = model;
    Variables *of = &lqg->of;
    double next[LAW];
    for (int i = 0; i < AXES; i++)
        lqg->vector[E + i] = of->q_m[i] - of->q_m_ref[i];
    apply(&lqg->law, lqg->vector, next);
    for (int i = 0; i < AXES; i++)
        if (!check_torque(i, next[U + i], t, message)) return false;
    lqg->level = fmax(elementary_hypot(next[E], next[E + 1]), lqg->forget * lqg->level);
    const double strength = fmin(fmax((lqg->level - of->off) / (lqg->full - of->off), 0.0), 1.0);
    const double shake = strength * elementary_sin(2.0 * PI * fmod(lqg->sample, lqg->period) / lqg->period);
    lqg->sample += 1.0;
    for (int i = 0; i < AXES; i++) {
        const double wanted = lqg->u_0[i] + next[U + i] + of->amplitude[i] * shake;
        of->u_m[i] = fmin(fmax(wanted, -TORQUE_LIMIT[i]), TORQUE_LIMIT[i]);
        next[U + i] = of->u_m[i] - lqg->u_0[i];
    }
    memcpy(lqg->vector, next, sizeof next);
    return true;
}

double model_sample_time(const void *model) { return ((const DitheredLqg *)model)->T_s; }
