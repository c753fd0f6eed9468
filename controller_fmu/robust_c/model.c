/* Three LQGs, a stiff one at rest, a damping one with a dither after an event and a strong one for first peaks, and a slow
 * feedback in the drive's limits, as a model for the FMI glue. */
#include "model.h"

#include <math.h>
#include <string.h>

#include "checks.h"
#include "design.h"
#include "overload.h"
#include "switching.h"

enum { AT_REST, AFTER_EVENT, IN_PEAK, LAWS };

typedef struct {
    Variables of;

    Law laws[LAWS];
    double vectors[LAWS][LAW]; /* of each law: z, u, e */
    Switching switching;
    Watch watch;
    Slow slow;
    Overload overload;
    double T_s, u_0[AXES], amplitude[AXES];
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
    *lqg = (RobustLqg){.of = *of, .T_s = of->T_s};
    for (int i = 0; i < AXES; i++)
        of->u_m[i] = lqg->u_0[i] = of->u_m0[i];
    if (!check_ranges(of, message)) return false;
    memcpy(&lqg->switching, of->amplitude, sizeof lqg->switching);
    memcpy(&lqg->slow, &of->overload, sizeof lqg->slow);
    if (window_of(of->period, lqg->T_s) < 1.0 || window_of(of->period, lqg->T_s) > WINDOW) {
        snprintf(message, MODEL_MESSAGE_SIZE, "parameter period = %g s: it must have 1 to %d samples", of->period, WINDOW / 2);
        return false;
    }
    scale(&lqg->switching, reach(of->q_m_ref));
    lqg->watch = watch(&lqg->switching, lqg->T_s);
    lqg->overload = overload(&lqg->slow, lqg->T_s);
    for (int i = 0; i < AXES; i++)
        lqg->amplitude[i] = shaken_with(of->amplitude[i], of->headroom, of->u_m0[i], TORQUE_LIMIT[i]);
    const double *given[LAWS] = {of->stiffness, of->event_stiffness, of->peak_stiffness};
    for (int law = 0; law < LAWS; law++) {
        Weights weights;
        memcpy(&weights, given[law], sizeof weights);
        if (!design(&weights, of->q_m_ref, of->u_m0, of->T_s, &lqg->laws[law], message)) return false;
    }
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    RobustLqg *lqg = model;
    Variables *of = &lqg->of;
    double next[LAWS][LAW];
    for (int law = 0; law < LAWS; law++) {
        for (int i = 0; i < AXES; i++)
            lqg->vectors[law][E + i] = of->q_m[i] - of->q_m_ref[i];
        apply(&lqg->laws[law], lqg->vectors[law], next[law]);
    }
    for (int i = 0; i < AXES; i++)
        if (!check_torque(i, next[AT_REST][U + i] + next[AFTER_EVENT][U + i] + next[IN_PEAK][U + i], t, message)) return false;
    const Shares share = shares(&lqg->watch, &lqg->switching, next[AFTER_EVENT] + E, next[IN_PEAK] + E, lqg->T_s);
    const double shake = share.dither > 0.0 ? share.dither * square(&lqg->watch.errors, of->period, lqg->T_s) : 0.0;
    /* The hand-over from the slow feedback is a jump to the third law, which would drive the torques to their limits again. */
    const double peak = lqg->overload.since < lqg->slow.peak_pause ? 0.0 : share.peak;
    double wanted[AXES], slow[AXES];
    for (int i = 0; i < AXES; i++) {
        const double later = (1.0 - share.event) * next[AT_REST][U + i] + share.event * next[AFTER_EVENT][U + i];
        const double feedback = (1.0 - peak) * later + peak * next[IN_PEAK][U + i];
        wanted[i] = lqg->u_0[i] + feedback + lqg->amplitude[i] * shake;
    }
    const bool slowly = overloaded(&lqg->overload, &lqg->slow, wanted, lqg->T_s);
    feed_back_slowly(&lqg->overload, &lqg->slow, lqg->vectors[AT_REST] + E, slow);
    for (int i = 0; i < AXES; i++) {
        of->u_m[i] = limited(slowly ? lqg->u_0[i] + slow[i] : wanted[i], -TORQUE_LIMIT[i], TORQUE_LIMIT[i]);
        for (int law = 0; law < LAWS; law++)
            next[law][U + i] = of->u_m[i] - lqg->u_0[i]; /* all filters know the torque that acts */
    }
    memcpy(lqg->vectors, next, sizeof next);
    return true;
}

double model_sample_time(const void *model) { return ((const RobustLqg *)model)->T_s; }
