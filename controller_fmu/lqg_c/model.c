/* The LQG with a dither against friction as a model for the FMI glue: twin of controller_fmu/friction. */
#include "model.h"

#include <string.h>

#include "checks.h"
#include "design.h"
#include "feedback.h"

typedef struct {
    Variables of;

    double T_s;
    Feedback feedback;
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
    Feedback *on = &lqg->feedback;
    lqg->T_s = of->T_s;
    *on = (Feedback){.off = of->off, .full = of->off + of->rise};
    for (int i = 0; i < AXES; i++) {
        of->u_m[i] = on->u_0[i] = of->u_m0[i];
        on->q_m_ref[i] = of->q_m_ref[i];
        on->amplitude[i] = of->amplitude[i];
    }
    if (!check_ranges(of, message)) return false;
    on->period = of->period / of->T_s;
    on->forget = elementary_exp(-of->T_s / of->memory);
    Weights weights;
    memcpy(&weights, of->stiffness, sizeof weights);
    return design(&weights, of->q_m_ref, of->u_m0, of->T_s, &on->law, message);
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    DitheredLqg *lqg = model;
    double next[LAWS][LAW];
    estimate(&lqg->feedback, lqg->of.q_m, next);
    for (int i = 0; i < AXES; i++)
        if (!check_torque(i, asked_in_all(next, i), t, message)) return false;
    command(&lqg->feedback, next, lqg->of.u_m);
    return true;
}

double model_sample_time(const void *model) { return ((const DitheredLqg *)model)->T_s; }
