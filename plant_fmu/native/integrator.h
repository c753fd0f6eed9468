/* Classical Runge-Kutta of fourth order with fixed substeps: twin of flexible_manipulator/integrator.py, where the
 * constants are explained. */
#ifndef INTEGRATOR_H
#define INTEGRATOR_H

#include "dynamics.h"

static const double MAX_SUBSTEP = 0.25e-3, GENTLE = 0.5, MAX_STIFFNESS = 1.7;
static const double MIN_SUBSTEP = 0.25e-6, MOST_SUBSTEPS = 1e5, TINY = 2.2250738585072014e-308;

/* Upper bounds of the fastest rate of each joint [1/s], from the parameters alone. */
static void rates(const Arm *arm, const Joint joints[2], double found[2])
{
    const double least = arm->det - arm->b * arm->b, det = choose(least > TINY, least, TINY);
    const double inverses[2] = {arm->a_2 / det, (arm->a_1 + 2.0 * arm->b) / det};
    for (int i = 0; i < 2; i++) {
        const Joint *own = &joints[i];
        const double sticking = own->f_d + own->alpha * (own->f_k + 0.5 * own->f_s);
        found[i] = (sticking + own->d * (own->per_n * own->per_n)) * own->per_j_m + own->d * inverses[i];
    }
}

/* Longest substep [s], by the faster of the rates. */
static double longest_substep(const Arm *arm, const Joint joints[2])
{
    double of[2];
    rates(arm, joints, of);
    const double rate = choose(of[1] > of[0], of[1], of[0]), stiff = MAX_STIFFNESS / rate;
    return choose(rate * MAX_SUBSTEP <= GENTLE, MAX_SUBSTEP, choose(stiff < 0.5 * MAX_SUBSTEP, stiff, 0.5 * MAX_SUBSTEP));
}

/* x + h dx */
static inline State along(const State *x, double h, const State *dx)
{
    State y;
    for (int i = 0; i < STATES; i++)
        y.of[i] = x->of[i] + h * dx->of[i];
    return y;
}

/* Number of substeps that a step [s] >= 0 takes, where the longest is `substep` [s]. */
static inline double substeps_in(double step, double substep)
{
    /* A step of two substeps must not become one of three because its size was rounded up. */
    return ceil(step / substep * (1.0 - 1e-9));
}

/* The state after a step [s] >= 0 in so many substeps with torques and force held. */
static inline State advance(const Arm *arm, const Joint joints[2], double substeps, State x, double step, const double tau[2],
                            const double F[2])
{
    const double h = step / choose(substeps > 1.0, substeps, 1.0);
    for (double done = 0.0; any(done < substeps); done += 1.0) {
        const State k_1 = derivative(arm, joints, &x, tau, F), x_2 = along(&x, 0.5 * h, &k_1);
        const State k_2 = derivative(arm, joints, &x_2, tau, F), x_3 = along(&x, 0.5 * h, &k_2);
        const State k_3 = derivative(arm, joints, &x_3, tau, F), x_4 = along(&x, h, &k_3);
        const State k_4 = derivative(arm, joints, &x_4, tau, F);
        State slope = along(&k_1, 2.0, &k_2);
        slope = along(&slope, 2.0, &k_3);
        slope = along(&slope, 1.0, &k_4);
        const State next = along(&x, h / 6.0, &slope);
        for (int i = 0; i < STATES; i++)
            x.of[i] = choose(done < substeps, next.of[i], x.of[i]);
    }
    return x;
}

#endif
