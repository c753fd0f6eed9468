/* The switching law of SteadyLQG: that of RobustLQG without a part that is limited in time. What stops dither and third law
 * is how they are begun. */
#ifndef SWITCHING_H
#define SWITCHING_H

#include <stdbool.h>

#include "events.h"

/* Parameters of the FMU, in the order of interface.py, where units are told. */
typedef struct {
    double amplitude[2], period, headroom, threshold, contrast, average_time, dithered, hold, decay;
    double jump, jump_contrast, jump_time, peak_hold, peak_decay;
    double contrast_time, event_rise, ringing, ringing_fall, ringing_time, ringing_memory, ringing_rise;
} Switching;

/* The errors; the slow average of the motion [m]; the fast average of the third estimate, and the slow average of its jumps
 * [m]; the fast and the slow average of the motion that tell whether it dies out [m]; times [s] since the last event and the
 * last peak; the second law's share. */
typedef struct {
    Errors errors;
    Left left;
    double left_rising, left_lately, left_before, left_before_rising;
    double unrest, fast[2], jumps, lately, before, since_event, since_peak, event;
} Watch;

/* The thresholds of an arm with this reach, relative to the stretched one. */
static inline void scale(Switching *by, double reach)
{
    by->threshold /= reach;
    by->jump /= reach;
}

/* At rest: no event and no peak ever. */
static inline Watch watch(const Switching *by, double T_s)
{
    return (Watch){.errors = {.window = (int)window_of(by->period, T_s)},
                   .left = {left_of(by->average_time, T_s), left_of(by->jump_time, T_s)},
                   .left_rising = left_of(by->contrast_time, T_s),
                   .left_lately = left_of(by->ringing_time, T_s),
                   .left_before = left_of(by->ringing_memory, T_s),
                   .left_before_rising = left_of(by->ringing_rise, T_s),
                   .since_event = INFINITY, .since_peak = INFINITY};
}

/* How much of the third law acts, which a jump begins, as in RobustLQG. A jump while it acts does not prolong it: with the
 * delay of A2 it oscillates by itself, and would take that for further jumps. What oscillates on is no jump to it, since a
 * jump must stand out from the average of the jumps. */
static inline double of_peak(Watch *on, const Switching *by, const double error[2], double T_s)
{
    const double jump = elementary_hypot(error[0] - on->fast[0], error[1] - on->fast[1]);
    const bool acts = on->since_peak < by->peak_hold + by->peak_decay;
    const bool begins = jump > by->jump && jump > by->jump_contrast * on->jumps && !acts;
    for (int i = 0; i < 2; i++)
        smooth(&on->fast[i], error[i], on->left.jump);
    smooth(&on->jumps, jump, on->left.average);
    on->since_peak = choose(begins, 0.0, on->since_peak + T_s);
    return faded(by->peak_hold, by->peak_decay, on->since_peak);
}

/* Whether the arm rings on: a motion that dies out is a free one, over motors that are held by friction. One that does not
 * die out may be the dither's own, with the delay of A2, which must not keep it up. The average that a motion falls below may
 * rise faster than it falls: else that of a force fills too late. */
static inline bool rings(Watch *on, const Switching *by, double moved, double raised)
{
    const bool found = on->lately > by->ringing * raised && on->lately < by->ringing_fall * on->before;
    smooth(&on->lately, moved, on->left_lately);
    smooth(&on->before, moved, choose(moved > on->before, on->left_before_rising, on->left_before));
    return found;
}

/* How many times what an event must pass is raised. The dither's fade moves the arm: the motors stick one after the other, in
 * a pulse that dies out. It must not begin the next dither, nor may what it leaves behind: while it did, dithers followed each
 * other for ever, with 1.125 ms on axis 2. While the dither is at full strength nothing is raised: a weak force then begins its
 * time anew. */
static inline double raised_by(const Watch *on, const Switching *by)
{
    const double still = elementary_exp(-fmax(on->since_event - by->hold - by->decay, 0.0) / by->average_time);
    return choose(on->since_event < by->hold, 1.0, 1.0 + (by->dithered - 1.0) * still);
}

/* Takes the TCP error [m] of this sample as the event's filter and the peak's estimate it. */
static inline Shares shares(Watch *on, const Switching *by, const double error[2], const double peak[2], double T_s)
{
    const double moved = motion(&on->errors, error, on->left.average), raised = raised_by(on, by);
    const bool stands_out = moved > by->threshold * raised && moved > by->contrast * on->unrest;
    const bool event = rings(on, by, moved, raised) || stands_out;
    on->since_event = choose(event, 0.0, on->since_event + T_s);
    smooth(&on->unrest, moved, choose(moved > on->unrest, on->left_rising, on->left.average));
    const double dither = faded(by->hold, by->decay, on->since_event);
    /* The stiff feedback keeps the first peak lower; the damping one is for what comes after it. A jump of its share would be a
     * push: where a chirp brings it back in its fade, that was most of B7. */
    on->event = fmin(dither, on->event + T_s / by->event_rise);
    return (Shares){dither, on->event, of_peak(on, by, peak, T_s)};
}

#endif
