/* The switching law: what an event is, how much of the event's feedback and dither acts, and the dither's wave. */
#ifndef SWITCHING_H
#define SWITCHING_H

#include "elementary.h"

/* Parameters of the FMU, in the order of interface.py, where units are told. */
typedef struct {
    double amplitude[2], period, headroom, off, rise, memory, threshold, contrast, jump_time, average_time, fatigue;
    double sway, sway_share, wait, hold, decay;
} Switching;

/* Level [m], average of the error and, slower, of that average [m], slow average of the error's distance from its
 * average, which is a jump [m], largest jump of an event [m], time since the last event and since the arm last swayed
 * [s], number of the sample. */
typedef struct {
    double level, average[2], offset[2], unrest, peak, since_event, since_sway, sample;
} Watch;

/* How much of the event's dither and of its feedback acts, 0 to 1. */
typedef struct {
    double dither, feedback;
} Shares;

static inline double limited(double x, double least, double most) { return fmin(fmax(x, least), most); }

/* Neither event nor sway yet. */
static inline Watch watch(const Switching *by)
{
    const double over = by->hold + by->decay;
    return (Watch){.since_event = over, .since_sway = over};
}

/* How strong something still is so long [s] after its cause, 1 to 0. */
static inline double faded(const Switching *by, double since)
{
    return limited(1.0 - (since - by->hold) / by->decay, 0.0, 1.0);
}

/* Takes the estimated TCP error [m] of this sample. */
static inline Shares shares(Watch *on, const Switching *by, const double error[2], double T_s)
{
    const double jump = elementary_hypot(error[0] - on->average[0], error[1] - on->average[1]);
    /* What the dither itself does is no new event: after one, only a larger jump is. */
    const bool is_event = jump > by->threshold && jump > by->contrast * fmax(on->unrest, on->peak);
    on->since_event = is_event ? 0.0 : on->since_event + T_s;
    /* A constant error is no sway: the dither may cause one, and would keep itself up. */
    const bool sways = elementary_hypot(on->average[0] - on->offset[0], on->average[1] - on->offset[1]) > by->sway;
    on->since_sway = sways ? 0.0 : on->since_sway + T_s;
    const double event = faded(by, on->since_event), sway = faded(by, on->since_sway);
    on->peak *= elementary_exp(-T_s / by->fatigue);
    if (fmax(event, sway) > 0.0) on->peak = fmax(on->peak, jump);
    on->unrest += (jump - on->unrest) * (1.0 - elementary_exp(-T_s / by->average_time));
    for (int i = 0; i < 2; i++) {
        on->average[i] += (error[i] - on->average[i]) * (1.0 - elementary_exp(-T_s / by->jump_time));
        on->offset[i] += (on->average[i] - on->offset[i]) * (1.0 - elementary_exp(-T_s / by->average_time));
    }
    on->level = fmax(elementary_hypot(error[0], error[1]), on->level * elementary_exp(-T_s / by->memory));
    const double wanted = limited((on->level - by->off) / by->rise, 0.0, 1.0);
    /* The stiff feedback keeps the first peak lower; the damping one is for what comes after it. */
    const double passed = limited(on->since_event / by->wait - 1.0, 0.0, 1.0);
    return (Shares){fmin(wanted, fmax(event, by->sway_share * sway)), fmin(wanted, event) * passed};
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
