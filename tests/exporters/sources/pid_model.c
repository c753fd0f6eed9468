/* The PID of eq. (13) on any number of axes, with the choices that exporters differ in; build.h makes them. */
#include "model.h"

#include "build.h" /* written by the recipe */
#include "pid.h"

/* The variables in the order of their value references, then what the law remembers. */
typedef struct {
    double q_m_ref[AXES]; /* [ANGLE rad] */
    double q_m[AXES];     /* [ANGLE rad] */
    double u_m[AXES];     /* [TORQUE N.m] */
    double u_m0[AXES];    /* [TORQUE N.m] */
    PidState states[AXES];
    bool stepped;
} Pid;

static const PidGains gains[AXES] = GAINS;

const size_t model_size = sizeof(Pid);
const size_t model_variables = offsetof(Pid, states) / sizeof(double);

void model_start(void *model) {}

static void sample(Pid *pid)
{
    for (int i = 0; i < AXES; i++) {
        const double e = pid->q_m_ref[i] * ANGLE - pid->q_m[i] * ANGLE;
        pid->states[i] = pid_sample(gains[i], pid->states[i], e);
        pid->u_m[i] = pid_torque(gains[i], pid->states[i]) / TORQUE;
    }
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Pid *pid = model;
    for (int i = 0; i < AXES; i++) {
        pid->states[i] = (PidState){.s = pid->u_m0[i] * TORQUE};
        pid->u_m[i] = pid->u_m0[i];
    }
    if (SAMPLES_AT_INITIALIZATION) sample(pid);
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Pid *pid = model;
    if (!pid->stepped && SAMPLES_TWICE_FIRST) sample(pid);
    sample(pid);
    return pid->stepped = true;
}

double model_sample_time(const void *model) { return gains[0].T_s; }
