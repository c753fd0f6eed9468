/* The equations of motion (2)-(11): twin of flexible_manipulator/dynamics.py and kinematics.py.
 *
 * The operations and their order are those of the Python sources, so that results agree to the last bit; compile
 * without contraction to fused multiply-add (-ffp-contract=off) and without fast-math. Angles in rad, speeds in
 * rad/s, torques in N.m. Motor quantities are on the motor's side of the gear.
 */
#ifndef DYNAMICS_H
#define DYNAMICS_H

#include "coefficients.h"

enum { Q_A = 0, Q_M = 2, W_A = 4, W_M = 6, STATES = 8 };

/* Link angles, motor angles, link speeds, motor speeds. */
typedef struct {
    double of[STATES];
} State;

/* Gravity torques, eq. (3f)-(3g); s_1 = sin q_a1, c_12 = cos(q_a1 + q_a2). */
static inline void gravity(const Arm *arm, double s_1, double c_12, double torques[2])
{
    torques[1] = -arm->c_2 * c_12;
    torques[0] = torques[1] - arm->c_1 * s_1;
}

/* Gear torque tau_s(delta) on the link's side, eq. (5): cubic up to psi, then linear; odd in delta. */
static inline double spring(const Joint *joint, double delta)
{
    const double size = fabs(delta);
    if (size <= joint->psi) return (joint->k_1 + joint->k_3 * delta * delta) * delta;
    return copysign(joint->m_0 + joint->m_1 * (size - joint->psi), delta);
}

/* Motor friction torque at motor speed v, eq. (8), with exponentials of non-positive arguments only. */
static inline double friction(const Joint *joint, double v)
{
    const double size = fabs(v);
    const double slow = exp(-joint->beta * size), fast = exp(-2.0 * joint->alpha * size);
    const double sech = 2.0 * slow / (1.0 + slow * slow), tanh = (1.0 - fast) / (1.0 + fast);
    const double coulomb = joint->f_c * (joint->mu_k + (1.0 - joint->mu_k) * sech) * tanh;
    return joint->f_d * v + copysign(coulomb, v);
}

/* Time derivative of the state, eq. (2) solved for the accelerations; tau = gamma u_m + u_d are the motors' torques
 * and F is the force on the tool [N]. */
static inline State derivative(const Arm *arm, const Joint joints[2], const State *state, const double tau[2],
                               const double F[2])
{
    const double *x = state->of, *w = x + W_A, *v = x + W_M;
    const double s_1 = sin(x[Q_A]), c_1 = cos(x[Q_A]), s_2 = sin(x[Q_A + 1]), c_2 = cos(x[Q_A + 1]);
    const double s_12 = s_1 * c_2 + c_1 * s_2, c_12 = c_1 * c_2 - s_1 * s_2;

    double gear[2], g[2];
    for (int i = 0; i < 2; i++)
        gear[i] = spring(&joints[i], x[Q_A + i] - x[Q_M + i] / joints[i].n) +
                  joints[i].d * (w[i] - v[i] / joints[i].n);
    gravity(arm, s_1, c_12, g);

    /* Inertia, eq. (3b)-(3d); Coriolis and centripetal torques, eq. (3h); the force's torques, eq. (10)-(11). */
    const double turning = arm->b * s_2, J_11 = arm->a_1 - 2.0 * turning, J_12 = arm->a_2 - turning, J_22 = arm->a_2;
    const double coupling = arm->b * c_2;
    const double C_1 = -coupling * (2.0 * w[0] + w[1]) * w[1], C_2 = coupling * w[0] * w[0];
    const double elbow_x = -arm->l_2 * s_12, elbow_z = -arm->l_2 * c_12;
    const double u_a2 = elbow_x * F[0] + elbow_z * F[1];
    const double u_a1 = arm->l_1 * (c_1 * F[0] - s_1 * F[1]) + u_a2;

    const double r_1 = u_a1 - C_1 - g[0] - gear[0], r_2 = u_a2 - C_2 - g[1] - gear[1];
    const double determinant = J_11 * J_22 - J_12 * J_12;
    State dx = {{w[0], w[1], v[0], v[1], (J_22 * r_1 - J_12 * r_2) / determinant,
                 (J_11 * r_2 - J_12 * r_1) / determinant}};
    for (int i = 0; i < 2; i++)
        dx.of[W_M + i] = (tau[i] + gear[i] / joints[i].n - friction(&joints[i], v[i])) / joints[i].j_m;
    return dx;
}

/* Position of the tool centre point [m], eq. (9). */
static inline void tool_position(const Arm *arm, const double q_a[2], double X[2])
{
    const double q_12 = q_a[0] + q_a[1];
    X[0] = arm->l_1 * sin(q_a[0]) + arm->l_2 * cos(q_12);
    X[1] = arm->l_1 * cos(q_a[0]) - arm->l_2 * sin(q_12);
}

#endif
