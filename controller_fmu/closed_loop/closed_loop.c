/* The master loop in C, for FMUs that are compiled with it. Values are exchanged in the order of docs/plant.md, in
 * which the result is that of orchestrator/loop/closed_loop.py. */
#include "closed_loop.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "slaves.h" /* written with the units: SLAVES, the addresses of plant, imperfections, and the controllers */

enum { PLANT, IMPERFECTIONS, CONTROLLER, PARTS, MOST = 6 /* variables in a call */ };

static const Slave *const ALL[] = {SLAVES};

static const double MAX_PHYSICAL_TORQUE = 1e12, MAX_MOTOR_ANGLE = 1e9;

typedef struct {
    const Slave *slave;
    fmi2Component instance;
    int status; /* the worst that a call has returned */
} Part;

/* Signals of one part that are read or set in one call. */
typedef struct {
    size_t count;
    fmi2ValueReference of[MOST];
} Call;

Record record;

static Part parts[PARTS];
static struct {
    Call state, angles;          /* q_m, X and q_a of the plant; q_m of the imperfections */
    Call measured, seen;         /* y of the imperfections, q_m of the controller */
    Call asked, commanded;       /* u_m of the controller, u_c of the imperfections */
    Call given, driving;         /* u_m, u_d and F of the imperfections, and of the plant */
} calls;
static long ticks_per_sample;
static double sample_time, tick, reach;

static void keep_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                         fmi2String category, fmi2String message, ...)
{
    strncpy(record.message, message, sizeof record.message - 1);
}

static const fmi2CallbackFunctions HOST = {keep_message, calloc, free, NULL, NULL};

static void check(Part *part, int status)
{
    if (status > part->status) part->status = status;
}

static Call call_for(int part, size_t count, const Signal signals[])
{
    Call made = {0};
    for (size_t i = 0; i < count; i++) {
        const References *references = &parts[part].slave->signals[signals[i]];
        for (size_t j = 0; j < references->count; j++)
            made.of[made.count++] = references->of[j];
    }
    return made;
}

static void get(int part, const Call *call, double values[])
{
    check(&parts[part], parts[part].slave->get(parts[part].instance, call->of, call->count, values));
}

static void set(int part, const Call *call, const double values[])
{
    check(&parts[part], parts[part].slave->set(parts[part].instance, call->of, call->count, values));
}

static void pass(int from, Signal output, int to, Signal input)
{
    const Call source = call_for(from, 1, &output), target = call_for(to, 1, &input);
    double values[MOST];
    get(from, &source, values);
    set(to, &target, values);
}

/* An instance with its values, in initialization; returns what follows them. */
static const double *begin_part(int part, const double *given)
{
    const Slave *slave = ALL[(int)*given++];
    parts[part] = (Part){slave, slave->instantiate("part", fmi2CoSimulation, slave->guid, "", &HOST, fmi2False, fmi2True), 0};
    if (!parts[part].instance) return NULL;
    check(&parts[part], slave->setup(parts[part].instance, fmi2False, 0.0, 0.0, fmi2False, 0.0));
    for (int left = (int)*given++; left > 0; left--, given += 2) {
        const fmi2ValueReference reference = (fmi2ValueReference)given[0];
        check(&parts[part], slave->set(parts[part].instance, &reference, 1, given + 1));
    }
    if (slave->matrices && !(given = slave->matrices(given, sample_time))) return NULL;
    return given;
}

/* Each output after what it depends on; u_d is kept for the record. */
static void exchange(double u_d[2])
{
    double pair[MOST];
    get(PLANT, &calls.state, pair);
    set(IMPERFECTIONS, &calls.angles, pair);
    get(IMPERFECTIONS, &calls.measured, pair);
    set(CONTROLLER, &calls.seen, pair);
    get(CONTROLLER, &calls.asked, pair);
    set(IMPERFECTIONS, &calls.commanded, pair);
    get(IMPERFECTIONS, &calls.given, pair);
    set(PLANT, &calls.driving, pair);
    memcpy(u_d, pair + 2, 2 * sizeof *pair);
}

static void keep_state(long row)
{
    double values[MOST];
    get(PLANT, &calls.state, values);
    memcpy(record.q_m[row], values, sizeof *record.q_m);
    memcpy(record.X[row], values + 2, sizeof *record.X);
    memcpy(record.q_a[row], values + 4, sizeof *record.q_a);
}

static bool allocate(long samples)
{
    double(**const columns[])[2] = {&record.q_m, &record.X, &record.q_a, &record.u_d, &record.command, &record.torque};
    for (size_t i = 0; i < sizeof columns / sizeof *columns; i++)
        if (!(*columns[i] = calloc((size_t)samples + 1, sizeof(double[2])))) return false;
    return true;
}

/* The first part that has failed; PARTS if none has. */
static int failed(void)
{
    int part = 0;
    while (part < PARTS && parts[part].status <= fmi2Warning)
        part++;
    return part;
}

