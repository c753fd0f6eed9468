/* Three LQGs, a stiff one at rest, a damping one with a dither after an event and a strong one for first peaks, and a slow
 * feedback in the drive's limits, as a model for the FMI glue. */
#include "model.h"

#include <math.h>
#include <string.h>

#include "checks.h"
#include "design.h"
#include "feedback.h"

typedef struct {
    Variables of;

    Feedback feedback;
} RobustLqg;

ASSERT_LAYOUT(starts_are_the_variables, sizeof START == sizeof(Variables));
ASSERT_LAYOUT(weights_are_side_by_side,
              offsetof(Variables, effort) + sizeof START[0] * AXES - offsetof(Variables, stiffness) == sizeof(Weights));
ASSERT_LAYOUT(event_weights_are_side_by_side,
              offsetof(Variables, event_effort) + sizeof START[0] * AXES - offsetof(Variables, event_stiffness) ==
                  sizeof(Weights));
ASSERT_LAYOUT(peak_weights_are_side_by_side,
              offsetof(Variables, peak_effort) + sizeof START[0] * AXES - offsetof(Variables, peak_stiffness) ==
                  sizeof(Weights));
ASSERT_LAYOUT(switching_is_side_by_side,
              offsetof(Variables, overload) - offsetof(Variables, amplitude) == sizeof(Switching));
ASSERT_LAYOUT(overload_is_side_by_side, sizeof(Variables) - offsetof(Variables, overload) == sizeof(Slow));

/* Distance of the TCP from the first axis, relative to that of the stretched arm; lengths [m] as in Table 1. */
static double reach(const double q_m_ref[AXES])
{
    const double first = 1.0, second = 1.5, ratio = 200.0;
    return sqrt(first * first + second * second - 2.0 * first * second * elementary_sin(q_m_ref[1] / ratio)) / (first + second);
}

const size_t model_size = sizeof(RobustLqg);
const size_t model_variables = sizeof(Variables) / sizeof(double);

void model_start(void *model) { memcpy(model, START, sizeof START); }

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    RobustLqg *lqg = model;
    Variables *of = &lqg->of;
    Feedback *on = &lqg->feedback;
    *on = (Feedback){.T_s = of->T_s};
    for (int i = 0; i < AXES; i++) {
        of->u_m[i] = on->u_0[i] = of->u_m0[i];
        on->q_m_ref[i] = of->q_m_ref[i];
    }
    if (!check_ranges(of, message)) return false;
    memcpy(&on->switching, of->amplitude, sizeof on->switching);
    memcpy(&on->slow, &of->overload, sizeof on->slow);
    if (window_of(of->period, on->T_s) < 1.0 || window_of(of->period, on->T_s) > WINDOW) {
        snprintf(message, MODEL_MESSAGE_SIZE, "parameter period = %g s: it must have 1 to %d samples", of->period, WINDOW / 2);
        return false;
    }
    scale(&on->switching, reach(of->q_m_ref));
    on->watch = watch(&on->switching, on->T_s);
    on->overload = overload(&on->slow, on->T_s);
    for (int i = 0; i < AXES; i++)
        on->amplitude[i] = shaken_with(of->amplitude[i], of->headroom, of->u_m0[i], TORQUE_LIMIT[i]);
    const double *given[LAWS] = {of->stiffness, of->event_stiffness, of->peak_stiffness};
    for (int law = 0; law < LAWS; law++) {
        Weights weights;
        memcpy(&weights, given[law], sizeof weights);
        if (!design(&weights, of->q_m_ref, of->u_m0, of->T_s, &on->laws[law], message)) return false;
    }
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    RobustLqg *lqg = model;
    double next[LAWS][LAW];
    estimate(&lqg->feedback, lqg->of.q_m, next);
    for (int i = 0; i < AXES; i++)
        if (!check_torque(i, asked_in_all(next, i), t, message)) return false;
    command(&lqg->feedback, next, lqg->of.u_m);
    return true;
}

double model_sample_time(const void *model) { return ((const RobustLqg *)model)->feedback.T_s; }
