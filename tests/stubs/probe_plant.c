/* A plant that shows when things happen: its angles are given functions of time, and it notes when a torque
 * other than u_m0 first acts on each axis. */
#include <math.h>
#include <stdio.h>

#include "model.h"

enum { AXES = 2 };

/* The end of a step may miss a time by rounding; nothing in a test happens closer together than this [s]. */
static const double CLOSE = 1e-10;

typedef struct {
    double u_m[AXES];       /* [N.m] */
    double u_d[AXES];       /* [N.m] */
    double F[AXES];         /* [N] */
    double q_m[AXES];       /* [rad] */
    double q_a[AXES];       /* [rad] */
    double X[AXES];         /* [m] */
    double arrival[AXES];   /* when u_m first differed from u_m0 at the beginning of a step, -1 if never [s] */
    double acting[AXES];    /* u_m in the last step [N.m] */
    double disturbing[AXES];/* u_d in the last step [N.m] */
    double pushing[AXES];   /* F in the last step [N] */
    double steps;           /* steps so far [1] */
    double q_m_ref[AXES];   /* [rad] */
    double u_m0[AXES];      /* [N.m] */
    double q_a_start[AXES]; /* [rad] */
    double rest[AXES];      /* q_m_ref to publish [rad] */
    double hold[AXES];      /* u_m0 to publish [N.m] */
    double rate[AXES];      /* slope of q_m over time [rad/s] */
    double jump_at[AXES];   /* when q_m jumps [s] */
    double jump[AXES];      /* by how much [rad] */
    double far_from;        /* from this time on X[1] is 10 m [s] */
    double fail_from;       /* from this time on steps fail [s] */
} ProbePlant;

const size_t model_size = sizeof(ProbePlant);
const size_t model_variables = sizeof(ProbePlant) / sizeof(double);

size_t model_extent(unsigned value_reference)
{
    (void)value_reference;
    return 1;
}

static void show(ProbePlant *own, double t)
{
    for (int i = 0; i < AXES; i++) {
        own->q_m[i] = own->q_m_ref[i] + own->rate[i] * t;
        if (t > own->jump_at[i] - CLOSE) own->q_m[i] += own->jump[i];
    }
    own->X[0] = t > own->far_from - CLOSE ? 10.0 : 0.0;
}

void model_start(void *model)
{
    ProbePlant *own = model;
    own->far_from = own->fail_from = 1e9;
    for (int i = 0; i < AXES; i++) own->jump_at[i] = 1e9;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    ProbePlant *own = model;
    (void)message;
    for (int i = 0; i < AXES; i++) {
        own->q_m_ref[i] = own->rest[i];
        own->u_m0[i] = own->hold[i];
        own->q_a[i] = own->q_a_start[i];
        own->arrival[i] = -1.0;
    }
    show(own, 0.0);
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    ProbePlant *own = model;
    if (t > own->fail_from - CLOSE) {
        snprintf(message, MODEL_MESSAGE_SIZE, "a gear broke at t = %g s", t);
        return false;
    }
    for (int i = 0; i < AXES; i++) {
        if (own->arrival[i] < 0.0 && own->u_m[i] != own->u_m0[i]) own->arrival[i] = t;
        own->acting[i] = own->u_m[i];
        own->disturbing[i] = own->u_d[i];
        own->pushing[i] = own->F[i];
    }
    own->steps += 1.0;
    show(own, t + h);
    return true;
}

double model_sample_time(const void *model)
{
    (void)model;
    return 1.0;
}