bool loop_begin(const double *given, long samples, double T_s, long ticks, double abort_distance)
{
    static const Signal drive[] = {SIGNAL_u_m, SIGNAL_u_d, SIGNAL_F};
    static const Signal steady[][2] = {
        {SIGNAL_q_m_ref, SIGNAL_q_m_ref}, {SIGNAL_u_m0, SIGNAL_u_m0}, {SIGNAL_q_a, SIGNAL_q_a_ref}};
    record = (Record){.reason = NOT_STARTED};
    ticks_per_sample = ticks;
    sample_time = T_s;
    tick = T_s / (double)ticks;
    reach = abort_distance * abort_distance;
    if (!allocate(samples)) return false;
    for (int part = 0; part < PARTS; part++)
        if (!(given = begin_part(part, given))) return false;
    calls.state = call_for(PLANT, 3, (Signal[]){SIGNAL_q_m, SIGNAL_X, SIGNAL_q_a});
    calls.angles = call_for(IMPERFECTIONS, 1, (Signal[]){SIGNAL_q_m});
    calls.measured = call_for(IMPERFECTIONS, 1, (Signal[]){SIGNAL_y});
    calls.seen = call_for(CONTROLLER, 1, (Signal[]){SIGNAL_q_m});
    calls.asked = call_for(CONTROLLER, 1, (Signal[]){SIGNAL_u_m});
    calls.commanded = call_for(IMPERFECTIONS, 1, (Signal[]){SIGNAL_u_c});
    calls.given = call_for(IMPERFECTIONS, 3, drive);
    calls.driving = call_for(PLANT, 3, drive);

    /* The plant first: the others are told of its steady state. */
    for (int part = 0; part < PARTS; part++) {
        for (size_t i = 0; part > 0 && i < sizeof steady / sizeof *steady; i++)
            if (parts[part].slave->signals[steady[i][1]].count) pass(PLANT, steady[i][0], part, steady[i][1]);
        check(&parts[part], parts[part].slave->enter(parts[part].instance));
    }
    double *const kept[] = {record.q_m_ref, record.u_m0};
    for (int i = 0; i < 2; i++) {
        const Call call = call_for(PLANT, 1, steady[i]);
        get(PLANT, &call, kept[i]);
    }
    exchange(record.u_d[0]);
    for (int part = 0; part < PARTS; part++)
        check(&parts[part], parts[part].slave->leave(parts[part].instance));
    keep_state(0);
    record.reason = failed() < PARTS ? NOT_STARTED : FINISHED;
    return record.reason == FINISHED;
}

/* Whether a motion can go on from a row; one that cannot be that of a manipulator is the plant's failure. */
static Reason judged(long row)
{
    const double dx = record.X[row][0] - record.X[0][0], dz = record.X[row][1] - record.X[0][1];
    if (dx * dx + dz * dz <= reach) return FINISHED; /* false of NaN */
    for (int i = 0; i < 2; i++)
        if (!isfinite(record.X[row][i]) || !(fabs(record.q_m[row][i]) <= MAX_MOTOR_ANGLE)) return PLANT_FAILED;
    return DIVERGED;
}

/* One sample: the controller's step, and those of the others. */
static Reason sampled(long k)
{
    for (long i = 0; i < ticks_per_sample; i++) {
        const double t = (double)(k * ticks_per_sample + i) * tick;
        double u_d[2];
        exchange(i == 0 ? record.u_d[k] : u_d);
        for (int part = PLANT; part < CONTROLLER; part++)
            check(&parts[part], parts[part].slave->step(parts[part].instance, t, tick, fmi2True));
        Part *controller = &parts[CONTROLLER];
        if (i == 0)
            check(controller,
                  controller->slave->step(controller->instance, (double)k * sample_time, sample_time, fmi2True));
        const int wrong = failed();
        if (wrong < PARTS) return wrong == CONTROLLER ? CONTROLLER_FAILED : PLANT_FAILED;
        if (i > 0) continue;
        get(CONTROLLER, &calls.asked, record.command[k]);
        for (int axis = 0; axis < 2; axis++) {
            const double asked = record.command[k][axis];
            if (!(fabs(asked) <= MAX_PHYSICAL_TORQUE)) return ABSURD_TORQUE;
            record.torque[k][axis] = driven(parts[IMPERFECTIONS].instance, axis, asked);
        }
    }
    keep_state(k + 1);
    return judged(k + 1);
}

void loop_run(long samples)
{
    while (record.sample < samples && record.reason == FINISHED) {
        record.reason = sampled(record.sample);
        if (record.reason == FINISHED || record.reason == DIVERGED) record.sample++;
    }
}

void loop_end(void)
{
    for (int i = 0; i < PARTS; i++) {
        if (parts[i].instance) parts[i].slave->free(parts[i].instance);
        parts[i].instance = NULL;
    }
    double(*const columns[])[2] = {record.q_m, record.X, record.q_a, record.u_d, record.command, record.torque};
    for (size_t i = 0; i < sizeof columns / sizeof *columns; i++)
        free(columns[i]);
}
