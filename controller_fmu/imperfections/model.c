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

static const double PI = 3.141592653589793, ON_TICK = 0.01, WORD = 4294967295.0, MOST_TICKS = 1e9;

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

/* Where sample k is remembered. */
static size_t slot(long k) { return (size_t)((unsigned long)k % LINE); }

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
        double *noise = own->noise[slot(own->drawn++)];
        normal_pair(&own->noise_at, wide(own->noise_increment), noise);
        for (int i = 0; i < AXES; i++)
            noise[i] *= own->sigma;
    }
}

/* A parameter and the range it must be in; of some, only whole numbers. */
typedef struct {
    const char *name;
    double value, least, most;
    bool whole;
} Limit;

static bool check_limit(const Limit *of, char message[MODEL_MESSAGE_SIZE])
{
    if (of->value >= of->least && of->value <= of->most && (!of->whole || of->value == floor(of->value))) return true;
    snprintf(message, MODEL_MESSAGE_SIZE, "%s = %.15g refused: it must be %s from %g to %.10g", of->name, of->value,
             of->whole ? "a whole number" : "a number", of->least, of->most);
    return false;
}

static bool check_loop(const Loop *own, char message[MODEL_MESSAGE_SIZE])
{
    const double most = (LINE - 2) * own->ticks_per_sample, *state = own->noise_state, *step = own->noise_increment;
    const Limit limits[] = {
        {"rate", own->rate, 1e-6, 1e9, false},
        {"ticks_per_sample", own->ticks_per_sample, 1.0, 1e6, true},
        {"sensor_delay[1]", own->sensor_delay[0], 0.0, most, true},
        {"sensor_delay[2]", own->sensor_delay[1], 0.0, most, true},
        {"drive_delay[1]", own->drive_delay[0], 1.0, most, true},
        {"drive_delay[2]", own->drive_delay[1], 1.0, most, true},
        {"angle_quantum", own->angle_quantum, 0.0, 1e12, false},
        {"torque_quantum[1]", own->torque_quantum[0], 0.0, 1e12, false},
        {"torque_quantum[2]", own->torque_quantum[1], 0.0, 1e12, false},
        {"limit[1]", own->limit[0], 0.0, 1e300, false},
        {"limit[2]", own->limit[1], 0.0, 1e300, false},
        {"sigma", own->sigma, 0.0, 1e12, false},
        {"noise_state[1]", state[0], 0.0, WORD, true},
        {"noise_state[2]", state[1], 0.0, WORD, true},
        {"noise_state[3]", state[2], 0.0, WORD, true},
        {"noise_state[4]", state[3], 0.0, WORD, true},
        {"noise_increment[1]", step[0], 0.0, WORD, true},
        {"noise_increment[2]", step[1], 0.0, WORD, true},
        {"noise_increment[3]", step[2], 0.0, WORD, true},
        {"noise_increment[4]", step[3], 0.0, WORD, true},
    };
    for (size_t i = 0; i < sizeof limits / sizeof *limits; i++)
        if (!check_limit(&limits[i], message)) return false;
    /* With an even increment the generator may stay at one number for ever, and never find a pair. */
    if (own->sigma == 0.0 || fmod(step[3], 2.0) == 1.0) return true;
    snprintf(message, MODEL_MESSAGE_SIZE,
             "noise_increment[4] = %.15g refused: where sigma is not 0 it must be odd, as in PCG64", step[3]);
    return false;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Loop *own = model;
    memset(&own->tick, 0, sizeof(Loop) - offsetof(Loop, tick));
    own->per_sample = 1;
    if (!check_loop(own, message)) return false;
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
            own->measured[slot(k)][i] = own->q_m[i] + own->noise[slot(k)][i];
        if (own->tick > 0 && own->tick % own->per_sample == 0)
            own->command[slot(own->tick / own->per_sample - 1)][i] = own->u_c[i];
    }
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Loop *own = model;
    const double begin = t * own->rate, end = (t + h) * own->rate;
    const double tick = (double)own->tick;
    if (!(begin >= tick - ON_TICK && begin <= tick + 1.0 && end < MOST_TICKS)) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.15g s at t = %.15g s refused: time begins at 0, goes on from the step before, and ends "
                 "before %.15g s",
                 h, t, MOST_TICKS / own->rate);
        return false;
    }
    if (!(end <= floor(begin + ON_TICK) + 1.0 + ON_TICK)) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.15g s at t = %.15g s refused: it must not go beyond the plant's next one, which are "
                 "%.15g s long", h, t, 1.0 / own->rate);
        return false;
    }
    if (own->on_tick) take(own);
    own->on_tick = fabs(end - rint(end)) < ON_TICK;
    if (own->on_tick) own->tick = (long)rint(end);
    draw(own);
    return true;
}

/* A quantum below the resolution of the value itself rounds nothing, and dividing by it could overflow. */
static double quantize(double value, double quantum)
{
    return quantum > 1e-100 ? rint(value / quantum) * quantum : value;
}

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
    if (k >= 0) angle = own->sensor_delay[i] == 0.0 ? own->q_m[i] + own->noise[slot(k)][i] : own->measured[slot(k)][i];
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
        wave = elementary_sin(2.0 * PI * (own->chirp_f_start * tau + sweep));
    }
    for (int i = 0; i < AXES; i++) {
        if (own->tick % own->per_sample == 0) own->y[i] = sensor(own, i);
        const long k = samples(own, own->tick - (long)own->drive_delay[i]), newest = samples(own, own->tick - 1);
        own->u_m[i] = k < 0 ? own->u_m0[i] : drive(own, i, k == newest ? own->u_c[i] : own->command[slot(k)][i]);
        own->u_d[i] = shaken ? own->chirp_amplitude[i] * wave : 0.0;
        own->F[i] = pushed ? own->force[i] : 0.0;
    }
}
