/* A plant that costs next to nothing: each motor is a leaky integrator of its torque, and the tool stays where it is.
 * What a simulation with it takes is the master's own time. */
#include "model.h"

#include "interface.h" /* the variables of the manipulator in C */

const size_t model_size = sizeof(Variables);
const size_t model_variables = sizeof(Variables) / sizeof(double);

void model_start(void *model) { *(Variables *)model = START; }

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE]) { return true; }

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Variables *of = model;
    for (int i = 0; i < 2; i++)
        of->q_m[i] += h * (of->u_m[i] + of->u_d[i] - of->q_m[i]);
    return true;
}

double model_sample_time(const void *model) { return 1.0; }
