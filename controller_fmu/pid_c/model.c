/* The diagonal PID of eq. (12), two axes of pid.h, as a model for the FMI glue. */
#include "model.h"

#include <math.h>
#include <stdio.h>

#include "pid.h"

enum { AXES = 2 };

/* The variables in the order of their value references, then what the law remembers. */
typedef struct {
    double q_m_ref[AXES]; /* [rad] */
    double q_m[AXES];     /* [rad] */
    double u_m[AXES];     /* [N.m] */
    double K_p[AXES];     /* [N.m/rad] */
    double K_i[AXES];     /* [N.m/(rad.s)] */
    double K_d[AXES];     /* [N.m.s/rad] */
    double z_p[AXES];     /* [1] */
    double T_s;           /* [s] */
    double u_m0[AXES];    /* [N.m] */

    PidGains gains[AXES];
    PidState states[AXES];
} DiagonalPid;

const size_t model_size = sizeof(DiagonalPid);
const size_t model_variables = offsetof(DiagonalPid, gains) / sizeof(double);

void model_start(void *model)
{
    DiagonalPid *pid = model;
    static const double K_p[AXES] = {45.0, 15.0}, K_i[AXES] = {30.0, 10.0}, K_d[AXES] = {1.5, 0.5};
    for (int i = 0; i < AXES; i++) {
        pid->K_p[i] = K_p[i];
        pid->K_i[i] = K_i[i];
        pid->K_d[i] = K_d[i];
        pid->z_p[i] = 0.95;
    }
    pid->T_s = 0.25e-3;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    DiagonalPid *pid = model;
    for (int i = 0; i < AXES; i++) {
        pid->gains[i] = (PidGains){pid->K_p[i], pid->K_i[i], pid->K_d[i], pid->z_p[i], pid->T_s};
        pid->states[i] = (PidState){.s = pid->u_m0[i]};
        pid->u_m[i] = pid->u_m0[i];
    }
    if (!(pid->T_s > 0.0 && isfinite(pid->T_s))) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "parameter T_s = %.15g s: the sample time must be positive and finite", pid->T_s);
        return false;
    }
    for (int i = 0; i < AXES; i++) {
        if (!(0.0 <= pid->z_p[i] && pid->z_p[i] < 1.0)) {
            snprintf(message, MODEL_MESSAGE_SIZE,
                     "parameter z_p[%d] = %.15g: the filter pole must lie in 0 <= z_p < 1", i + 1,
                     pid->z_p[i]);
            return false;
        }
    }
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    DiagonalPid *pid = model;
    PidState states[AXES];
    double u_m[AXES];
    for (int i = 0; i < AXES; i++) {
        states[i] = pid_sample(pid->gains[i], pid->states[i], pid->q_m_ref[i] - pid->q_m[i]);
        u_m[i] = pid_torque(pid->gains[i], states[i]);
        if (!isfinite(u_m[i])) {
            snprintf(message, MODEL_MESSAGE_SIZE, "u_m[%d] = %g N.m at t = %.15g s: the torque must be finite", i + 1,
                     u_m[i], t);
            return false;
        }
    }
    for (int i = 0; i < AXES; i++) {
        pid->states[i] = states[i];
        pid->u_m[i] = u_m[i];
    }
    return true;
}

double model_sample_time(const void *model) { return ((const DiagonalPid *)model)->gains[0].T_s; }
