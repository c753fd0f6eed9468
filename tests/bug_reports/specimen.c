/* The paper's PID as an FMU of FMI 2.0 and 3.0 for co-simulation. It has one property of a public bug report, which is
 * named by the GUID of its description; "none" has no property. */
#define _GNU_SOURCE
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"
#include "pid.h"

enum { AXES = 2, Q_M_REF = 0, Q_M = 2, U_M = 4, U_M0 = 6, VARIABLES = 8, PATH = 4096, TEXT = 256 };
typedef enum { INSTANTIATED, SET_UP, INITIALIZING, STEPPING, TERMINATED, FREED } Stage;

static const double T_S = 0.25e-3, LATE = 0.02, LARGE_STEP = 1e-3;
static const fmi2ValueReference LARGE_REFERENCE = 0x90000000u;

/* Properties that are those of a library: the instance, whose memory is given back, cannot have them. */
static bool crashes_when_unloaded;
static volatile bool ended;

typedef struct {
    double values[VARIABLES];
    PidGains gains[AXES];
    PidState states[AXES];
    double torque_at_start[AXES], held[AXES];
    double time, stop_time;
    Stage stage;
    char property[TEXT], name_copy[TEXT];
    const char *name;                  /* as it was passed */
    const fmi2CallbackFunctions *host; /* as it was passed */
    fmi2CallbackFunctions callbacks;   /* a copy */
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Controller;

#ifdef NAMES_OF_OTHERS
/* The mathematical library has another function y0, the C library a function error. */
double y0(double x) { return x; }
double error[AXES];
#endif

static bool is(const Controller *c, const char *property) { return strcmp(c->property, property) == 0; }

/* ---- Law ---- */

static void start(Controller *c)
{
    static const double K_p[AXES] = {45.0, 15.0}, K_i[AXES] = {30.0, 10.0}, K_d[AXES] = {1.5, 0.5};
    for (int i = 0; i < AXES; i++) c->gains[i] = (PidGains){K_p[i], K_i[i], K_d[i], 0.95, T_S};
}

static void initialize(Controller *c)
{
    for (int i = 0; i < AXES; i++) {
        const double u_m0 = is(c, "parameters used early") ? c->torque_at_start[i] : c->values[U_M0 + i];
        c->states[i] = (PidState){.s = u_m0};
        c->values[U_M + i] = is(c, "zero before the first step") ? 0.0 : u_m0;
        c->held[i] = u_m0;
    }
}

static void sample(Controller *c)
{
    for (int i = 0; i < AXES; i++) {
#ifdef NAMES_OF_OTHERS
        error[i] = y0(c->values[Q_M_REF + i] - c->values[Q_M + i]);
        c->states[i] = pid_sample(c->gains[i], c->states[i], error[i]);
#else
        c->states[i] = pid_sample(c->gains[i], c->states[i], c->values[Q_M_REF + i] - c->values[Q_M + i]);
#endif
        const double u_m = pid_torque(c->gains[i], c->states[i]);
        c->values[U_M + i] = is(c, "one step late") ? c->held[i] : u_m;
        c->held[i] = u_m;
    }
}

/* ---- What it says and reads ---- */

static void say(const Controller *c, fmi2Status status, const char *message)
{
    if (c->log)
        c->log(c->environment, (fmi3Status)status, "log", message);
    else
        c->callbacks.logger(c->callbacks.componentEnvironment, c->name, status, "log", "%s", message);
}

static fmi2Status refuse(const Controller *c, const char *message)
{
    say(c, fmi2Error, message);
    return fmi2Error;
}

/* The path of a URI. */
static void decode(const char *uri, char path[PATH])
{
    const char *from = strncmp(uri, "file://", 7) == 0 ? uri + 7 : uri;
    size_t n = 0;
    for (; *from && n + 1 < PATH; from++) {
        unsigned code;
        if (*from == '%' && sscanf(from + 1, "%2x", &code) == 1) {
            path[n++] = (char)code;
            from += 2;
        } else
            path[n++] = *from;
    }
    path[n] = 0;
}

static bool read_gains(Controller *c, const char *folder, const char *separator)
{
    char name[PATH + 16], message[PATH + 64];
    snprintf(name, sizeof name, "%s%sgains.txt", folder, separator);
    FILE *file = fopen(name, "r");
    int read = 0;
    if (file) {
        for (int i = 0; i < AXES; i++)
            read += fscanf(file, "%lf %lf %lf", &c->gains[i].K_p, &c->gains[i].K_i, &c->gains[i].K_d);
        fclose(file);
    }
    if (read != 3 * AXES) {
        snprintf(message, sizeof message, "Not possible to open file \"%s\"", name);
        say(c, fmi2Error, message);
    }
    return read == 3 * AXES;
}

static bool use_resources(Controller *c, const char *location)
{
    char path[PATH], message[PATH + 64];
    struct stat about;
    if (is(c, "resources")) {
        decode(location, path);
        return read_gains(c, path, "/");
    }
    if (is(c, "resources, nothing decoded")) return read_gains(c, location + 7, "/");
    if (is(c, "resources, three slashes removed")) return read_gains(c, location + 8, "/");
    if (is(c, "resources by a relative name")) return read_gains(c, "resources", "/");
    if (is(c, "an authority") && strncmp(location, "file:///", 8) != 0) {
        say(c, fmi2Error, "the location of the resources has no authority");
        return false;
    }
    if (is(c, "the folder of resources exists") && location) {
        decode(location, path);
        if (stat(path, &about) != 0 || !S_ISDIR(about.st_mode)) {
            snprintf(message, sizeof message, "there is no folder %s", path);
            say(c, fmi2Error, message);
            return false;
        }
    }
    return true;
}

/* What runs for a moment after the instance is gone, as the threads of OpenMP. */
static void *linger(void *unused)
{
    const struct timespec moment = {.tv_nsec = 1000000};
    for (int i = 0; i < 100 || !ended; i++) nanosleep(&moment, NULL);
    return unused;
}

static void speak(Controller *c)
{
    char message[TEXT] = "a message";
    if (is(c, "logs without a category"))
        c->callbacks.logger(c->callbacks.componentEnvironment, NULL, fmi2OK, NULL, "a message");
    if (is(c, "logs with arguments")) {
        c->callbacks.logger(c->callbacks.componentEnvironment, c->name, fmi2OK, "log", "%d of %s: %.3f, %ld, %c", 3,
                            "four", 1.5, 7L, 'x');
        c->callbacks.logger(c->callbacks.componentEnvironment, c->name, fmi2OK, "log", "100 %, sure: 5%");
    }
    if (is(c, "reuses what it logged")) {
        c->callbacks.logger(c->callbacks.componentEnvironment, c->name, fmi2OK, message, message);
        memset(message, 'x', sizeof message);
    }
    if (is(c, "logs with its own pointer")) c->callbacks.logger(c, c->name, fmi2OK, "log", "a message");
    if (is(c, "keeps the pointer to the callbacks"))
        c->host->logger(c->host->componentEnvironment, c->name, fmi2OK, "log", "a message");
    if (is(c, "prints"))
        for (int i = 0; i < 20; i++) puts(i % 2 ? "" : "what a model prints");
}

/* ---- FMI 2.0 ---- */

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)visible, (void)logging;
    const bool by_callback = strcmp(guid, "memory of the importer") == 0;
    Controller *c = by_callback ? host->allocateMemory(1, sizeof(Controller)) : calloc(1, sizeof(Controller));
    snprintf(c->property, TEXT, "%s", guid);
    snprintf(c->name_copy, TEXT, "%s", name);
    c->name = is(c, "keeps the name") ? name : c->name_copy;
    c->host = host;
    c->callbacks = *host;
    const Controller blank = {0};
    if (by_callback && memcmp(c->states, blank.states, sizeof blank.states) != 0) {
        refuse(c, "the memory is not zero");
        return NULL;
    }
    start(c);
    if (is(c, "no instance")) return NULL;
    if (is(c, "another GUID")) {
        say(c, fmi2Error, "GUID of model is not correct");
        return NULL;
    }
    if (is(c, "co-simulation only") && type != fmi2CoSimulation) return NULL;
    if (is(c, "a number with a decimal point") && strcmp(setlocale(LC_NUMERIC, NULL), "C") != 0) {
        say(c, fmi2Error, "JSON object expected ',' or '}'");
        return NULL;
    }
    crashes_when_unloaded = is(c, "crashes when it is unloaded");
    return use_resources(c, resources) ? c : NULL;
}

