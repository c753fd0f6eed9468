/* The LQG design of flexible_manipulator_lqg/design.py in plain C, where the same steps by the same names are
 * explained. Results agree up to rounding. */
#ifndef DESIGN_H
#define DESIGN_H

#include <string.h>

#include "matrix.h"
#include "model.h"

static const double PI = 3.14159265358979323846;

/* What a designer chooses, in the order of flexible_manipulator_lqg/interface.py, where units are told. */
typedef struct {
    double stiffness[AXES], hardening, friction[AXES], drift[AXES], motor_noise[AXES], arm_noise, push, push_time;
    double angle_noise, velocity, motor_angle, effort[AXES];
} Weights;

/* For the pose that q_m_ref [rad] and u_m0 [N.m] tell and the sample time T_s [s]. */
bool design(const Weights *of, const double q_m_ref[AXES], const double u_m0[AXES], double T_s, Law *law,
            char message[MODEL_MESSAGE_SIZE]);

ASSERT_LAYOUT(rows_are_whole_blocks, LAW % ROWS == 0);

#endif
