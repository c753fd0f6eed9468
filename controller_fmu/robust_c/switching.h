/* The switching law: what an event is, how much of the event's feedback and dither acts, and the dither's wave. */
#ifndef SWITCHING_H
#define SWITCHING_H

#include <math.h>

/* Parameters of the FMU, in the order of interface.py, where units are told. */
typedef struct {
    double amplitude[2], period, headroom, off, rise, memory, threshold, contrast, jump_time, average_time, fatigue, wait, hold, decay;
} Switching;

/* Levels [m], slow averages of the error and of its distance from its average, which is a jump [m], the largest jump
 * of an event [m], time since the last event [s], number of the sample. */
typedef struct {
    double level, average[2], unrest, peak, since, sample;
} Watch;

/* How much of the event's dither and of its feedback acts, 0 to 1. */
typedef struct {
    double dither, feedback;
} Shares;

static inline double limited(double x, double least, double most) { return fmin(fmax(x, least), most); }

/* No event yet. */
static inline Watch watch(const Switching *by) { return (Watch){.since = by->hold + by->decay}; }

/* Takes the estimated TCP error [m] of this sample. */
static inline Shares shares(Watch *on, const Switching *by, const double error[2], double T_s)
{
    const double jump = hypot(error[0] - on->average[0], error[1] - on->average[1]);
    /* What the dither itself does is no new event: after one, only a larger jump is. */
    const bool is_event = jump > by->threshold && jump > by->contrast * fmax(on->unrest, on->peak);
    on->since = is_event ? 0.0 : on->since + T_s;
    on->peak *= exp(-T_s / by->fatigue);
    if (on->since < by->hold + by->decay) on->peak = fmax(on->peak, jump);
    on->unrest += (jump - on->unrest) * (1.0 - exp(-T_s / by->average_time));
    for (int i = 0; i < 2; i++)
        on->average[i] += (error[i] - on->average[i]) * (1.0 - exp(-T_s / by->jump_time));
    on->level = fmax(hypot(error[0], error[1]), on->level * exp(-T_s / by->memory));
    const double cap = limited(1.0 - (on->since - by->hold) / by->decay, 0.0, 1.0);
    const double dither = fmin(limited((on->level - by->off) / by->rise, 0.0, 1.0), cap);
    /* The stiff feedback keeps the first peak lower; the damping one is for what comes after it. */
    return (Shares){dither, dither * limited(on->since / by->wait - 1.0, 0.0, 1.0)};
}

/* The square wave, 1 or -1, in this sample. */
static inline double wave(Watch *on, const Switching *by, double T_s)
{
    const double period = by->period / T_s, phase = fmod(on->sample, period);
    on->sample += 1.0;
    return phase < 0.5 * period ? 1.0 : -1.0;
}

/* What `axis` is shaken with [N.m]: a loop gain up to the headroom leaves torque and dither together within the
 * drive's limit, which would make a net torque of the dither. */
static inline double amplitude(const Switching *by, int axis, double u_m0, double limit)
{
    return fmin(by->amplitude[axis], fmax(limit - fabs(u_m0), 0.0) / by->headroom);
}

#endif
