/* The constants of the equations of motion, gathered from Table 1: twin of flexible_manipulator/coefficients.py. */
#ifndef COEFFICIENTS_H
#define COEFFICIENTS_H

#include <math.h>

#include "interface.h" /* written by the build: Variables, START, TABLE_1 */

/* Constants of the rigid-body equations (3), (9) and (11); SI units. */
typedef struct {
    double a_1, a_2, b, c_1, c_2, l_1, l_2;
} Arm;

/* Constants of one motor and its gear, eq. (4)-(8); SI units. */
typedef struct {
    double j_m, n, gamma, d, k_1, k_3, psi, m_0, m_1, f_d, f_c, mu_k, beta, alpha;
} Joint;

/* x to a power by the C library, as in Python. A compiler that knew the exponent would multiply instead, which rounds
 * differently. */
static inline double power(double x, volatile double exponent) { return pow(x, exponent); }

static Arm arm_of(const Variables *of)
{
    const double *j = of->j, *m = of->m, *l = of->l, *xi = of->xi;
    return (Arm){
        .a_1 = j[0] + m[0] * power(xi[0], 2) + j[1] + m[1] * (power(l[0], 2) + power(xi[1], 2)),
        .a_2 = j[1] + m[1] * power(xi[1], 2),
        .b = m[1] * l[0] * xi[1],
        .c_1 = of->g * (m[0] * xi[0] + m[1] * l[0]),
        .c_2 = of->g * m[1] * xi[1],
        .l_1 = l[0],
        .l_2 = l[1],
    };
}

static Joint joint_of(const Variables *of, int axis)
{
    const double k_low = of->k_low[axis], k_high = of->k_high[axis], psi = of->psi[axis];
    const double k_3 = (k_high - k_low) / (3 * power(psi, 2));
    return (Joint){
        .j_m = of->j_m[axis],
        .n = of->n[axis],
        .gamma = of->gamma[axis],
        .d = of->d[axis],
        .k_1 = k_low,
        .k_3 = k_3,
        .psi = psi,
        .m_0 = k_low * psi + k_3 * power(psi, 3),
        .m_1 = k_high,
        .f_d = of->f_d[axis],
        .f_c = of->f_c[axis],
        .mu_k = of->mu_k[axis],
        .beta = of->beta[axis],
        .alpha = of->alpha[axis],
    };
}

#endif
