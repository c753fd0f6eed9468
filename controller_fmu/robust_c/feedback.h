/* Three LQGs, a stiff one at rest, a damping one with a dither after an event and a strong one for first peaks, and a slow
 * feedback in the drive's limits. */
#ifndef FEEDBACK_H
#define FEEDBACK_H

#include "overload.h"
#include "switching.h"

enum { AT_REST, AFTER_EVENT, IN_PEAK, LAWS };

/* The laws and of each the vector z, u, e; the torques are those about u_0 [N.m]. */
typedef struct {
    Law laws[LAWS];
    double vectors[LAWS][LAW];
    Switching switching;
    Watch watch;
    Slow slow;
    Overload overload;
    double T_s, q_m_ref[AXES], u_0[AXES], amplitude[AXES];
} Feedback;

/* What each law makes of the motor angles [rad] of this sample. */
static inline void estimate(Feedback *on, const double q_m[AXES], double next[LAWS][LAW])
{
    for (int law = 0; law < LAWS; law++) {
        for (int i = 0; i < AXES; i++)
            on->vectors[law][E + i] = q_m[i] - on->q_m_ref[i];
        apply(&on->laws[law], on->vectors[law], next[law]);
    }
}

/* The torque [N.m] by which one sees whether all laws are finite. */
static inline double asked_in_all(double next[LAWS][LAW], int axis)
{
    return next[AT_REST][U + axis] + next[AFTER_EVENT][U + axis] + next[IN_PEAK][U + axis];
}

/* The torques [N.m] to command, of what the laws ask for. */
static inline void command(Feedback *on, double next[LAWS][LAW], double u_m[AXES])
{
    const Shares share = shares(&on->watch, &on->switching, next[AFTER_EVENT] + E, next[IN_PEAK] + E, on->T_s);
    const double shake = choose(share.dither > 0.0, share.dither * square(&on->watch.errors, on->switching.period, on->T_s), 0.0);
    /* The hand-over from the slow feedback is a jump to the third law, which would drive the torques to their limits again. */
    const double peak = choose(on->overload.since < on->slow.peak_pause, 0.0, share.peak);
    double wanted[AXES], slow[AXES];
    for (int i = 0; i < AXES; i++) {
        const double later = (1.0 - share.event) * next[AT_REST][U + i] + share.event * next[AFTER_EVENT][U + i];
        const double feedback = (1.0 - peak) * later + peak * next[IN_PEAK][U + i];
        wanted[i] = on->u_0[i] + feedback + on->amplitude[i] * shake;
    }
    const bool slowly = overloaded(&on->overload, &on->slow, wanted, on->T_s);
    feed_back_slowly(&on->overload, &on->slow, on->vectors[AT_REST] + E, slow);
    for (int i = 0; i < AXES; i++) {
        u_m[i] = limited(choose(slowly, on->u_0[i] + slow[i], wanted[i]), -TORQUE_LIMIT[i], TORQUE_LIMIT[i]);
        for (int law = 0; law < LAWS; law++)
            next[law][U + i] = u_m[i] - on->u_0[i]; /* all filters know the torque that acts */
    }
    memcpy(on->vectors, next, sizeof on->vectors);
}

#endif
