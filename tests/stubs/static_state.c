/* The PID of eq. (13) as a raw FMI 2 slave that keeps what it remembers where KEPT says. */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2FunctionTypes.h"
#include "pid.h"

enum { AXES = 2, VARIABLES = 8 };

#define IN_THE_INSTANCE 0
#define SINCE_LOADING 1      /* static, with the torque at rest of the first simulation */
#define SINCE_INSTANTIATION 2 /* static, cleared by the first fmi2Instantiate */
#define UNTIL_TERMINATION 3  /* static, cleared by fmi2Terminate, not by fmi2FreeInstance */
#define FOR_ALL_INSTANCES 4  /* static, cleared by every fmi2Instantiate */
#define AFTER_A_FORCE 5      /* static: that an instance had a large error late, which reduces the gain of others */
#define NOWHERE 6            /* in the instance, and a torque that depends on the clock */
#define BY_POSE 7            /* static: where an instance was for more than a second, which reduces the gain of others there */
#define AT_ANOTHER_POSE 9 /* static: that an instance was at a pose that only later groups of cases have */
#define COUNTED 8            /* static: the number of instances, which reduces the gain from the sixth on */

typedef struct {
    PidState axes[AXES];
    double u_m0[AXES];
    int begun;
} Remembered;

typedef struct {
    double values[VARIABLES]; /* q_m_ref, q_m, u_m, u_m0 of both axes */
    Remembered remembered;
    int number, samples, reduced;
} Slave;

static Remembered shared;
static int instances, alarmed, poses, elsewhere;
static double visited[1000];

/* Whether an instance at this pose has less gain. */
static int is_reduced(double pose, int number)
{
    for (int i = 0; KEPT == BY_POSE && i < poses; i++)
        if (visited[i] == pose) return 1;
    if (KEPT == AT_ANOTHER_POSE) return elsewhere;
    return KEPT == COUNTED && number > 5;
}

static Remembered *remembered(Slave *slave)
{
    return KEPT == IN_THE_INSTANCE || KEPT >= AFTER_A_FORCE ? &slave->remembered : &shared;
}

static const PidGains gains[AXES] = {{45.0, 30.0, 1.5, 0.95, 0.25e-3}, {15.0, 10.0, 0.5, 0.95, 0.25e-3}};

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    if (KEPT == FOR_ALL_INSTANCES || (KEPT == SINCE_INSTANTIATION && !instances)) memset(&shared, 0, sizeof shared);
    Slave *slave = calloc(1, sizeof(Slave));
    slave->number = ++instances;
    return slave;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop)
{
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Slave *slave = c;
    Remembered *state = remembered(slave);
    if (!state->begun) memcpy(state->u_m0, slave->values + 6, sizeof state->u_m0);
    state->begun = 1;
    slave->reduced = is_reduced(slave->values[6], slave->number);
    memcpy(slave->values + 4, slave->values + 6, sizeof state->u_m0);
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    Slave *slave = c;
    if (KEPT == UNTIL_TERMINATION) memset(&shared, 0, sizeof shared);
    if (slave->values[6] < -4.5 && slave->values[6] > -5.0) elsewhere = 1;
    if (slave->samples > 4000 && poses < 1000) visited[poses++] = slave->values[6];
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    memset(c, 0, sizeof(Slave)); /* what is static stays */
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state)
{
    Slave *slave = c;
    Remembered *state = remembered(slave);
    for (int i = 0; i < AXES; i++) {
        const double e = slave->values[i] - slave->values[2 + i];
        state->axes[i] = pid_sample(gains[i], state->axes[i], e);
        slave->values[4 + i] = state->u_m0[i] + (slave->reduced ? 0.9 : 1.0) * pid_torque(gains[i], state->axes[i]);
        if (KEPT == AFTER_A_FORCE) {
            if (alarmed && alarmed != slave->number) slave->values[4 + i] = state->u_m0[i] + 0.99 * (slave->values[4 + i] - state->u_m0[i]);
            if (t > 3.0 && (e > 1e-2 || e < -1e-2)) alarmed = slave->number;
        }
    }
    slave->samples++;
    if (KEPT == NOWHERE) {
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        slave->values[4] += 1e-9 * (double)now.tv_nsec;
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) value[i] = ((Slave *)c)->values[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) ((Slave *)c)->values[vr[i]] = value[i];
    return fmi2OK;
}

#define UNUSED(name) \
    fmi2Status fmi2##name(void) { return fmi2Error; }
UNUSED(SetDebugLogging) UNUSED(GetInteger) UNUSED(GetBoolean) UNUSED(GetString) UNUSED(SetInteger) UNUSED(SetBoolean)
UNUSED(SetString) UNUSED(GetFMUstate) UNUSED(SetFMUstate) UNUSED(FreeFMUstate) UNUSED(SerializedFMUstateSize)
UNUSED(SerializeFMUstate) UNUSED(DeSerializeFMUstate) UNUSED(GetDirectionalDerivative) UNUSED(SetRealInputDerivatives)
UNUSED(GetRealOutputDerivatives) UNUSED(CancelStep) UNUSED(GetStatus) UNUSED(GetRealStatus) UNUSED(GetIntegerStatus)
UNUSED(GetBooleanStatus) UNUSED(GetStringStatus)