fmi2Status fmi2SetupExperiment(fmi2Component instance, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real begin,
                               fmi2Boolean stops, fmi2Real stop)
{
    (void)tolerant;
    Controller *c = instance;
    c->stage = SET_UP;
    c->time = begin;
    c->stop_time = stop;
    if (is(c, "needs numbers for times") && !(stop == stop && tolerance == tolerance)) abort();
    if (is(c, "needs a stop time") && !stops) return refuse(c, "the stop time must be defined");
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component instance)
{
    Controller *c = instance;
    if (is(c, "needs a set-up") && c->stage != SET_UP) return refuse(c, "fmi2SetupExperiment was not called");
    c->stage = INITIALIZING;
    for (int i = 0; i < AXES; i++) c->torque_at_start[i] = c->values[U_M0 + i];
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component instance)
{
    Controller *c = instance;
    if (is(c, "divides by an input") && c->values[Q_M_REF + 1] == 0.0) return refuse(c, "division by zero");
    if (is(c, "compares with NaN")) {
        volatile double next = 0.0;
        next = next / next;
        if (c->stop_time < next) return fmi2Error;
    }
    initialize(c);
    c->stage = STEPPING;
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Controller *c = instance;
    for (size_t i = 0; i < n; i++) {
        const fmi2ValueReference at = vr[i] - (is(c, "large value references") ? LARGE_REFERENCE : 0);
        if (at >= VARIABLES) return refuse(c, "no such variable");
        if (is(c, "inputs from initialization on") && at < U_M && c->stage < INITIALIZING)
            return refuse(c, "inputs cannot be set before initialization");
        if (is(c, "fixed parameters") && at >= U_M && c->stage > INITIALIZING)
            return refuse(c, "fixed parameters cannot be set after initialization");
        c->values[at] = value[i];
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Controller *c = instance;
    if (is(c, "values not written") && c->time > LATE) return fmi2OK;
    for (size_t i = 0; i < n; i++)
        value[i] = c->values[vr[i] - (is(c, "large value references") ? LARGE_REFERENCE : 0)];
    return is(c, "values discarded") && c->time > LATE ? fmi2Discard : fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)instance, (void)vr;
    for (size_t i = 0; i < n; i++) value[i] = NULL;
    return fmi2OK;
}

