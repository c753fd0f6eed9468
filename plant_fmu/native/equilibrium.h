/* The steady state in which every simulation starts: twin of flexible_manipulator/equilibrium.py. */
#ifndef EQUILIBRIUM_H
#define EQUILIBRIUM_H

#include "dynamics.h"

/* The deflection [rad] at which the gear of eq. (5) carries a torque [N.m]: linear beyond the breakpoint; before it
 * the cubic rises, so bisection ends at neighbouring floating-point numbers. */
static double deflection(const Joint *joint, double torque)
{
    const double load = fabs(torque);
    if (load > joint->m_0) return copysign(joint->psi + (load - joint->m_0) / joint->m_1, torque);
    double low = 0.0, high = joint->psi;
    for (double middle = 0.5 * high; low < middle && middle < high; middle = 0.5 * (low + high)) {
        if (spring(joint, middle) < load)
            low = middle;
        else
            high = middle;
    }
    return copysign(high, torque);
}

/* Motor angles [rad] and the torques to command [N.m] at rest at link angles q_a [rad]: the gears balance gravity,
 * and the motors carry the gears. */
static void solve_rest(const Arm *arm, const Joint joints[2], const double q_a[2], double q_m[2], double u_m[2])
{
    double loads[2];
    gravity(arm, elementary_sin(q_a[0]), elementary_cos(q_a[0] + q_a[1]), loads);
    for (int i = 0; i < 2; i++) {
        q_m[i] = (q_a[i] - deflection(&joints[i], -loads[i])) / joints[i].per_n;
        u_m[i] = loads[i] * joints[i].per_n / joints[i].gamma;
    }
}

#endif
