/* A plant that shows when things happen: its angles are given functions of time, and it notes when a torque acts. */
#include <math.h>
#include <stdio.h>

#include "model.h"

enum { AXES = 2 };

/* The end of a step may miss a time by rounding; nothing in a test happens closer together than this [s]. */
static const double CLOSE = 1e-10;

typedef struct {
    double u_m[AXES];        /* input [N.m] */
    double u_d[AXES];        /* input [N.m] */
    double F[AXES];          /* input [N] */
    double q_m[AXES];        /* output [rad] */
    double q_a[AXES];        /* output [rad] */
    double X[AXES];          /* output [m] */
    double arrival[AXES];    /* output [s]: when u_m first differed from u_m0 at the beginning of a step, -1 if never */
    double acting[AXES];     /* output [N.m]: u_m in the last step */
    double disturbing[AXES]; /* output [N.m]: u_d in the last step */
    double pushing[AXES];    /* output [N]: F in the last step */
    double steps;            /* output [1]: steps so far */
    double q_m_ref[AXES];    /* calculatedParameter [rad] */
    double u_m0[AXES];       /* calculatedParameter [N.m] */
    double q_a_start[AXES];  /* parameter [rad] */
    double rest[AXES];       /* parameter [rad]: q_m_ref to publish */
    double hold[AXES];       /* parameter [N.m]: u_m0 to publish */
    double rate[AXES];       /* parameter [rad/s]: slope of q_m over time */
    double jump_at[AXES];    /* parameter [s] 1e9: when q_m jumps */
    double jump[AXES];       /* parameter [rad]: by how much */
    double far_from;         /* parameter [s] 1e9: from this time on X[1] is 10 m */
    double fail_from;        /* parameter [s] 1e9: from this time on steps fail */
    double broken;           /* parameter [1]: what jumps is 1 no number, 2 infinite */
} ProbePlant;

const size_t model_size = sizeof(ProbePlant);
const size_t model_variables = sizeof(ProbePlant) / sizeof(double);

static void show(ProbePlant *own, double t)
{
    for (int i = 0; i < AXES; i++) {
        own->q_m[i] = own->q_m_ref[i] + own->rate[i] * t;
        if (t > own->jump_at[i] - CLOSE)
            own->q_m[i] += own->broken == 0.0 ? own->jump[i] : own->broken == 1.0 ? NAN : INFINITY;
    }
    own->X[0] = t > own->far_from - CLOSE ? 10.0 : 0.0;
}

void model_start(void *model)
{
    ProbePlant *own = model;
    own->far_from = own->fail_from = own->jump_at[0] = own->jump_at[1] = 1e9;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    ProbePlant *own = model;
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

double model_sample_time(const void *model) { return 1.0; }