static jmp_buf nowhere;

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real t, fmi2Real h, fmi2Boolean no_state)
{
    (void)no_state;
    Controller *c = instance;
    char message[TEXT];
    if (is(c, "a larger step") && fabs(h - LARGE_STEP) > 1e-9) {
        snprintf(message, sizeof message, "communicationStepSize: %f is different from time step: %f", h, LARGE_STEP);
        return refuse(c, message);
    }
    if (is(c, "ends at the stop time") && t + h > c->stop_time) return refuse(c, "step beyond the stop time");
    if (is(c, "keeps the name") && strcmp(c->name, c->name_copy) != 0) return refuse(c, "the name has changed");
    if (is(c, "time stays after a reset") && fabs(t - c->time) > 1e-9) return refuse(c, "wrong time");
    if (is(c, "discards a step") && t > LATE) return fmi2Discard;
    if (is(c, "pending") && t > LATE) return fmi2Pending;
    if (is(c, "jumps nowhere") && t > LATE) longjmp(nowhere, 1);
    if (is(c, "changes the folder") && chdir("/") != 0) return fmi2Error;
    if (is(c, "a variable locale")) setlocale(LC_ALL, "");
    if (c->time < 4 * T_S) speak(c);
    sample(c);
    c->time = t + h;
#ifdef LIBM
    if (lgamma(c->values[U_M]) == 0.123) return fmi2Error;
#endif
#ifdef OTHER_LIBRARY
    double other_function(double);
    if (other_function(c->values[U_M]) == 0.123) return fmi2Error;
#endif
    return is(c, "warns in each step") ? fmi2Warning : fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component instance)
{
    Controller *c = instance;
    if (is(c, "crashes at the second end") && c->stage == TERMINATED) abort();
    if (is(c, "crashes at the end")) abort();
    c->stage = TERMINATED;
    return is(c, "an error at the end") ? fmi2Error : fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component instance)
{
    Controller *c = instance;
    if (is(c, "crashes at a reset")) abort();
    if (is(c, "time stays after a reset")) return fmi2OK;
    memset(c->values, 0, sizeof c->values);
    memset(c->states, 0, sizeof c->states);
    c->stage = INSTANTIATED;
    return fmi2OK;
}

void fmi2FreeInstance(fmi2Component instance)
{
    Controller *c = instance;
    if (is(c, "lingers")) {
        pthread_t thread;
        pthread_create(&thread, NULL, linger, NULL);
        pthread_detach(thread);
        ended = true;
    }
    if (is(c, "crashes when it is freed twice")) { /* which is seen, because the memory stays */
        if (c->stage == FREED) abort();
        c->stage = FREED;
        return;
    }
    if (is(c, "memory of the importer") || is(c, "memory of its own, given back to the importer"))
        c->callbacks.freeMemory(c);
    else
        free(c);
}

__attribute__((destructor)) static void unload(void)
{
    if (crashes_when_unloaded) abort();
}

/* What nobody calls, but everybody looks for. */
#define UNUSED(name) \
    fmi2Status fmi2##name(void) { return fmi2Error; }
