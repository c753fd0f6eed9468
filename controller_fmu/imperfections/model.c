/* What the benchmark's master does between controller and plant, as a model for the FMI glue: noise, delay and
 * quantization of the angles, gain, saturation, quantization and delay of the torques, the chirp and the force.
 *
 * Time is counted in ticks, the plant's steps. At a tick, the outputs follow from the inputs at that instant and from
 * what was recorded at earlier ones; between ticks they are held. The torque of a sample is the input from the step
 * after its tick on, so that the controller's step has ended by then: at the next tick it can reach the plant.
 */
#include "model.h"

#include <stdio.h>
#include <string.h>

#include "noise.h"

enum { AXES = 2, LINE = 1024 /* samples that are remembered */ };

static const double PI = 3.141592653589793, ON_TICK = 0.01, WORD = 4294967295.0;

/* The variables in the order of their value references, then what is remembered; samples k at k % LINE. */
typedef struct {
    double q_m[AXES], u_c[AXES];
    double y[AXES], u_m[AXES], u_d[AXES], F[AXES];
    double q_m_ref[AXES], u_m0[AXES];
    double rate, ticks_per_sample, sensor_delay[AXES], drive_delay[AXES];
    double angle_quantum, gain[AXES], limit[AXES], torque_quantum[AXES];
    double sigma, noise_state[4], noise_increment[4];
    double chirp_amplitude[AXES], chirp_start, chirp_stop, chirp_f_start, chirp_f_stop;
    double force[AXES], force_start, force_stop;

    long tick, per_sample, late[AXES], early[AXES], drawn;
    bool on_tick;
    Wide noise_at;
    double noise[LINE][AXES], measured[LINE][AXES], command[LINE][AXES];
} Loop;

const size_t model_size = sizeof(Loop);
const size_t model_variables = offsetof(Loop, tick) / sizeof(double);

size_t model_extent(unsigned value_reference) { return 1; } /* described with scalars only */

double model_sample_time(const void *model) { return INFINITY; }

void model_start(void *model)
{
    Loop *own = model;
    own->rate = 4000.0;
    own->ticks_per_sample = 1.0;
    for (int i = 0; i < AXES; i++) {
        own->drive_delay[i] = own->gain[i] = 1.0;
        own->limit[i] = 1e12;
    }
}

/* Whole samples in so many ticks, downwards. */
static long samples(const Loop *own, long ticks)
{
    return ticks >= 0 ? ticks / own->per_sample : -((own->per_sample - 1 - ticks) / own->per_sample);
}

static Wide wide(const double words[4])
{
    return (Wide){(uint64_t)words[0] << 32 | (uint64_t)words[1], (uint64_t)words[2] << 32 | (uint64_t)words[3]};
}

/* Draws the noise of the samples whose angles are read before the next tick. */
static void draw(Loop *own)
{
    while (own->sigma != 0.0 && own->drawn <= samples(own, own->tick + own->per_sample - 1)) {
        double *noise = own->noise[own->drawn++ % LINE];
        normal_pair(&own->noise_at, wide(own->noise_increment), noise);
        for (int i = 0; i < AXES; i++)
            noise[i] *= own->sigma;
    }
}

static bool whole(double value, double least, double most)
{
    return value >= least && value <= most && value == floor(value);
}

