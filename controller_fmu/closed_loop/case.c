#include "case.h"

#include <math.h>
#include <string.h>

#include "elementary.h"

double block[BLOCK], force[2];
Outcome outcome;

void force_of(double size, double phi_F)
{
    double sine, cosine;
    elementary_sin_cos(phi_F, &sine, &cosine);
    force[0] = size * cosine;
    force[1] = size * sine;
}

void simulate_case(void)
{
    static Curves curves;
    static bool begun;
    Rules rules;
    memcpy(&rules, block, sizeof rules);
    const long samples = (long)rules.samples, latest = (long)rules.latest;
    const double sample_time = rules.numerator / rules.denominator;
    if (begun) loop_end();
    begun = true;
    outcome.judged_until = NAN;
    for (int i = 0; i < FIGURES; i++)
        outcome.figures[i] = NAN;
    if (loop_begin(block + sizeof rules / sizeof *block, latest > samples ? latest : samples, sample_time,
                   (long)rules.ticks, rules.abort_distance))
        loop_run(samples);
    if (record.reason == FINISHED) {
        measure(&rules, outcome.figures, &curves);
        if (in_doubt(&rules, outcome.figures, &curves)) {
            loop_run(latest);
            measure(&rules, outcome.figures, &curves);
        }
    }
    outcome.reason = record.reason;
    outcome.verdict = verdict(&rules, outcome.figures);
    outcome.time = (double)record.sample * rules.numerator / rules.denominator;
    if (!isnan(outcome.figures[LIMIT_CYCLE])) outcome.judged_until = outcome.time;
}