UNUSED(SetDebugLogging) UNUSED(GetInteger) UNUSED(GetBoolean) UNUSED(SetInteger) UNUSED(SetBoolean) UNUSED(SetString)
UNUSED(GetFMUstate) UNUSED(SetFMUstate) UNUSED(FreeFMUstate) UNUSED(SerializedFMUstateSize) UNUSED(SerializeFMUstate)
UNUSED(DeSerializeFMUstate) UNUSED(GetDirectionalDerivative) UNUSED(SetRealInputDerivatives)
UNUSED(GetRealOutputDerivatives) UNUSED(CancelStep) UNUSED(GetStatus) UNUSED(GetRealStatus) UNUSED(GetIntegerStatus)
UNUSED(GetBooleanStatus)
#ifndef NO_STRING_STATUS
UNUSED(GetStringStatus)
#endif

/* ---- FMI 3.0, as far as a loop of scalars goes ---- */

const char *fmi3GetVersion(void) { return "3.0"; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference intermediate[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)visible, (void)logging, (void)events, (void)early, (void)intermediate, (void)n, (void)update;
    Controller *c = calloc(1, sizeof(Controller));
    snprintf(c->property, TEXT, "%s", token);
    snprintf(c->name_copy, TEXT, "%s", name);
    c->name = c->name_copy;
    c->environment = environment;
    c->log = log;
    start(c);
    /* "The absolute file path (with a trailing file separator)": the name of the file follows. */
    if (is(c, "resources") && !read_gains(c, resources, "")) return NULL;
    return c;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerant, fmi3Float64 tolerance,
                                       fmi3Float64 begin, fmi3Boolean stops, fmi3Float64 stop)
{
    (void)instance, (void)tolerant, (void)tolerance, (void)begin, (void)stops, (void)stop;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    initialize(instance);
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) { return (fmi3Status)fmi2Reset(instance); }

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t values)
{
    (void)values;
    return (fmi3Status)fmi2SetReal(instance, vr, n, value);
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[],
                          size_t values)
{
    (void)values;
    return (fmi3Status)fmi2GetReal(instance, vr, n, value);
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_state, fmi3Boolean *event,
                      fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last)
{
    *event = *end = *early = fmi3False;
    *last = t + h;
    if (is(instance, "waits for event mode")) {
        *event = fmi3True;
        return fmi3OK;
    }
    return (fmi3Status)fmi2DoStep(instance, t, h, no_state);
}

#define UNUSED3(name) \
    fmi3Status fmi3##name(void) { return fmi3Error; }
UNUSED3(SetDebugLogging) UNUSED3(EnterEventMode) UNUSED3(GetFloat32) UNUSED3(GetInt8) UNUSED3(GetUInt8)
UNUSED3(GetInt16) UNUSED3(GetUInt16) UNUSED3(GetInt32) UNUSED3(GetUInt32) UNUSED3(GetInt64) UNUSED3(GetUInt64)
UNUSED3(GetBoolean) UNUSED3(GetString) UNUSED3(GetBinary) UNUSED3(GetClock) UNUSED3(SetFloat32) UNUSED3(SetInt8)
UNUSED3(SetUInt8) UNUSED3(SetInt16) UNUSED3(SetUInt16) UNUSED3(SetInt32) UNUSED3(SetUInt32) UNUSED3(SetInt64)
UNUSED3(SetUInt64) UNUSED3(SetBoolean) UNUSED3(SetString) UNUSED3(SetBinary) UNUSED3(SetClock)
UNUSED3(GetNumberOfVariableDependencies) UNUSED3(GetVariableDependencies) UNUSED3(GetFMUState) UNUSED3(SetFMUState)
UNUSED3(FreeFMUState) UNUSED3(SerializedFMUStateSize) UNUSED3(SerializeFMUState) UNUSED3(DeserializeFMUState)
UNUSED3(GetDirectionalDerivative) UNUSED3(GetAdjointDerivative) UNUSED3(EnterConfigurationMode)
UNUSED3(ExitConfigurationMode) UNUSED3(GetIntervalDecimal) UNUSED3(GetIntervalFraction) UNUSED3(GetShiftDecimal)
UNUSED3(GetShiftFraction) UNUSED3(SetIntervalDecimal) UNUSED3(SetIntervalFraction) UNUSED3(SetShiftDecimal)
UNUSED3(SetShiftFraction) UNUSED3(EvaluateDiscreteStates) UNUSED3(UpdateDiscreteStates)
UNUSED3(EnterContinuousTimeMode) UNUSED3(CompletedIntegratorStep) UNUSED3(SetTime) UNUSED3(SetContinuousStates)
UNUSED3(GetContinuousStateDerivatives) UNUSED3(GetEventIndicators) UNUSED3(GetContinuousStates)
UNUSED3(GetNominalsOfContinuousStates) UNUSED3(GetNumberOfEventIndicators) UNUSED3(GetNumberOfContinuousStates)
UNUSED3(EnterStepMode) UNUSED3(GetOutputDerivatives) UNUSED3(ActivateModelPartition) UNUSED3(InstantiateModelExchange)
UNUSED3(InstantiateScheduledExecution)
