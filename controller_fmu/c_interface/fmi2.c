/* FMI 2.0 co-simulation and Model Exchange: a translation to component.h, nothing else. */
#include "fmi2Functions.h"

#include <math.h>
#include <string.h>

#define FMI(name) fmi2##name
#define LOG(c) ((fmi2CallbackLogger)c->logger)(c->environment, c->name, fmi2Error, "logStatusError", c->message)

#include "translation.h"

/* ---- Life of an instance ---- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
METHOD_OF(fmi2SetDebugLogging, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    return DONE(SELF->logging = on); /* there is one category */
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    return instantiate(name, guid, (AnyFunction)host->logger, host->componentEnvironment, logging);
}

void fmi2FreeInstance(fmi2Component c) { component_free(c); }
METHOD_OF(fmi2SetupExperiment, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
          fmi2Boolean stop_defined, fmi2Real stop)
{
    return DONE(SELF->memory->time = start);
}
METHOD(fmi2EnterInitializationMode) { return fmi2OK; }
METHOD(fmi2ExitInitializationMode) { return status(c, component_initialize(c)); }
METHOD(fmi2Terminate) { return fmi2OK; }
METHOD(fmi2Reset) { return DONE(component_reset(c)); }

/* ---- Variables ---- */

#define VARIABLES(name, type) METHOD_OF(name, const fmi2ValueReference vr[], size_t n, type value[])
VARIABLES(fmi2GetReal, fmi2Real) { return status(c, component_get(c, vr, n, value, n)); }
VARIABLES(fmi2SetReal, const fmi2Real) { return status(c, component_set(c, vr, n, value, n)); }

#define NO_VARIABLES(name, type) \
    VARIABLES(name, type) { return refuse_any(c, n, #name ": all variables of this FMU are of type Real"); }
NO_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_VARIABLES(fmi2GetString, fmi2String)
NO_VARIABLES(fmi2SetString, const fmi2String)

METHOD_OF(fmi2GetDirectionalDerivative, const fmi2ValueReference unknown[], size_t n_unknown,
          const fmi2ValueReference known[], size_t n_known, const fmi2Real d_known[], fmi2Real d_unknown[])
{
    return refuse(c, "this FMU provides no directional derivatives");
}

/* ---- State ---- */

METHOD_OF(fmi2GetFMUstate, fmi2FMUstate *state) { return status(c, component_save(c, state)); }
METHOD_OF(fmi2SetFMUstate, fmi2FMUstate state) { return DONE(component_restore(c, state)); }
METHOD_OF(fmi2FreeFMUstate, fmi2FMUstate *state) { return DONE(component_forget(state)); }
METHOD_OF(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
{
    return DONE(*size = component_serialized_size());
}
METHOD_OF(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return status(c, component_serialize(c, state, bytes, size));
}
METHOD_OF(fmi2DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return status(c, component_deserialize(c, bytes, size, state));
}

/* ---- Co-simulation ---- */

METHOD_OF(fmi2DoStep, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state) { return status(c, component_step(c, t, h)); }
METHOD(fmi2CancelStep) { return refuse(c, "steps end at once, there is none to cancel"); }

#define DERIVATIVES(name, type) \
    METHOD_OF(name, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], type value[])
DERIVATIVES(fmi2SetRealInputDerivatives, const fmi2Real)
{
    return refuse_any(c, n, "this FMU does not interpolate its inputs");
}
DERIVATIVES(fmi2GetRealOutputDerivatives, fmi2Real)
{
    return refuse_any(c, n, "this FMU provides no derivatives of its outputs");
}

/* Steps end at once and nothing is pending, so there is no such status to ask for. */
#define NO_STATUS(name, type) \
    METHOD_OF(name, const fmi2StatusKind kind, type *value) { return fmi2Discard; }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)
METHOD_OF(fmi2GetRealStatus, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = SELF->memory->time;
    return fmi2OK;
}
METHOD_OF(fmi2GetBooleanStatus, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

/* ---- Model Exchange: continuous states and time events, no state events ---- */

METHOD(fmi2EnterEventMode) { return fmi2OK; }
METHOD(fmi2EnterContinuousTimeMode) { return fmi2OK; }
METHOD_OF(fmi2SetTime, fmi2Real time) { return DONE(SELF->memory->time = time); }
METHOD_OF(fmi2SetContinuousStates, const fmi2Real x[], size_t n) { return status(c, component_set_states(c, x, n)); }
METHOD_OF(fmi2GetContinuousStates, fmi2Real x[], size_t n) { return status(c, component_get_states(c, x, n)); }
METHOD_OF(fmi2GetDerivatives, fmi2Real dx[], size_t n) { return status(c, component_get_derivatives(c, dx, n)); }
METHOD_OF(fmi2GetNominalsOfContinuousStates, fmi2Real x[], size_t n) { return DONE(component_get_nominals(x, n)); }
METHOD_OF(fmi2GetEventIndicators, fmi2Real z[], size_t n)
{
    return refuse_any(c, n, "this FMU has no event indicators");
}

METHOD_OF(fmi2NewDiscreteStates, fmi2EventInfo *info)
{
    const fmi2Status handled = status(c, component_event(c));
    memset(info, 0, sizeof *info);
    info->nextEventTime = component_next_event(c);
    info->nextEventTimeDefined = isfinite(info->nextEventTime) ? fmi2True : fmi2False;
    return handled;
}

METHOD_OF(fmi2CompletedIntegratorStep, fmi2Boolean no_set_state, fmi2Boolean *enter_event_mode, fmi2Boolean *terminate)
{
    return DONE(*enter_event_mode = *terminate = fmi2False);
}
