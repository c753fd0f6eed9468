/* The constants of the equations of motion, gathered from Table 1: twin of flexible_manipulator/coefficients.py. */
#ifndef COEFFICIENTS_H
#define COEFFICIENTS_H

#include "dynamics.h"
#include "interface.h" /* written by the build: Variables, START, TABLE_1 */

static Arm arm_of(const Variables *of)
{
    const double *j = of->j, *m = of->m, *l = of->l, *xi = of->xi;
    const double a_1 = j[0] + m[0] * (xi[0] * xi[0]) + j[1] + m[1] * (l[0] * l[0] + xi[1] * xi[1]);
    const double a_2 = j[1] + m[1] * (xi[1] * xi[1]);
    return (Arm){
        .a_1 = a_1,
        .a_2 = a_2,
        .b = m[1] * l[0] * xi[1],
        .c_1 = of->g * (m[0] * xi[0] + m[1] * l[0]),
        .c_2 = of->g * m[1] * xi[1],
        .l_1 = l[0],
        .l_2 = l[1],
        .det = (a_1 - a_2) * a_2,
    };
}

static Joint joint_of(const Variables *of, int axis)
{
    const double k_low = of->k_low[axis], k_high = of->k_high[axis], psi = of->psi[axis];
    const double k_3 = (k_high - k_low) / (3.0 * (psi * psi));
    const double f_c = of->f_c[axis], mu_k = of->mu_k[axis];
    return (Joint){
        .per_j_m = 1.0 / of->j_m[axis],
        .per_n = 1.0 / of->n[axis],
        .gamma = of->gamma[axis],
        .d = of->d[axis],
        .k_1 = k_low,
        .k_3 = k_3,
        .psi = psi,
        .m_0 = k_low * psi + k_3 * (psi * psi * psi),
        .m_1 = k_high,
        .f_d = of->f_d[axis],
        .f_k = f_c * mu_k,
        .f_s = 2.0 * f_c * (1.0 - mu_k),
        .beta = of->beta[axis],
        .alpha = of->alpha[axis],
    };
}

#endif
