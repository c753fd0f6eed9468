/* A controller without dynamics whose output is late: u_m = u_m0 + K (q_m_ref - q_m), `lag` samples ago. */
#include "model.h"

enum { AXES = 2, LONGEST = 16 };

typedef struct {
    double q_m_ref[AXES]; /* [rad] */
    double q_m[AXES];     /* [rad] */
    double u_m[AXES];     /* [N.m] */
    double u_m0[AXES];    /* [N.m] */
    double K;             /* [N.m/rad] */
    double lag;           /* [samples] */
    double forgetful;     /* 1: the gain halves with every sample */
    double past[LONGEST][AXES];
    double steps;
} Delayed;

const size_t model_size = sizeof(Delayed);
const size_t model_variables = offsetof(Delayed, past) / sizeof(double);

size_t model_extent(unsigned value_reference) { return value_reference < 8 ? AXES : 1; }

void model_start(void *model) { ((Delayed *)model)->K = 45.0; }

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Delayed *own = model;
    (void)message;
    for (int i = 0; i < AXES; i++) own->u_m[i] = own->u_m0[i];
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Delayed *own = model;
    (void)t, (void)h, (void)message;
    const int now = (int)own->steps, lag = (int)own->lag;
    for (int i = 0; i < AXES; i++) {
        own->past[now % LONGEST][i] = own->K * (own->q_m_ref[i] - own->q_m[i]);
        own->u_m[i] = own->u_m0[i] + (now >= lag ? own->past[(now - lag) % LONGEST][i] : 0.0);
    }
    if (own->forgetful != 0.0) own->K *= 0.5;
    own->steps += 1.0;
    return true;
}

double model_sample_time(const void *model)
{
    (void)model;
    return 0.25e-3;
}
