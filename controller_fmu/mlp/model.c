/* A policy as a model for the FMI glue: u_m = u_m0 + network(observation), a multilayer perceptron.
 *
 * The observation is that of starters/policy/manipulator_observation.py, operation by operation. Products are summed
 * column by column: that is what compilers vectorize without changing their order.
 */
#include "model.h"

#include <stdio.h>

#include "elementary.h"
#include "weights.h" /* written by the build: LAYERS, WIDTH, SIZE, WEIGHTS, ACTIVATION */

enum { AXES = 2 };

static const double T_S = 0.25e-3; /* sample time [s] */
static const double Z_P = 0.95;    /* pole of the derivative filter */

/* The variables in the order of their value references, then what the observation remembers. */
typedef struct {
    double q_m_ref[AXES]; /* [rad] */
    double q_m[AXES];     /* [rad] */
    double u_m[AXES];     /* [N.m] */
    double u_m0[AXES];    /* [N.m] */

    double e[AXES]; /* position error [rad] */
    double v[AXES]; /* its filtered derivative [rad/s] */
    double s[AXES]; /* its integral [rad.s] */
} Policy;

const size_t model_size = sizeof(Policy);
const size_t model_variables = offsetof(Policy, e) / sizeof(double);

double model_sample_time(const void *model) { return T_S; }

void model_start(void *model) {}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Policy *my = model;
    for (int i = 0; i < AXES; i++) {
        my->e[i] = my->v[i] = my->s[i] = 0.0;
        my->u_m[i] = my->u_m0[i];
    }
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Policy *my = model, next = *my;
    double x[WIDTH], y[WIDTH];
    for (int i = 0; i < AXES; i++) {
        const double e = my->q_m_ref[i] - my->q_m[i];
        next.v[i] = Z_P * my->v[i] + (1.0 - Z_P) * (e - my->e[i]) / h;
        next.s[i] = my->s[i] + h * e;
        next.e[i] = e;
        x[i] = e, x[AXES + i] = next.v[i], x[2 * AXES + i] = next.s[i], x[3 * AXES + i] = my->q_m_ref[i];
    }
    const double *w = WEIGHTS; /* of each layer W by columns, then b */
    for (int layer = 0; layer < LAYERS; layer++) {
        const int inputs = SIZE[layer], outputs = SIZE[layer + 1];
        for (int i = 0; i < outputs; i++)
            y[i] = 0.0;
        for (int j = 0; j < inputs; j++, w += outputs)
            for (int i = 0; i < outputs; i++)
                y[i] += w[i] * x[j];
        for (int i = 0; i < outputs; i++)
            x[i] = layer + 1 < LAYERS ? ACTIVATION(y[i] + w[i]) : y[i] + w[i];
        w += outputs;
    }
    for (int i = 0; i < AXES; i++) {
        next.u_m[i] = my->u_m0[i] + x[i];
        if (isfinite(next.u_m[i])) continue;
        snprintf(message, MODEL_MESSAGE_SIZE, "u_m[%d] = %g N.m at t = %.15g s: the torque must be finite", i + 1,
                 next.u_m[i], t);
        return false;
    }
    *my = next;
    return true;
}
