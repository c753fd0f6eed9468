/* The LQG design of flexible_manipulator_lqg/design.py in plain C, where the same steps by the same names are
 * explained. Results agree up to rounding. */
#ifndef DESIGN_H
#define DESIGN_H

#include "interface.h" /* written by the build: Variables */
#include "matrix.h"

static const double PI = 3.14159265358979323846;

enum { AXES = 2, LAW = N + 2 * AXES, U = N, E = N + AXES };

/* (z+, torque about u_m0, estimated TCP error) = law (z, u, e). */
typedef struct {
    double of[LAW][LAW];
} Law;

/* False if a Riccati equation has no stabilizing solution that the doubling algorithm could find. */
bool design(const Variables *of, Law *law);

#endif
