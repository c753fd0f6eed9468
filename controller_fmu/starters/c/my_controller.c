/* A controller in C: a PID for each axis. Replace what is between the two lines of dashes by your own. */
#include "model.h"

enum { AXES = 2 };
static const double T_S = 0.25e-3; /* sample time [s] */

/* The variables in the order of the value references in modelDescription.xml, then what the controller
 * remembers from one sample to the next. No pointers: the struct is saved and restored by copying it. */
typedef struct {
    double q_m_ref[AXES]; /* input: motor position reference [rad] */
    double q_m[AXES];     /* input: measured motor position [rad] */
    double u_m[AXES];     /* output: motor torque command [N.m] */
    double u_m0[AXES];    /* parameter: torque of the initial steady state [N.m] */
    double K_p[AXES];     /* parameter: proportional gain [N.m/rad] */
    double K_i[AXES];     /* parameter: integral gain [N.m/(rad.s)] */
    double K_d[AXES];     /* parameter: derivative gain [N.m.s/rad] */

    double e[AXES]; /* error at the last sample [rad] */
    double v[AXES]; /* its filtered derivative [rad/s] */
    double s[AXES]; /* integrator [N.m] */
} MyController;

const size_t model_size = sizeof(MyController);
const size_t model_variables = offsetof(MyController, e) / sizeof(double);

double model_sample_time(const void *model) { return T_S; }

/* The start values in modelDescription.xml; what is not set here is zero. */
void model_start(void *model)
{
    static const double K_p[AXES] = {45.0, 15.0}, K_i[AXES] = {30.0, 10.0}, K_d[AXES] = {1.5, 0.5};
    MyController *my = model;
    for (int i = 0; i < AXES; i++) {
        my->K_p[i] = K_p[i];
        my->K_i[i] = K_i[i];
        my->K_d[i] = K_d[i];
    }
}

/* The end of initialization: start from the steady state. */
bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    MyController *my = model;
    for (int i = 0; i < AXES; i++)
        my->u_m[i] = my->s[i] = my->u_m0[i];
    return true;
}

/* One sample, every T_S. */
bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    MyController *my = model;
    /* -------------------------------------------------------------------------------------------- */
    static const double z_p = 0.95; /* pole of the derivative filter */
    for (int i = 0; i < AXES; i++) {
        const double e = my->q_m_ref[i] - my->q_m[i];
        my->v[i] = z_p * my->v[i] + (1.0 - z_p) * (e - my->e[i]) / T_S;
        my->s[i] = my->s[i] + my->K_i[i] * T_S * e;
        my->e[i] = e;
        my->u_m[i] = my->K_p[i] * e + my->K_d[i] * my->v[i] + my->s[i];
    }
    /* -------------------------------------------------------------------------------------------- */
    return true;
}
