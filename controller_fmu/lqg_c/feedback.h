/* An LQG with a dither against friction: twin of controller_fmu/friction. */
#ifndef FEEDBACK_H
#define FEEDBACK_H

#include "elementary.h"
#include "law.h"

enum { LAWS = 1 };

/* The law and its vector z, u, e; of the dither the amplitude [N.m], the period [samples], the levels [m] at which it begins and
 * is full, what is left of a level after a sample [1], the level [m], and the number of the sample. */
typedef struct {
    Law law;
    double vector[LAW];
    double q_m_ref[AXES], u_0[AXES], amplitude[AXES];
    double period, off, full, forget, level, sample;
} Feedback;

/* What the law makes of the motor angles [rad] of this sample. */
static inline void estimate(Feedback *on, const double q_m[AXES], double next[LAWS][LAW])
{
    for (int i = 0; i < AXES; i++)
        on->vector[E + i] = q_m[i] - on->q_m_ref[i];
    apply(&on->law, on->vector, next[0]);
}

/* The torque [N.m] by which one sees whether the law is finite. */
static inline double asked_in_all(double next[LAWS][LAW], int axis) { return next[0][U + axis]; }

/* The torques [N.m] to command, of what the law asks for. */
static inline void command(Feedback *on, double next[LAWS][LAW], double u_m[AXES])
{
    const double circle = 2.0 * 3.14159265358979323846;
    on->level = fmax(elementary_hypot(next[0][E], next[0][E + 1]), on->forget * on->level);
    const double strength = fmin(fmax((on->level - on->off) / (on->full - on->off), 0.0), 1.0);
    const double shake = strength * elementary_sin(circle * fmod(on->sample, on->period) / on->period);
    on->sample += 1.0;
    for (int i = 0; i < AXES; i++) {
        const double wanted = on->u_0[i] + next[0][U + i] + on->amplitude[i] * shake;
        u_m[i] = fmin(fmax(wanted, -TORQUE_LIMIT[i]), TORQUE_LIMIT[i]);
        next[0][U + i] = u_m[i] - on->u_0[i];
    }
    memcpy(on->vector, next[0], sizeof on->vector);
}

#endif
