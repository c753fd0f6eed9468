/* Two LQGs, a stiff one at rest and a damping one with a dither after an event, as a model for the FMI glue. */
#include "model.h"

#include <math.h>
#include <string.h>

#include "checks.h"
#include "design.h"
#include "switching.h"

typedef struct {
    Variables of;

    Law quiet, event;
    double at_rest[LAW], shaken[LAW]; /* of each law: z, u, e */
    Switching switching;
    Watch watch;
    double T_s, u_0[AXES], amplitude[AXES];
} RobustLqg;

ASSERT_LAYOUT(starts_are_the_variables, sizeof START == sizeof(Variables));
ASSERT_LAYOUT(weights_are_side_by_side,
              offsetof(Variables, effort) + sizeof START[0] * AXES - offsetof(Variables, stiffness) == sizeof(Weights));
ASSERT_LAYOUT(event_weights_are_side_by_side,
              offsetof(Variables, event_effort) + sizeof START[0] * AXES - offsetof(Variables, event_stiffness) ==
                  sizeof(Weights));
ASSERT_LAYOUT(switching_is_side_by_side,
              offsetof(Variables, decay) + sizeof START[0] - offsetof(Variables, amplitude) == sizeof(Switching));

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
    /* The filters take what a folded arm does for a larger error than it is, by a factor of 3 at q_a2 = 80 degrees. */
    lqg->switching.threshold /= reach(of->q_m_ref);
    lqg->switching.sway /= reach(of->q_m_ref);
    lqg->watch = watch(&lqg->switching);
    for (int i = 0; i < AXES; i++)
        lqg->amplitude[i] = amplitude(&lqg->switching, i, of->u_m0[i], TORQUE_LIMIT[i]);
    Weights quiet, event;
    memcpy(&quiet, of->stiffness, sizeof quiet);
    memcpy(&event, of->event_stiffness, sizeof event);
    return design(&quiet, of->q_m_ref, of->u_m0, of->T_s, &lqg->quiet, message) &&
           design(&event, of->q_m_ref, of->u_m0, of->T_s, &lqg->event, message);
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    RobustLqg *lqg = model;
    Variables *of = &lqg->of;
    double quiet[LAW], event[LAW];
    for (int i = 0; i < AXES; i++)
        lqg->at_rest[E + i] = lqg->shaken[E + i] = of->q_m[i] - of->q_m_ref[i];
    apply(&lqg->quiet, lqg->at_rest, quiet);
    apply(&lqg->event, lqg->shaken, event);
    for (int i = 0; i < AXES; i++)
        if (!check_torque(i, quiet[U + i] + event[U + i], t, message)) return false;
    const Shares of_event = shares(&lqg->watch, &lqg->switching, event + E, lqg->T_s);
    const double shake = of_event.dither * wave(&lqg->watch, &lqg->switching, lqg->T_s);
    for (int i = 0; i < AXES; i++) {
        const double feedback = (1.0 - of_event.feedback) * quiet[U + i] + of_event.feedback * event[U + i];
        of->u_m[i] = limited(lqg->u_0[i] + feedback + lqg->amplitude[i] * shake, -TORQUE_LIMIT[i], TORQUE_LIMIT[i]);
        quiet[U + i] = event[U + i] = of->u_m[i] - lqg->u_0[i]; /* both filters know the torque that acts */
    }
    memcpy(lqg->at_rest, quiet, sizeof quiet);
    memcpy(lqg->shaken, event, sizeof event);
    return true;
}

double model_sample_time(const void *model) { return ((const RobustLqg *)model)->T_s; }
