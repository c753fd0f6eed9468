/* FMI 2.0 co-simulation and Model Exchange: a translation to component.h, nothing else. */
#include "fmi2Functions.h"

#include <math.h>
#include <string.h>

#include "component.h"

static fmi2Status status(Component *component, bool succeeded)
{
    if (succeeded) return fmi2OK;
    if (component->logging && component->logger)
        ((fmi2CallbackLogger)component->logger)(component->environment, component->name, fmi2Error,
                                                "logStatusError", component->message);
    return fmi2Error;
}

static fmi2Status refuse(Component *component, const char *message)
{
    return status(component, component_refuse(component, message));
}

/* ---- Life of an instance ---- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    ((Component *)c)->logging = on; /* there is one category */
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    Component *component = component_new(name);
    if (!component) return NULL;
    component->logger = (AnyFunction)host->logger;
    component->environment = host->componentEnvironment;
    component->logging = logging;
    if (status(component, component_check_guid(component, guid)) == fmi2OK) return component;
    component_free(component);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c) { component_free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop)
{
    component_set_time(c, start);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return status(c, component_initialize(c)); }

fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2Reset(fmi2Component c)
{
    component_reset(c);
    return fmi2OK;
}

/* ---- Variables ---- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    return status(c, component_get(c, vr, n, value, n));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    return status(c, component_set(c, vr, n, value, n));
}

#define NO_VARIABLES(function, value_type)                                                            \
    fmi2Status function(fmi2Component c, const fmi2ValueReference vr[], size_t n, value_type value[]) \
    {                                                                                                 \
        return n == 0 ? fmi2OK : refuse(c, #function ": all variables of this FMU are of type Real"); \
    }

NO_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_VARIABLES(fmi2GetString, fmi2String)
NO_VARIABLES(fmi2SetString, const fmi2String)

/* ---- State ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return status(c, component_save(c, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    component_restore(c, state);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    component_forget(state);
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    *size = component_serialized_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return status(c, component_serialize(c, state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return status(c, component_deserialize(c, bytes, size, state));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known,
                                        const fmi2Real d_known[], fmi2Real d_unknown[])
{
    return refuse(c, "this FMU provides no directional derivatives");
}

/* ---- Co-simulation ---- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state)
{
    return status(c, component_step(c, t, h));
}

fmi2Status fmi2CancelStep(fmi2Component c) { return refuse(c, "steps end at once, there is none to cancel"); }

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    return n == 0 ? fmi2OK : refuse(c, "this FMU does not interpolate its inputs");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    return n == 0 ? fmi2OK : refuse(c, "this FMU provides no derivatives of its outputs");
}

/* Steps end at once and nothing is pending, so there is no such status to ask for. */
#define NO_STATUS(function, value_type) \
    fmi2Status function(fmi2Component c, const fmi2StatusKind kind, value_type *value) { return fmi2Discard; }

NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((Component *)c)->memory->time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

/* ---- Model Exchange: continuous states and time events, no state events ---- */

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    component_set_time(c, time);
    return fmi2OK;
}

fmi2Status fmi2EnterEventMode(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    const fmi2Status handled = status(c, component_event(c));
    memset(info, 0, sizeof *info);
    info->nextEventTime = component_next_event(c);
    info->nextEventTimeDefined = isfinite(info->nextEventTime) ? fmi2True : fmi2False;
    return handled;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_state,
                                       fmi2Boolean *enter_event_mode, fmi2Boolean *terminate)
{
    *enter_event_mode = fmi2False;
    *terminate = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    return status(c, component_set_states(c, x, n));
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    return status(c, component_get_states(c, x, n));
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n)
{
    return status(c, component_get_derivatives(c, dx, n));
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n)
{
    for (size_t i = 0; i < n; i++)
        nominals[i] = 1.0;
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n)
{
    return n == 0 ? fmi2OK : refuse(c, "this FMU has no event indicators");
}
