#include "judging.h"

#include <math.h>
#include <stdlib.h>

#include "elementary.h"

static const double PI = 3.141592653589793, MAX_RATIO = 1e6;
static const double VIBRATION_BEGIN = 1.0, VIBRATION_END = 8.0;
enum { VIBRATION_WINDOWS = 8 };

static double larger(double a, double b) { return b > a ? b : a; }
static double smaller(double a, double b) { return b < a ? b : a; }

static double time_of(const Rules *rules, long k) { return (double)k * rules->numerator / rules->denominator; }

/* The first of `states` rows whose time is not below t or, if `beyond`, is above it. */
static long first_from(const Rules *rules, long states, double t, bool beyond)
{
    long low = 0, high = states;
    while (low < high) {
        const long middle = (low + high) / 2;
        const double at = time_of(rules, middle);
        if (beyond ? at <= t : at < t)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* The direction of which number in which the path is measured. */
static void direction(int n, double *cosine, double *sine) { elementary_sin_cos(PI * n / DIRECTIONS, sine, cosine); }

/* Half the extent of the tool's path in each direction. */
static void amplitudes(long begin, long end, double of[DIRECTIONS])
{
    double cosines[DIRECTIONS], sines[DIRECTIONS], lowest[DIRECTIONS] = {0.0}, highest[DIRECTIONS] = {0.0};
    for (int n = 0; n < DIRECTIONS; n++)
        direction(n, &cosines[n], &sines[n]);
    for (long k = begin; k < end; k++) {
        const double x = record.X[k][0] - record.X[begin][0], z = record.X[k][1] - record.X[begin][1];
        for (int n = 0; n < DIRECTIONS; n++) {
            const double place = x * cosines[n] + z * sines[n];
            lowest[n] = smaller(lowest[n], place);
            highest[n] = larger(highest[n], place);
        }
    }
    for (int n = 0; n < DIRECTIONS; n++)
        of[n] = 0.5 * (highest[n] - lowest[n]);
}

static double largest(const double values[], int count)
{
    double found = values[0];
    for (int i = 1; i < count; i++)
        found = larger(found, values[i]);
    return found;
}

/* The numbers of the first samples of the last windows, as many as fit into so many states; returns how many. */
static int windows_in(const Rules *rules, long states, long begins[WINDOWS])
{
    const double end = time_of(rules, states - 1);
    int count = 0;
    for (int n = (int)rules->limit_cycle_windows; n > 0; n--)
        if (n * rules->limit_cycle_window <= end)
            begins[count++] = first_from(rules, states, end - n * rules->limit_cycle_window, false);
    return count;
}

static void fill_curves(const Rules *rules, long states, Curves *curves, long begins[WINDOWS])
{
    curves->windows = windows_in(rules, states, begins);
    for (int w = 0; w < curves->windows; w++) {
        double of[DIRECTIONS];
        amplitudes(begins[w], w + 1 < curves->windows ? begins[w + 1] : states, of);
        for (int n = 0; n < DIRECTIONS; n++)
            curves->of[n][w] = of[n];
    }
}

/* The ratio of an amplitude to the one before; infinity is no number in JSON. */
static double ratio(const double curve[], int w)
{
    const double now = curve[w];
    return now > 0.0 ? now / larger(curve[w - 1], now / MAX_RATIO) : 0.0;
}

static double largest_ratio(const double curve[], int windows)
{
    double found = windows > 1 ? ratio(curve, 1) : 1.0;
    for (int w = 2; w < windows; w++)
        found = larger(found, ratio(curve, w));
    return found;
}

static double smallest_ratio(const double curve[], int windows)
{
    double found = windows > 1 ? ratio(curve, 1) : 0.0;
    for (int w = 2; w < windows; w++)
        found = smaller(found, ratio(curve, w));
    return found;
}

static bool falls(const double curve[], int windows)
{
    for (int w = 1; w < windows; w++)
        if (!(curve[w] < curve[w - 1])) return false;
    return true;
}

/* ---- The doubt ---- */

static double approached(const double curve[], int windows)
{
    if (windows < 3) return 0.0;
    const double first = curve[windows - 3], second = curve[windows - 2], last = curve[windows - 1];
    const double step = second - last, before = first - second;
    return 0.0 < step && step < before ? last - step * step / (before - step) : 0.0;
}

static bool grows(const Rules *rules, const double curve[], int windows)
{
    const double growth = smallest_ratio(curve, windows);
    if (!(growth > 1.0)) return false;
    double grown = curve[windows - 1];
    for (int i = 0; i < (int)rules->left; i++)
        grown *= growth;
    return grown >= rules->limit_cycle;
}

static bool comes_to_rest(const Rules *rules, const double curve[], int windows)
{
    for (int w = 1; w < windows; w++)
        if (!(curve[w] < rules->doubtful || ratio(curve, w) < rules->dying)) return false;
    return approached(curve, windows) < rules->doubtful && !grows(rules, curve, windows);
}

static bool lasts(const Rules *rules, const double curve[], int windows)
{
    double step = 0.0;
    for (int w = 1; w < windows; w++)
        step = larger(step, fabs(curve[w] - curve[w - 1]));
    return curve[windows - 1] - rules->left * step >= rules->limit_cycle;
}

bool in_doubt(const Rules *rules, const double figures[FIGURES], const Curves *curves)
{
    if (rules->left <= 0.0 || curves->windows == 0) return false;
    const int last = curves->windows - 1;
    double widest = curves->of[0][last];
    bool rests = true;
    for (int n = 0; n < DIRECTIONS; n++) {
        if (lasts(rules, curves->of[n], curves->windows)) return false;
        widest = larger(widest, curves->of[n][last]);
        rests = rests && comes_to_rest(rules, curves->of[n], curves->windows);
    }
    const double too_much = figures[REST_ERROR] - rules->rest_error; /* false of NaN */
    return !rests || (0.0 < too_much && too_much <= 2.0 * rules->left * widest);
}

/* ---- The limit cycle ---- */

/* One of the two factors of n that are nearest to each other. */
static long factor(long n)
{
    long p = 1;
    for (long i = 1; i * i <= n; i++)
        if (n % i == 0) p = i;
    return p;
}

/* The number of the strongest of the frequencies 0 to n / 2 of a curve without its mean: the transforms of every p-th
 * value, put together. 0 without memory. */
static long strongest(const double curve[], long n)
{
    const long p = factor(n), q = n / p;
    double(*turn)[2] = malloc((size_t)n * sizeof *turn), (*part)[2] = malloc((size_t)n * sizeof *part);
    long found = 0;
    double most = -1.0, mean = 0.0;
    for (long k = 0; k < n; k++)
        mean += curve[k] / (double)n;
    for (long k = 0; turn && k < n; k++)
        elementary_sin_cos(2.0 * PI * (double)k / (double)n, &turn[k][1], &turn[k][0]);
    for (long r = 0; turn && part && r < p; r++)
        for (long m = 0; m <= q / 2; m++) {
            double real = 0.0, imaginary = 0.0;
            for (long s = 0, at = 0; s < q; s++, at = at + p * m < n ? at + p * m : at + p * m - n) {
                const double value = curve[r + p * s] - mean;
                real += value * turn[at][0];
                imaginary -= value * turn[at][1];
            }
            double *here = part[r * q + m], *mirrored = part[r * q + (q - m) % q];
            mirrored[0] = here[0] = real;
            mirrored[1] = -imaginary;
            here[1] = imaginary;
        }
    for (long k = 0; turn && part && k <= n / 2; k++) {
        double real = 0.0, imaginary = 0.0;
        for (long r = 0, at = 0; r < p; r++, at = at + k < n ? at + k : at + k - n) {
            const double *of = part[r * q + k % q];
            real += of[0] * turn[at][0] + of[1] * turn[at][1];
            imaginary += of[1] * turn[at][0] - of[0] * turn[at][1];
        }
        const double size = real * real + imaginary * imaginary;
        if (size > most) most = size, found = k;
    }
    free(turn);
    free(part);
    return found;
}

static double frequency(const Rules *rules, int n, long begin, long states)
{
    const long count = states - begin;
    double *curve = malloc((size_t)count * sizeof *curve), cosine, sine;
    if (!curve) return NAN;
    direction(n, &cosine, &sine);
    for (long k = 0; k < count; k++)
        curve[k] = cosine * record.X[begin + k][0] + sine * record.X[begin + k][1];
    const double found = (double)strongest(curve, count);
    free(curve);
    return found / ((double)count * (time_of(rules, 1) - time_of(rules, 0)));
}

/* The amplitude of a motion by its last windows and those of the case's own end `before`. */
static double lasting(const Rules *rules, const double curve[], int windows, const double before[], int windows_before)
{
    const double last = curve[windows - 1];
    if (last < rules->doubtful || falls(curve, windows)) return last;
    return larger(largest(curve, windows), falls(before, windows_before) ? 0.0 : before[windows_before - 1]);
}

static void measure_oscillation(const Rules *rules, double figures[FIGURES], const Curves *curves, long begin)
{
    static Curves at_end;
    const long states = record.sample + 1, own_states = (long)rules->samples + 1;
    const bool longer = states > own_states;
    const Curves *own = longer ? &at_end : curves;
    const int windows = curves->windows;
    long begins[WINDOWS];
    if (longer) fill_curves(rules, own_states, &at_end, begins);
    double last[DIRECTIONS], ends[DIRECTIONS];
    int worst = 0;
    bool is_slow = false;
    for (int n = 0; n < DIRECTIONS; n++) {
        const double *curve = curves->of[n];
        last[n] = longer ? lasting(rules, curve, windows, own->of[n], own->windows) : curve[windows - 1];
        ends[n] = own->of[n][own->windows - 1];
        /* A smaller motion that stays is worse than a larger one that dies away. */
        const bool slow = largest_ratio(curve, windows) >= rules->ring_down && last[n] >= rules->limit_cycle;
        if (n == 0 || (slow && !is_slow) || (slow == is_slow && last[n] > last[worst])) worst = n, is_slow = slow;
    }
    figures[LIMIT_CYCLE] = largest(last, DIRECTIONS);
    figures[LIMIT_CYCLE_RATIO] = ratio(curves->of[worst], windows - 1);
    figures[LIMIT_CYCLE_FREQUENCY] = frequency(rules, worst, begin, states);
    figures[LIMIT_CYCLE_DECAY] = largest_ratio(curves->of[worst], windows);
    figures[LIMIT_CYCLE_AT_END] = largest(ends, DIRECTIONS);
}

/* ---- The figures ---- */

/* The geometric mean of the amplitudes in the windows after the force, by square roots alone. */
static double residual_vibration(const Rules *rules, long states)
{
    const double begin = rules->force_stop + VIBRATION_BEGIN, end = rules->force_stop + VIBRATION_END;
    const double step = (end - begin) / VIBRATION_WINDOWS;
    double means[VIBRATION_WINDOWS];
    long places[VIBRATION_WINDOWS + 1];
    for (int i = 0; i <= VIBRATION_WINDOWS; i++)
        places[i] = first_from(rules, states, i < VIBRATION_WINDOWS ? i * step + begin : end, false);
    for (int i = 0; i < VIBRATION_WINDOWS; i++) {
        double of[DIRECTIONS];
        amplitudes(places[i], places[i + 1], of);
        means[i] = largest(of, DIRECTIONS);
    }
    for (int left = VIBRATION_WINDOWS / 2; left > 0; left /= 2)
        for (int i = 0; i < left; i++)
            means[i] = sqrt(means[2 * i] * means[2 * i + 1]);
    return means[0];
}

static void scan(const Rules *rules, long states, double figures[FIGURES])
{
    const long end = (long)rules->samples + 1;
    const long chirp = first_from(rules, states, rules->chirp_start, false);
    const long force = first_from(rules, states, rules->force_start, false);
    const long release = first_from(rules, states, rules->force_stop, true);
    const long rest = first_from(rules, states, time_of(rules, states - 1) - rules->rest_window, false);
    long late = -1, later = -1;
    for (int i = B1; i <= B7; i++)
        figures[i] = 0.0;
    figures[REST_ERROR] = 0.0;
    for (long k = 0; k < states; k++) {
        const double x = record.X[k][0] - record.X[0][0], z = record.X[k][1] - record.X[0][1];
        const double error = sqrt(x * x + z * z);
        if (k < end) {
            if (k >= force)
                figures[B5] = larger(figures[B5], error);
            else if (k >= chirp)
                figures[B7] = larger(figures[B7], error);
            if (k >= release) {
                if (error >= rules->settling_error) late = k;
                if (error >= rules->recovery_error) later = k;
            }
        }
        if (k >= rest) figures[REST_ERROR] = larger(figures[REST_ERROR], error);
        for (int axis = 0; k + 1 < end && axis < 2; axis++) {
            const double u = record.torque[k][axis];
            figures[B1 + axis] = larger(figures[B1 + axis], fabs(u - record.u_m0[axis]));
            figures[B3 + axis] = larger(figures[B3 + axis], fabs(u));
        }
    }
    figures[B6] = late < 0 ? 0.0 : time_of(rules, late) - rules->force_stop;
    figures[SETTLED] = late < (long)rules->samples;
    figures[RECOVERY] = later < 0 ? 0.0 : time_of(rules, later) - rules->force_stop;
}

static bool asked(const Rules *rules, Figure figure) { return (unsigned long)rules->asked >> figure & 1; }

void measure(const Rules *rules, double figures[FIGURES], Curves *curves)
{
    const long states = record.sample + 1;
    const bool whole = record.reason == FINISHED;
    long begins[WINDOWS];
    scan(rules, states, figures);
    curves->windows = 0;
    for (int i = LIMIT_CYCLE; i <= LIMIT_CYCLE_AT_END; i++)
        figures[i] = NAN;
    if (whole && asked(rules, LIMIT_CYCLE)) {
        fill_curves(rules, states, curves, begins);
        measure_oscillation(rules, figures, curves, begins[curves->windows - 1]);
    }
    if (asked(rules, RESIDUAL_VIBRATION)) figures[RESIDUAL_VIBRATION] = residual_vibration(rules, states);
    for (int i = 0; i < FIGURES; i++)
        if (!asked(rules, i) || (i == REST_ERROR && !whole)) figures[i] = NAN;
}

Verdict verdict(const Rules *rules, const double figures[FIGURES])
{
    if (record.reason == DIVERGED) return UNSTABLE;
    if (record.reason != FINISHED) return NO_VERDICT;
    if (figures[REST_ERROR] > rules->rest_error) return NO_REST;
    if (isnan(figures[LIMIT_CYCLE])) return NO_VERDICT;
    if (figures[LIMIT_CYCLE] < rules->limit_cycle)
        return figures[LIMIT_CYCLE_AT_END] >= rules->limit_cycle ? RING_DOWN : QUIET;
    const double decay = larger(figures[LIMIT_CYCLE_RATIO], figures[LIMIT_CYCLE_DECAY]);
    return decay < rules->ring_down ? RING_DOWN : CYCLE;
}
