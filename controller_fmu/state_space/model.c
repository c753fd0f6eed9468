/* A linear controller with the drive's limits, as a model for the FMI glue:
 *
 *     e = q_m_ref - q_m,   (x+, v) = law (x, e),   u_m = u_m0 + v within the limits,   x+ += back (u_m - u_m0 - v)
 *
 * The law for the reference is made at the end of initialization of those for the points of the schedule. Sums are
 * taken column by column: that is what compilers vectorize without changing their order.
 */
#include "model.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "gains.h" /* written by the build: T_S, LIMIT, LAW, BACK, POINT, CELL */

enum { AXES = 2, E = ROWS - AXES };

/* The variables in the order of their value references, then what the law remembers. */
typedef struct {
    double q_m_ref[AXES]; /* [rad] */
    double q_m[AXES];     /* [rad] */
    double u_m[AXES];     /* [N.m] */
    double u_m0[AXES];    /* [N.m] */

    double z[ROWS]; /* states, then the error */
    double law[ROWS][ROWS], back[AXES][ROWS]; /* by columns */
} StateSpace;

const size_t model_size = sizeof(StateSpace);
const size_t model_variables = offsetof(StateSpace, z) / sizeof(double);

double model_sample_time(const void *model) { return T_S; }

void model_start(void *model) {}

static void add(StateSpace *own, double weight, unsigned point)
{
    for (int j = 0; j < ROWS; j++)
        for (int i = 0; i < ROWS; i++)
            own->law[j][i] += weight * LAW[point][j][i];
    for (int j = 0; j < AXES; j++)
        for (int i = 0; i < ROWS; i++)
            own->back[j][i] += weight * BACK[point][j][i];
}

static unsigned nearest(const double q[AXES])
{
    unsigned found = 0;
    double least = INFINITY;
    for (unsigned p = 0; p < POINTS; p++) {
        const double first = q[0] - POINT[p][0], second = q[1] - POINT[p][1];
        const double distance = first * first + second * second;
        if (distance < least) least = distance, found = p;
    }
    return found;
}

/* The triangle whose smallest weight is largest contains q, if any does; beyond them all, weights are cut off at 0. */
static void interpolate(StateSpace *own)
{
    double weight[3] = {1.0, 0.0, 0.0}, best = -INFINITY;
    unsigned corner[3] = {0, 0, 0};
    for (unsigned c = 0; c < CELLS; c++) {
        const Cell *cell = &CELL[c];
        const double first = own->q_m_ref[0] - cell->origin[0], second = own->q_m_ref[1] - cell->origin[1];
        double w[3];
        for (int i = 0; i < 2; i++)
            w[i] = cell->inverse[i][0] * first + cell->inverse[i][1] * second;
        w[2] = 1.0 - w[0] - w[1];
        const double least = fmin(fmin(w[0], w[1]), w[2]);
        if (least > best) {
            best = least;
            memcpy(weight, w, sizeof w);
            memcpy(corner, cell->corner, sizeof corner);
        }
    }
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        sum += weight[i] = fmax(weight[i], 0.0);
    for (int i = 0; i < 3; i++)
        add(own, weight[i] / sum, corner[i]);
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    StateSpace *own = model;
    memset(own->z, 0, sizeof(StateSpace) - offsetof(StateSpace, z));
    if (IS_LINEAR)
        interpolate(own);
    else
        add(own, 1.0, nearest(own->q_m_ref));
    for (int i = 0; i < AXES; i++)
        own->u_m[i] = own->u_m0[i];
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    StateSpace *own = model;
    double next[ROWS] = {0.0};
    for (int i = 0; i < AXES; i++)
        own->z[E + i] = own->q_m_ref[i] - own->q_m[i];
    for (int j = 0; j < ROWS; j++)
        for (int i = 0; i < ROWS; i++)
            next[i] += own->law[j][i] * own->z[j];
    for (int j = 0; j < AXES; j++) {
        if (isfinite(next[E + j])) continue;
        snprintf(message, MODEL_MESSAGE_SIZE, "u_m[%d] = %g N.m at t = %.15g s: the torque must be finite", j + 1,
                 next[E + j], t);
        return false;
    }
    memcpy(own->z, next, sizeof next);
    for (int j = 0; j < AXES; j++) {
        const double wanted = own->u_m0[j] + next[E + j];
        const double size = fabs(wanted) > LIMIT[j] ? LIMIT[j] : fabs(wanted);
        own->u_m[j] = copysign(size, wanted);
        if (fabs(wanted) > LIMIT[j])
            for (int i = 0; i < E; i++)
                own->z[i] += own->back[j][i] * (own->u_m[j] - wanted);
    }
    return true;
}
