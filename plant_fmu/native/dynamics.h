/* The equations of motion (2)-(11): twin of flexible_manipulator/dynamics.py and kinematics.py.
 *
 * The operations and their order are those of the Python sources, so that results agree to the last bit; compile
 * without contraction to fused multiply-add (-ffp-contract=off) and without fast-math. Angles in rad, speeds in
 * rad/s, torques in N.m. Motor quantities are on the motor's side of the gear.
 */
#ifndef DYNAMICS_H
#define DYNAMICS_H

#include "elementary.h"

/* Constants of the rigid-body equations (3), (9) and (11); SI units. */
typedef struct {
    double a_1, a_2, b, c_1, c_2, l_1, l_2, det;
} Arm;

/* Constants of one motor and its gear, eq. (4)-(8); SI units. */
typedef struct {
    double per_j_m, per_n, gamma, d, k_1, k_3, psi, m_0, m_1, f_d, f_k, f_s, beta, alpha;
} Joint;

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
    const double cubic = (joint->k_1 + joint->k_3 * delta * delta) * delta;
    const double linear = copysign(joint->m_0 + joint->m_1 * (size - joint->psi), delta);
    return choose(size <= joint->psi, cubic, linear);
}

/* Motor friction torques at motor speeds v, eq. (8), with exponentials of non-positive arguments only. The two axes
 * are computed side by side, for which compilers have instructions. */
static inline void friction(const Joint joints[2], const double v[2], double torques[2])
{
    double exponent[4], power[4];
    for (int i = 0; i < 2; i++) {
        const double size = fabs(v[i]), slow = -joints[i].beta * size, fast = -2.0 * joints[i].alpha * size;
        exponent[i] = choose(slow > ELEMENTARY_EXP_MIN, slow, ELEMENTARY_EXP_MIN);
        exponent[2 + i] = choose(fast > ELEMENTARY_EXP_MIN, fast, ELEMENTARY_EXP_MIN);
    }
    for (int i = 0; i < 4; i++)
        power[i] = elementary_exp_within(exponent[i]);
    for (int i = 0; i < 2; i++) {
        const double slow = power[i], fast = power[2 + i], square = 1.0 + slow * slow;
        const double coulomb = (joints[i].f_k * square + joints[i].f_s * slow) * (1.0 - fast) / (square * (1.0 + fast));
        torques[i] = joints[i].f_d * v[i] + copysign(coulomb, v[i]);
    }
}

/* Torques of the motors [N.m] for those that are commanded and those that disturb them, eq. (2). */
static inline void motor_torques(const Joint joints[2], const double u_m[2], const double u_d[2], double tau[2])
{
    for (int i = 0; i < 2; i++)
        tau[i] = joints[i].gamma * u_m[i] + u_d[i];
}

/* Time derivative of the state, eq. (2) solved for the accelerations; tau = gamma u_m + u_d are the motors' torques
 * and F is the force on the tool [N]. */
static inline State derivative(const Arm *arm, const Joint joints[2], const State *state, const double tau[2],
                               const double F[2])
{
    const double *x = state->of, *w = x + W_A, *v = x + W_M;
    double s[2], c[2];
    for (int i = 0; i < 2; i++)
        elementary_sin_cos_within(x[Q_A + i], &s[i], &c[i]);
    const double s_12 = s[0] * c[1] + c[0] * s[1], c_12 = c[0] * c[1] - s[0] * s[1];

    double gear[2], g[2], brake[2];
    for (int i = 0; i < 2; i++)
        gear[i] = spring(&joints[i], x[Q_A + i] - x[Q_M + i] * joints[i].per_n) +
                  joints[i].d * (w[i] - v[i] * joints[i].per_n);
    gravity(arm, s[0], c_12, g);
    friction(joints, v, brake);

    /* Inertia, eq. (3b)-(3d); Coriolis and centripetal torques, eq. (3h); the force's torques, eq. (10)-(11). */
    const double turning = arm->b * s[1], J_11 = arm->a_1 - 2.0 * turning, J_12 = arm->a_2 - turning, J_22 = arm->a_2;
    const double coupling = arm->b * c[1];
    const double C_1 = -coupling * (2.0 * w[0] + w[1]) * w[1], C_2 = coupling * w[0] * w[0];
    const double elbow_x = -arm->l_2 * s_12, elbow_z = -arm->l_2 * c_12;
    const double u_a2 = elbow_x * F[0] + elbow_z * F[1];
    const double u_a1 = arm->l_1 * (c[0] * F[0] - s[0] * F[1]) + u_a2;

    const double r_1 = u_a1 - C_1 - g[0] - gear[0], r_2 = u_a2 - C_2 - g[1] - gear[1];
    const double per_det = 1.0 / (arm->det - turning * turning);
    State dx = {{w[0], w[1], v[0], v[1], (J_22 * r_1 - J_12 * r_2) * per_det, (J_11 * r_2 - J_12 * r_1) * per_det}};
    for (int i = 0; i < 2; i++)
        dx.of[W_M + i] = (tau[i] + gear[i] * joints[i].per_n - brake[i]) * joints[i].per_j_m;
    return dx;
}

/* Position of the tool centre point [m], eq. (9). */
static inline void tool_position(const Arm *arm, const double q_a[2], double X[2])
{
    double s, c, s_12, c_12;
    elementary_sin_cos(q_a[0], &s, &c);
    elementary_sin_cos(q_a[0] + q_a[1], &s_12, &c_12);
    X[0] = arm->l_1 * s + arm->l_2 * c_12;
    X[1] = arm->l_1 * c - arm->l_2 * s_12;
}

#endif
