/* Classical Runge-Kutta of fourth order with fixed substeps: twin of flexible_manipulator/integrator.py, where the
 * constants are explained. */
#ifndef INTEGRATOR_H
#define INTEGRATOR_H

#include "dynamics.h"

static const double MAX_SUBSTEP = 0.25e-3 / 3, MAX_STIFFNESS = 1.25;
static const double MIN_SUBSTEP = 0.25e-6, MOST_SUBSTEPS = 1e5;

/* The fastest rate of a joint [1/s]. */
static double friction_rate(const Joint *joint) {
  return (joint->alpha * joint->f_c + joint->f_d) / joint->j_m;
}

/* Longest substep [s]: shorter than MAX_SUBSTEP where friction is steep at standstill. */
static double longest_substep(const Joint joints[2])
{
  const double first = friction_rate(&joints[0]),
               second = friction_rate(&joints[1]);
  const double rate = second > first ? second : first;
  return rate > 0 && MAX_STIFFNESS / rate < MAX_SUBSTEP ? MAX_STIFFNESS / rate
                                                        : MAX_SUBSTEP;
}

/* x + h dx */
static inline State along(const State *x, double h, const State *dx)
{
    State y;
    for (int i = 0; i < STATES; i++)
        y.of[i] = x->of[i] + h * dx->of[i];
    return y;
}

/* Number of substeps that a step [s] >= 0 takes, where the longest is `substep`
 * [s]. */
static inline double substeps_in(double step, double substep) {
  /* A step of three substeps must not become one of four because its size was
   * rounded up. */
  return ceil(step / substep * (1.0 - 1e-9));
}

/* The state after a step [s] >= 0 in so many substeps with torques and force
 * held. */
static State advance(const Arm *arm, const Joint joints[2], double substeps,
                     State x, double step, const double tau[2],
                     const double F[2]) {
  const double h = step / (substeps > 1.0 ? substeps : 1.0);
  for (double done = 0.0; done < substeps; done++) {
    const State k_1 = derivative(arm, joints, &x, tau, F),
                x_2 = along(&x, 0.5 * h, &k_1);
    const State k_2 = derivative(arm, joints, &x_2, tau, F),
                x_3 = along(&x, 0.5 * h, &k_2);
    const State k_3 = derivative(arm, joints, &x_3, tau, F),
                x_4 = along(&x, h, &k_3);
    const State k_4 = derivative(arm, joints, &x_4, tau, F);
    State slope = along(&k_1, 2.0, &k_2);
    slope = along(&slope, 2.0, &k_3);
    slope = along(&slope, 1.0, &k_4);
    x = along(&x, h / 6.0, &slope);
  }
  return x;
}

#endif
