/* A controller without dynamics, u_m = u_m0 + K (q_m_ref - q_m), that can be told to go wrong. */
#include <math.h>
#include <stdio.h>

#include "model.h"

enum { AXES = 2 };

typedef struct {
    double q_m_ref[AXES]; /* [rad] */
    double q_m[AXES];     /* [rad] */
    double u_m[AXES];     /* [N.m] */
    double u_m0[AXES];    /* [N.m] */
    double K;             /* [N.m/rad] */
    double nan_from;      /* from this time on u_m[2] is no number [s] */
    double fail_from;     /* from this time on steps fail [s] */
} Feedthrough;

const size_t model_size = sizeof(Feedthrough);
const size_t model_variables = sizeof(Feedthrough) / sizeof(double);

size_t model_extent(unsigned value_reference) { return value_reference < 8 ? AXES : 1; }

void model_start(void *model)
{
    Feedthrough *own = model;
    own->nan_from = own->fail_from = 1e9;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Feedthrough *own = model;
    (void)message;
    for (int i = 0; i < AXES; i++) own->u_m[i] = own->u_m0[i];
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Feedthrough *own = model;
    (void)h;
    if (t >= own->fail_from) {
        snprintf(message, MODEL_MESSAGE_SIZE, "out of ink at t = %g s", t);
        return false;
    }
    for (int i = 0; i < AXES; i++) own->u_m[i] = own->u_m0[i] + own->K * (own->q_m_ref[i] - own->q_m[i]);
    if (t >= own->nan_from) own->u_m[1] = NAN;
    return true;
}

double model_sample_time(const void *model)
{
    (void)model;
    return 1.0;
}
