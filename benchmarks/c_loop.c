/* The bare closed loop of two FMI 2.0 co-simulation slaves in C: what no master can be faster than. It has no
 * noise, delay, quantization, saturation, disturbance or record; a step uses the torque of the same sample. */
#include <stddef.h>

typedef int (*Set)(void *instance, const unsigned references[], size_t n, const double values[]);
typedef int (*Step)(void *instance, double time, double step, int no_set_state);
typedef int (*Get)(void *instance, const unsigned references[], size_t n, double values[]);

typedef struct {
    void *instance;
    Set set;
    Step step;
    Get get;
    const unsigned *inputs, *outputs; /* two inputs; outputs begin with two that are the other's inputs */
    size_t n_outputs;                 /* at most 4 */
} Slave;

/* Returns 0, or the first FMI status above warning. */
int c_loop(const Slave *plant, const Slave *controller, double sample_time, long samples)
{
    double q_m[4] = {0.0}, u_m[4] = {0.0};
    if (plant->get(plant->instance, plant->outputs, plant->n_outputs, q_m) > 1) return -1;
    for (long k = 0; k < samples; k++) {
        const double t = k * sample_time;
        int status;
        if ((status = controller->set(controller->instance, controller->inputs, 2, q_m)) > 1) return status;
        if ((status = controller->step(controller->instance, t, sample_time, 1)) > 1) return status;
        if ((status = controller->get(controller->instance, controller->outputs, 2, u_m)) > 1) return status;
        if ((status = plant->set(plant->instance, plant->inputs, 2, u_m)) > 1) return status;
        if ((status = plant->step(plant->instance, t, sample_time, 1)) > 1) return status;
        if ((status = plant->get(plant->instance, plant->outputs, plant->n_outputs, q_m)) > 1) return status;
    }
    return 0;
}
