/* What acts while the LQGs would stay in the drive's limits.
 *
 * With more gain or delay, and both motors at their limits nearly all the time, LQG, drive and arm have a second attractor: a
 * cycle of some 14 Hz and several centimetres, from which no LQG returns, since its filter does not explain it. A slow feedback
 * of motor angle and velocity takes energy out of any motion, at any loop gain that A1 knows, in the limits, too. It acts until
 * the LQGs, whose filters go on with the torque that acts, would no longer be at the limits. */
#ifndef OVERLOAD_H
#define OVERLOAD_H

#include <stdbool.h>

#include "events.h"
#include "law.h"

/* Parameters of the FMU, in the order of interface.py, where units are told. */
typedef struct {
    double overload, time, recovered, stiffness[2], damping[2], share, velocity_time, peak_pause;
} Slow;

/* The average share of the samples in which each axis is asked for its limit; the average angles [rad]; what is left of both
 * averages after a sample; time [s] since the slow feedback acted, 0 while it acts. */
typedef struct {
    double at_limit[2], angle[2], limit_left, angle_left, since;
} Overload;

/* At rest. */
static inline Overload overload(const Slow *by, double T_s)
{
    return (Overload){.limit_left = left_of(by->time, T_s), .angle_left = left_of(by->velocity_time, T_s),
                      .since = INFINITY};
}

/* Whether the slow feedback acts in this sample, in which these torques [N.m] are wanted. */
static inline bool overloaded(Overload *on, const Slow *by, const double wanted[2], double T_s)
{
    for (int i = 0; i < 2; i++)
        smooth(&on->at_limit[i], choose(fabs(wanted[i]) >= TORQUE_LIMIT[i], 1.0, 0.0), on->limit_left);
    const double most = choose(on->since == 0.0, by->recovered, by->overload);
    const bool acts = fmax(on->at_limit[0], on->at_limit[1]) > most;
    on->since = choose(acts, 0.0, on->since + T_s);
    return acts;
}

/* Its torques [N.m], for motor angles [rad] from where they should be. The stiffness asks for a share of the limit at the most:
 * it may not use up what the damping needs. */
static inline void feed_back_slowly(Overload *on, const Slow *by, const double e[2], double u[2])
{
    for (int i = 0; i < 2; i++) {
        const double velocity = (e[i] - on->angle[i]) / by->velocity_time, most = by->share * TORQUE_LIMIT[i];
        smooth(&on->angle[i], e[i], on->angle_left);
        u[i] = -limited(by->stiffness[i] * e[i], -most, most) - by->damping[i] * velocity;
    }
}

#endif
