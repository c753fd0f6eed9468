/* A controller without dynamics, u_m = u_m0 + K (q_m_ref - q_m), that can be told to be late and to go wrong. */
#include <math.h>
#include <stdio.h>

#include "model.h"

enum { AXES = 2, LONGEST = 16 };

typedef struct {
    double q_m_ref[AXES]; /* input [rad] */
    double q_m[AXES];     /* input [rad] */
    double u_m[AXES];     /* output [N.m] */
    double u_m0[AXES];    /* parameter [N.m] */
    double K;             /* parameter [N.m/rad] */
    double lag;           /* parameter [1]: by how many samples u_m is late */
    double forgetful;     /* parameter [1]: 1 halves the gain with every sample */
    double nan_from;      /* parameter [s] 1e9: from this time on u_m[2] is not a number */
    double fail_from;     /* parameter [s] 1e9: from this time on steps fail */
    double past[LONGEST][AXES];
    int steps;
} Feedthrough;

const size_t model_size = sizeof(Feedthrough);
const size_t model_variables = offsetof(Feedthrough, past) / sizeof(double);

void model_start(void *model) { ((Feedthrough *)model)->nan_from = ((Feedthrough *)model)->fail_from = 1e9; }

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Feedthrough *own = model;
    for (int i = 0; i < AXES; i++) own->u_m[i] = own->u_m0[i];
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Feedthrough *own = model;
    if (t >= own->fail_from) {
        snprintf(message, MODEL_MESSAGE_SIZE, "out of ink at t = %g s", t);
        return false;
    }
    const int now = own->steps++, then = now - (int)own->lag;
    for (int i = 0; i < AXES; i++) {
        own->past[now % LONGEST][i] = own->K * (own->q_m_ref[i] - own->q_m[i]);
        own->u_m[i] = own->u_m0[i] + (then >= 0 ? own->past[then % LONGEST][i] : 0.0);
    }
    if (own->forgetful != 0.0) own->K *= 0.5;
    if (t >= own->nan_from) own->u_m[1] = NAN;
    return true;
}

double model_sample_time(const void *model) { return 0.25e-3; }