static bool check(const Loop *own, char message[MODEL_MESSAGE_SIZE])
{
    bool fits = own->rate > 0.0 && isfinite(own->rate) && whole(own->ticks_per_sample, 1.0, 1e6);
    const double most = (LINE - 2) * own->ticks_per_sample;
    for (int i = 0; i < AXES; i++)
        fits = fits && whole(own->sensor_delay[i], 0.0, most) && whole(own->drive_delay[i], 1.0, most);
    for (int i = 0; i < 4; i++)
        fits = fits && whole(own->noise_state[i], 0.0, WORD) && whole(own->noise_increment[i], 0.0, WORD);
    if (fits) return true;
    snprintf(message, MODEL_MESSAGE_SIZE,
             "rate must be positive, ticks_per_sample and drive_delay whole numbers from 1, sensor_delay from 0, no "
             "delay beyond %d samples, and the words of the noise whole numbers below 2^32", LINE - 2);
    return false;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Loop *own = model;
    memset(&own->tick, 0, sizeof(Loop) - offsetof(Loop, tick));
    own->per_sample = 1;
    if (!check(own, message)) return false;
    own->per_sample = (long)own->ticks_per_sample;
    own->on_tick = true;
    own->noise_at = wide(own->noise_state);
    for (int i = 0; i < AXES; i++) {
        own->late[i] = samples(own, (long)own->sensor_delay[i]);
        own->early[i] = (long)own->sensor_delay[i] % own->per_sample;
        own->measured[0][i] = own->q_m_ref[i]; /* of a sample that is taken before the start */
    }
    draw(own);
    return true;
}

/* Records what is taken at the present tick. */
static void take(Loop *own)
{
    for (int i = 0; i < AXES; i++) {
        const long k = samples(own, own->tick + own->early[i]);
        if (k * own->per_sample == own->tick + own->early[i])
            own->measured[k % LINE][i] = own->q_m[i] + own->noise[k % LINE][i];
        if (own->tick > 0 && own->tick % own->per_sample == 0)
            own->command[(own->tick / own->per_sample - 1) % LINE][i] = own->u_c[i];
    }
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Loop *own = model;
    const double begin = t * own->rate, end = (t + h) * own->rate;
    if (!(h > 0.0 && fabs(begin) < 1e9 && end <= floor(begin + ON_TICK) + 1.0 + ON_TICK)) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.17g s at t = %.17g s refused: it must not go beyond the plant's next one, which are "
                 "%.17g s long", h, t, 1.0 / own->rate);
        return false;
    }
    if (own->on_tick) take(own);
    own->on_tick = fabs(end - rint(end)) < ON_TICK;
    if (own->on_tick) own->tick = (long)rint(end);
    draw(own);
    return true;
}

static double quantize(double value, double quantum) { return quantum > 0.0 ? rint(value / quantum) * quantum : value; }

static double drive(const Loop *own, int i, double asked)
{
    const double gain = own->gain[i], u_m0 = own->u_m0[i];
    const double torque = gain == 1.0 ? asked : u_m0 + gain * (asked - u_m0);
    return quantize(fmin(fmax(torque, -own->limit[i]), own->limit[i]), own->torque_quantum[i]);
}

static double sensor(const Loop *own, int i)
{
    const long k = own->tick / own->per_sample - own->late[i];
    double angle = own->q_m_ref[i];
    if (k >= 0)
        angle = own->sensor_delay[i] == 0.0 ? own->q_m[i] + own->noise[k % LINE][i] : own->measured[k % LINE][i];
    return quantize(angle, own->angle_quantum);
}

void model_evaluate(void *model)
{
    Loop *own = model;
    if (!own->on_tick) return;
    const double t = (double)own->tick / own->rate;
    const bool shaken = own->chirp_start <= t && t < own->chirp_stop;
    const bool pushed = own->force_start <= t && t < own->force_stop;
    double wave = 0.0;
    if (shaken) {
        const double tau = t - own->chirp_start;
        const double sweep =
            (own->chirp_f_stop - own->chirp_f_start) * tau * tau / (2.0 * (own->chirp_stop - own->chirp_start));
        wave = sin(2.0 * PI * (own->chirp_f_start * tau + sweep));
    }
    for (int i = 0; i < AXES; i++) {
        if (own->tick % own->per_sample == 0) own->y[i] = sensor(own, i);
        const long k = samples(own, own->tick - (long)own->drive_delay[i]), newest = samples(own, own->tick - 1);
        own->u_m[i] =
            k < 0 ? own->u_m0[i] : drive(own, i, k == newest ? own->u_c[i] : own->command[k % LINE][i]);
        own->u_d[i] = shaken ? own->chirp_amplitude[i] * wave : 0.0;
        own->F[i] = pushed ? own->force[i] : 0.0;
    }
}
