/* What the switching laws of RobustLQG and SteadyLQG have in common: averages, the motion of the TCP, and the dither's wave. */
#ifndef EVENTS_H
#define EVENTS_H

#include "elementary.h"

/* Longest window of the moving average, in samples. */
enum { WINDOW = 512 };

/* The errors [m] of the last `window` samples and their sum; the slow average of their mean; number of the sample, and where it
 * is in the window. */
typedef struct {
    double past[WINDOW][2], sum[2], slow[2], sample;
    int window, now;
} Errors;

/* What is left after a sample of the averages of motion and jumps, and of the fast average of the third estimate. */
typedef struct {
    double average, jump;
} Left;

/* How much of the dither, of the event's feedback and of the peak's acts, 0 to 1. */
typedef struct {
    double dither, event, peak;
} Shares;

static inline double limited(double x, double least, double most) { return fmin(fmax(x, least), most); }

/* Samples of the moving average: two periods [s] of the dither, since the arm answers it with a subharmonic as well. */
static inline double window_of(double period, double T_s) { return floor(2.0 * period / T_s + 0.5); }

/* How strong something still is so long [s] after its cause: 1 for `hold`, then down to 0 within `decay`. */
static inline double faded(double hold, double decay, double since) { return limited(1.0 - (since - hold) / decay, 0.0, 1.0); }

/* What is left of a first-order average after a sample; it is computed once, since an exponential takes longer than all else of
 * an average. */
static inline double left_of(double time, double T_s) { return elementary_exp(-T_s / time); }

/* Moves a first-order average, of which so much is left, to its next sample. */
static inline void smooth(double *average, double value, double left) { *average += (value - *average) * (1.0 - left); }

/* How far [m] the mean error of the last window, in which the dither cancels, is from its slow average. */
static inline double motion(Errors *of, const double error[2], double left)
{
    double *oldest = of->past[of->now], moved[2];
    for (int i = 0; i < 2; i++) {
        of->sum[i] += error[i] - oldest[i];
        oldest[i] = error[i];
        moved[i] = of->sum[i] / of->window - of->slow[i];
        smooth(&of->slow[i], of->sum[i] / of->window, left);
    }
    of->now = of->now + 1 < of->window ? of->now + 1 : 0;
    of->sample += 1.0;
    return elementary_hypot(moved[0], moved[1]);
}

/* A square wave of this period [s], 1 or -1, in the sample whose motion was asked for last. */
static inline double square(const Errors *of, double length, double T_s)
{
    const double period = length / T_s, phase = fmod(of->sample - 1.0, period);
    return choose(phase < 0.5 * period, 1.0, -1.0);
}

/* What an axis is shaken with [N.m], up to `most`: a loop gain up to the headroom leaves torque and dither together
 * within the drive's limit, which would make a net torque of the dither. */
static inline double shaken_with(double most, double headroom, double u_m0, double limit)
{
    return fmin(most, fmax(limit - fabs(u_m0), 0.0) / headroom);
}

#endif
