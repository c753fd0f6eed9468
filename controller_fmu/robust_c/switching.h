/* The switching law: what an event is, and how much of the dither and of the other feedbacks acts. */
#ifndef SWITCHING_H
#define SWITCHING_H

#include "events.h"

/* Parameters of the FMU, in the order of interface.py, where units are told. */
typedef struct {
    double amplitude[2], period, headroom, off, rise, memory, threshold, contrast, average_time, dithered, spent, dither_time;
    double sway, sway_share, wait, hold, decay;
    double jump, jump_contrast, jump_time, peak_hold, peak_decay, peak_time, peak_regain;
} Switching;

/* The errors; the slow average of the motion [m]; the level [m], and what is left of it after a sample; the fast average of
 * the third estimate, and the slow average of its jumps [m]; times [s] since the last event, the first one of those that
 * still act, the last motion and the last peak; times [s] that are left to the dither and to the third law. */
typedef struct {
    Errors errors;
    Left left;
    double left_level, unrest, level, fast[2], jumps;
    double since_event, since_first, since_sway, since_peak, dither_left, peak_left;
} Watch;

/* The thresholds of an arm with this reach, relative to the stretched one. The filters take what a folded arm does for a
 * larger error than it is, by a factor of 3 at q_a2 = 80 degrees. */
static inline void scale(Switching *by, double reach)
{
    by->threshold /= reach;
    by->sway /= reach;
    by->jump /= reach;
}

/* At rest: no event, no motion and no peak yet. */
static inline Watch watch(const Switching *by, double T_s)
{
    const double over = by->hold + by->decay;
    return (Watch){.errors = {.window = (int)window_of(by->period, T_s)},
                   .left = {left_of(by->average_time, T_s), left_of(by->jump_time, T_s)},
                   .left_level = left_of(by->memory, T_s),
                   .since_event = over, .since_first = over, .since_sway = over, .since_peak = by->peak_hold + by->peak_decay,
                   .dither_left = by->dither_time, .peak_left = by->peak_time};
}

/* How much of the third law acts, which a jump begins: its estimate is further than `jump` from its fast average, and than
 * `jump_contrast` times what it has been of late. A force does that within 30 ms; the arm's answer to a chirp grows from
 * period to period. The time is limited: the law would not bear the gain and the delay of A1 and A2. */
static inline double of_peak(Watch *on, const Switching *by, const double error[2], double T_s)
{
    const double jump = elementary_hypot(error[0] - on->fast[0], error[1] - on->fast[1]);
    const bool begins = jump > by->jump && jump > by->jump_contrast * on->jumps && on->peak_left > 0.0;
    for (int i = 0; i < 2; i++)
        smooth(&on->fast[i], error[i], on->left.jump);
    smooth(&on->jumps, jump, on->left.average);
    on->since_peak = choose(begins, 0.0, on->since_peak + T_s);
    const double share = faded(by->peak_hold, by->peak_decay, on->since_peak);
    on->peak_left = fmin(by->peak_time, on->peak_left + T_s * (by->peak_regain - choose(share > 0.0, 1.0, 0.0)));
    return share;
}

/* Takes the TCP error [m] of this sample as the event's filter and the peak's estimate it. */
static inline Shares shares(Watch *on, const Switching *by, const double error[2], const double peak[2], double T_s)
{
    const double over = by->hold + by->decay, moved = motion(&on->errors, error, on->left.average);
    const bool has_time = on->dither_left > 0.0, shaken = fmin(on->since_event, on->since_sway) < over;
    /* The dither's end moves the arm, and one that wakes itself again and again would be a limit cycle. */
    const double least = by->threshold * choose(has_time, choose(shaken, by->dithered, 1.0), by->spent);
    const bool event = moved > least && moved > by->contrast * on->unrest;
    /* A further event does not bring back the first law: the damping one acts already. */
    on->since_first = choose(event && on->since_event >= over, 0.0, on->since_first) + T_s;
    on->since_event = choose(event, 0.0, on->since_event + T_s);
    on->since_sway = choose(moved > by->sway && has_time, 0.0, on->since_sway + T_s);
    smooth(&on->unrest, moved, on->left.average);
    on->level = fmax(elementary_hypot(error[0], error[1]), on->level * on->left_level);
    const double wanted = limited((on->level - by->off) / by->rise, 0.0, 1.0);
    const double acts = faded(by->hold, by->decay, on->since_event);
    const double dither = fmin(wanted, fmax(acts, by->sway_share * faded(by->hold, by->decay, on->since_sway)));
    /* The stiff feedback keeps the first peak lower; the damping one is for what comes after it. */
    const double passed = limited(on->since_first / by->wait - 1.0, 0.0, 1.0);
    on->dither_left -= choose(dither > 0.0, T_s, 0.0);
    return (Shares){dither, fmin(wanted, acts) * passed, of_peak(on, by, peak, T_s)};
}

#endif
