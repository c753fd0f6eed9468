/* The LQG design of flexible_manipulator_lqg/design.py in plain C, where the same steps by the same names are
 * explained. Results agree up to rounding. */
#ifndef DESIGN_H
#define DESIGN_H

#include <string.h>

#include "matrix.h"
#include "model.h"

static const double PI = 3.14159265358979323846;

enum { AXES = 2, LAW = N + 2 * AXES, U = N, E = N + AXES };

/* What a designer chooses, in the order of flexible_manipulator_lqg/interface.py, where units are told. */
typedef struct {
    double stiffness[AXES], hardening, friction[AXES], drift[AXES], motor_noise[AXES], arm_noise, push, push_time;
    double angle_noise, velocity, motor_angle, effort[AXES];
} Weights;

/* (z+, torque about u_m0, estimated TCP error) = law (z, u, e), column by column, for which compilers find vector
 * instructions that do not change the order of a sum. */
typedef struct {
    double columns[LAW][LAW];
} Law;

/* u_max of Table 1 [N.m]. */
static const double TORQUE_LIMIT[AXES] = {35.0, 20.0};

/* For the pose that q_m_ref [rad] and u_m0 [N.m] tell and the sample time T_s [s]. */
bool design(const Weights *of, const double q_m_ref[AXES], const double u_m0[AXES], double T_s, Law *law,
            char message[MODEL_MESSAGE_SIZE]);

/* Rows whose sums are taken side by side. */
enum { ROWS = 8 };

ASSERT_LAYOUT(rows_are_whole_blocks, LAW % ROWS == 0);

/* next = law vector. In blocks, whose sums stay in registers: of one pair of loops over all rows GCC 12 made code that takes
 * five times as long (221 ns, 47 ns in blocks; Clang 14: 44 and 48 ns). */
static inline void apply(const Law *law, const double vector[LAW], double next[LAW])
{
    for (int first = 0; first < LAW; first += ROWS) {
        double sums[ROWS] = {0.0};
        for (int j = 0; j < LAW; j++)
            for (int row = 0; row < ROWS; row++)
                sums[row] += law->columns[j][first + row] * vector[j];
        memcpy(next + first, sums, sizeof sums);
    }
}

#endif
