/* FMI 2.0 co-simulation and Model Exchange: a translation to component.h, nothing else. Beyond the standard's tables
 * (2.0.4, sections 3.2.3 and 4.2.4), a start time of 0 is taken where fmi2SetupExperiment was not called, inputs may be
 * set before initialization, and time may be set in event mode. */
#include "fmi2Functions.h"

#include <string.h>

#define FMI(name) fmi2##name
#define LOG(c) ((fmi2CallbackLogger)c->logger)(c->environment, c->name, fmi2Error, "logStatusError", c->message)
#define LOGS_ERRORS(c) (c->logging)

#include "translation.h"

/* ---- Life of an instance ---- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
METHOD_OF(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    ALLOWED_IN(ANY_STATE);
    return set_logging(c, on);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    const Kind kind = type == fmi2CoSimulation    ? CO_SIMULATION
                      : type == fmi2ModelExchange ? MODEL_EXCHANGE
                                                  : ANOTHER_KIND;
    if (!host) return NULL;
    return instantiate(name, guid, kind, (AnyFunction)host->logger, host->componentEnvironment, logging);
}

void fmi2FreeInstance(fmi2Component c) { component_free(c); }
METHOD_OF(fmi2SetupExperiment, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
          fmi2Boolean stop_defined, fmi2Real stop)
{
    ALLOWED_IN(INSTANTIATED);
    return status(c, component_set_times(c, start, stop_defined ? stop : INFINITY));
}
METHOD(fmi2EnterInitializationMode)
{
    ALLOWED_IN(INSTANTIATED);
    return enter(c, INITIALIZATION);
}
METHOD(fmi2ExitInitializationMode)
{
    ALLOWED_IN(INITIALIZATION);
    return status(c, component_initialize(c));
}
METHOD(fmi2Terminate)
{
    ALLOWED_IN(INITIALIZED);
    return enter(c, TERMINATED);
}
METHOD(fmi2Reset)
{
    ALLOWED_IN(ANY_STATE);
    return reset(c);
}

/* ---- Variables ---- */

#define VARIABLES(name, type) METHOD_OF(name, const fmi2ValueReference vr[], size_t n, type value[])
VARIABLES(fmi2GetReal, fmi2Real)
{
    ALLOWED_IN(TO_READ);
    return status(c, component_get(c, vr, n, value, n));
}
VARIABLES(fmi2SetReal, const fmi2Real)
{
    ALLOWED_IN(TO_SET);
    return status(c, component_set(c, vr, n, value, n));
}

#define NO_VARIABLES(name, type, states)                                               \
    VARIABLES(name, type)                                                              \
    {                                                                                  \
        ALLOWED_IN(states);                                                            \
        return refuse_any(c, n, #name ": all variables of this FMU are of type Real"); \
    }
NO_VARIABLES(fmi2GetInteger, fmi2Integer, TO_READ)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer, TO_SET & ~CONTINUOUS_TIME)
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean, TO_READ)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean, TO_SET & ~CONTINUOUS_TIME)
NO_VARIABLES(fmi2GetString, fmi2String, TO_READ)
NO_VARIABLES(fmi2SetString, const fmi2String, TO_SET & ~CONTINUOUS_TIME)

METHOD_OF(fmi2GetDirectionalDerivative, const fmi2ValueReference unknown[], size_t n_unknown,
          const fmi2ValueReference known[], size_t n_known, const fmi2Real d_known[], fmi2Real d_unknown[])
{
    ALLOWED_IN(TO_EVALUATE | STEP);
    return refuse(c, "this FMU provides no directional derivatives");
}

/* ---- State ---- */

METHOD_OF(fmi2GetFMUstate, fmi2FMUstate *state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_save(c, state));
}
METHOD_OF(fmi2SetFMUstate, fmi2FMUstate state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_restore(c, state));
}
METHOD_OF(fmi2FreeFMUstate, fmi2FMUstate *state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_forget(c, state));
}
METHOD_OF(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
{
    ALLOWED_IN(ANY_STATE);
    return serialized_size(c, state, size);
}
METHOD_OF(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_serialize(c, state, bytes, size));
}
METHOD_OF(fmi2DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_deserialize(c, bytes, size, state));
}

/* ---- Co-simulation ---- */

