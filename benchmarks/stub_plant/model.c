/* A plant that costs next to nothing: each motor is a leaky integrator of its torque, and the tool stays where
 * it is. What a simulation with it takes is the master's own time. */
#include "model.h"

enum { AXES = 2 };

typedef struct {
    double u_m[AXES];       /* [N.m] */
    double u_d[AXES];       /* [N.m] */
    double F[AXES];         /* [N] */
    double q_m[AXES];       /* [rad] */
    double q_a[AXES];       /* [rad] */
    double X[AXES];         /* [m] */
    double q_m_ref[AXES];   /* [rad] */
    double u_m0[AXES];      /* [N.m] */
    double q_a_start[AXES]; /* [rad] */
} StubPlant;

const size_t model_size = sizeof(StubPlant);
const size_t model_variables = sizeof(StubPlant) / sizeof(double);

size_t model_extent(unsigned value_reference)
{
    (void)value_reference;
    return 1;
}

void model_start(void *model) { (void)model; }

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    (void)model;
    (void)message;
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    StubPlant *plant = model;
    (void)t;
    (void)message;
    for (int i = 0; i < AXES; i++) plant->q_m[i] += h * (plant->u_m[i] + plant->u_d[i] - plant->q_m[i]);
    return true;
}

double model_sample_time(const void *model)
{
    (void)model;
    return 1.0;
}