METHOD_OF(fmi2DoStep, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state)
{
    ALLOWED_IN(STEP);
    return status(c, component_step(c, t, h));
}
METHOD(fmi2CancelStep)
{
    ALLOWED_IN(NO_STATE);
    return fmi2OK;
} /* steps end at once, none is in progress */

#define DERIVATIVES(name, type) \
    METHOD_OF(name, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], type value[])
DERIVATIVES(fmi2SetRealInputDerivatives, const fmi2Real)
{
    ALLOWED_IN(IN_CO_SIMULATION(INSTANTIATED | INITIALIZATION | STEP));
    return refuse_any(c, n, "this FMU does not interpolate its inputs");
}
DERIVATIVES(fmi2GetRealOutputDerivatives, fmi2Real)
{
    ALLOWED_IN(IN_CO_SIMULATION(STEP | TERMINATED | FAILED));
    return refuse_any(c, n, "this FMU provides no derivatives of its outputs");
}

/* Steps end at once and nothing is pending, so there is no such status to ask for. */
#define NO_STATUS(name, type)                               \
    METHOD_OF(name, const fmi2StatusKind kind, type *value) \
    {                                                       \
        ALLOWED_IN(IN_CO_SIMULATION(STEP | TERMINATED));    \
        return fmi2Discard;                                 \
    }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)
METHOD_OF(fmi2GetRealStatus, const fmi2StatusKind kind, fmi2Real *value)
{
    ALLOWED_IN(IN_CO_SIMULATION(STEP | TERMINATED));
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    if (!check_result(c, value)) return status(c, false);
    *value = SELF->memory->time;
    return fmi2OK;
}
METHOD_OF(fmi2GetBooleanStatus, const fmi2StatusKind kind, fmi2Boolean *value)
{
    ALLOWED_IN(IN_CO_SIMULATION(STEP | TERMINATED));
    if (kind != fmi2Terminated) return fmi2Discard;
    if (!check_result(c, value)) return status(c, false);
    *value = fmi2False;
    return fmi2OK;
}

/* ---- Model Exchange: continuous states and time events, no state events ---- */

METHOD(fmi2EnterEventMode)
{
    ALLOWED_IN(EVENT | CONTINUOUS_TIME);
    SELF->memory->latest_event = SELF->memory->time;
    return enter(c, EVENT);
}
METHOD(fmi2EnterContinuousTimeMode)
{
    ALLOWED_IN(EVENT);
    return enter(c, CONTINUOUS_TIME);
}
METHOD_OF(fmi2SetTime, fmi2Real time)
{
    ALLOWED_IN(EVENT | CONTINUOUS_TIME);
    return status(c, component_set_time(c, time));
}
METHOD_OF(fmi2SetContinuousStates, const fmi2Real x[], size_t n)
{
    ALLOWED_IN(CONTINUOUS_TIME);
    return status(c, component_set_states(c, x, n));
}
METHOD_OF(fmi2GetContinuousStates, fmi2Real x[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(TO_EVALUATE));
    return status(c, component_get_states(c, x, n));
}
METHOD_OF(fmi2GetDerivatives, fmi2Real dx[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(TO_EVALUATE));
    return status(c, component_get_derivatives(c, dx, n));
}
METHOD_OF(fmi2GetNominalsOfContinuousStates, fmi2Real x[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(ANY_STATE));
    return status(c, component_get_nominals(c, x, n));
}
METHOD_OF(fmi2GetEventIndicators, fmi2Real z[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(TO_EVALUATE));
    return refuse_any(c, n, "this FMU has no event indicators");
}

METHOD_OF(fmi2NewDiscreteStates, fmi2EventInfo *info)
{
    ALLOWED_IN(EVENT);
    if (!check_result(c, info) || !component_event(c)) return status(c, false);
    memset(info, 0, sizeof *info);
    info->nextEventTime = component_next_event(c);
    info->nextEventTimeDefined = isfinite(info->nextEventTime) ? fmi2True : fmi2False;
    return fmi2OK;
}

METHOD_OF(fmi2CompletedIntegratorStep, fmi2Boolean no_set_state, fmi2Boolean *enter_event_mode, fmi2Boolean *terminate)
{
    ALLOWED_IN(CONTINUOUS_TIME);
    if (!check_result(c, enter_event_mode) || !check_result(c, terminate)) return status(c, false);
    *enter_event_mode = *terminate = fmi2False;
    return fmi2OK;
}
