/* FMI 3.0 co-simulation and Model Exchange: a translation to component.h, nothing else. */
#include "fmi3Functions.h"

#include <math.h>
#include <stdlib.h>

#include "component.h"
#include "identity.h"

static fmi3Status status(Component *component, bool succeeded)
{
    if (succeeded) return fmi3OK;
    if (component->logging && component->logger)
        ((fmi3LogMessageCallback)component->logger)(component->environment, fmi3Error, "logStatusError",
                                                    component->message);
    return fmi3Error;
}

static fmi3Status refuse(Component *component, const char *message)
{
    return status(component, component_refuse(component, message));
}

/* ---- Life of an instance ---- */

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    ((Component *)c)->logging = on; /* there is one category */
    return fmi3OK;
}

static Component *instantiate(const char *name, const char *token, bool logging, void *environment,
                              fmi3LogMessageCallback logger)
{
    Component *component = component_new(name);
    if (!component) return NULL;
    component->logger = (AnyFunction)logger;
    component->environment = environment;
    component->logging = logging;
    if (status(component, component_check_guid(component, token)) == fmi3OK) return component;
    component_free(component);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    return instantiate(name, token, logging, environment, logger);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean event_mode_used, fmi3Boolean early_return_allowed,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update)
{
    Component *component = instantiate(name, token, logging, environment, logger);
    if (!component || !event_mode_used) return component;
    refuse(component, "this FMU has no event mode in co-simulation (hasEventMode = false)");
    component_free(component);
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback logger, fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    return NULL; /* the model description offers no scheduled execution */
}

void fmi3FreeInstance(fmi3Instance c) { component_free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    component_set_time(c, start);
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return status(c, component_initialize(c)); }

fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }

fmi3Status fmi3Reset(fmi3Instance c)
{
    component_reset(c);
    return fmi3OK;
}

/* Modes without anything to do in them. */
#define EMPTY(function) \
    fmi3Status function(fmi3Instance c) { return fmi3OK; }

EMPTY(fmi3EnterEventMode)
EMPTY(fmi3EnterStepMode)
EMPTY(fmi3EnterContinuousTimeMode)
EMPTY(fmi3EnterConfigurationMode)
EMPTY(fmi3ExitConfigurationMode)
EMPTY(fmi3EvaluateDiscreteStates)

/* ---- Variables ---- */

#if MODEL_FLOAT_BITS == 64

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t n_values)
{
    return status(c, component_get(c, vr, n, values, n_values));
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values)
{
    return status(c, component_set(c, vr, n, values, n_values));
}

#define FLOAT_TYPE "Float64"

#else /* single precision outside, double precision inside */

fmi3Status fmi3GetFloat32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float32 values[],
                          size_t n_values)
{
    double *inside = calloc(n_values + 1, sizeof(double)); /* + 1: calloc(0) may return NULL */
    if (!inside) return refuse(c, "no memory left to read variables");
    const bool found = component_get(c, vr, n, inside, n_values);
    for (size_t i = 0; found && i < n_values; i++)
        values[i] = (fmi3Float32)inside[i];
    free(inside);
    return status(c, found);
}

fmi3Status fmi3SetFloat32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float32 values[],
                          size_t n_values)
{
    double *inside = calloc(n_values + 1, sizeof(double));
    if (!inside) return refuse(c, "no memory left to set variables");
    for (size_t i = 0; i < n_values; i++)
        inside[i] = values[i];
    const bool found = component_set(c, vr, n, inside, n_values);
    free(inside);
    return status(c, found);
}

#define FLOAT_TYPE "Float32"

#endif

/* The other types; what stands between the references and the end differs. */
#define NO_VARIABLES(function, ...)                                                                          \
    fmi3Status function(fmi3Instance c, const fmi3ValueReference vr[], size_t n, __VA_ARGS__)                \
    {                                                                                                        \
        return n == 0 ? fmi3OK : refuse(c, #function ": all variables of this FMU are of type " FLOAT_TYPE); \
    }
#define NO_VARIABLES_OF_TYPE(name)                                    \
    NO_VARIABLES(fmi3Get##name, fmi3##name values[], size_t n_values) \
    NO_VARIABLES(fmi3Set##name, const fmi3##name values[], size_t n_values)

#if MODEL_FLOAT_BITS == 64
NO_VARIABLES_OF_TYPE(Float32)
#else
NO_VARIABLES_OF_TYPE(Float64)
#endif
NO_VARIABLES_OF_TYPE(Int8)
NO_VARIABLES_OF_TYPE(UInt8)
NO_VARIABLES_OF_TYPE(Int16)
NO_VARIABLES_OF_TYPE(UInt16)
NO_VARIABLES_OF_TYPE(Int32)
NO_VARIABLES_OF_TYPE(UInt32)
NO_VARIABLES_OF_TYPE(Int64)
NO_VARIABLES_OF_TYPE(UInt64)
NO_VARIABLES_OF_TYPE(Boolean)
NO_VARIABLES_OF_TYPE(String)
NO_VARIABLES(fmi3GetBinary, size_t sizes[], fmi3Binary values[], size_t n_values)
NO_VARIABLES(fmi3SetBinary, const size_t sizes[], const fmi3Binary values[], size_t n_values)
NO_VARIABLES(fmi3GetClock, fmi3Clock values[])
NO_VARIABLES(fmi3SetClock, const fmi3Clock values[])
NO_VARIABLES(fmi3GetIntervalDecimal, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(fmi3SetIntervalDecimal, const fmi3Float64 intervals[])
NO_VARIABLES(fmi3GetIntervalFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
             fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(fmi3SetIntervalFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NO_VARIABLES(fmi3GetShiftDecimal, fmi3Float64 shifts[])
NO_VARIABLES(fmi3SetShiftDecimal, const fmi3Float64 shifts[])
NO_VARIABLES(fmi3GetShiftFraction, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NO_VARIABLES(fmi3SetShiftFraction, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t *n)
{
    return refuse(c, "this FMU provides no dependencies per element");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent,
                                       size_t dependent_elements[], fmi3ValueReference independents[],
                                       size_t independent_elements[], fmi3DependencyKind kinds[], size_t n)
{
    return refuse(c, "this FMU provides no dependencies per element");
}

#define NO_DERIVATIVES(function)                                                                      \
    fmi3Status function(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,       \
                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], \
                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)               \
    {                                                                                                 \
        return refuse(c, #function ": this FMU provides no partial derivatives");                     \
    }

NO_DERIVATIVES(fmi3GetDirectionalDerivative)
NO_DERIVATIVES(fmi3GetAdjointDerivative)

/* ---- State ---- */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    return status(c, component_save(c, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    component_restore(c, state);
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    component_forget(state);
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    *size = component_serialized_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return status(c, component_serialize(c, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return status(c, component_deserialize(c, bytes, size, state));
}

/* ---- Co-simulation ---- */

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_set_state,
                      fmi3Boolean *event_handling_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_successful_time)
{
    const fmi3Status stepped = status(c, component_step(c, t, h));
    *event_handling_needed = fmi3False;
    *terminate = fmi3False;
    *early_return = fmi3False;
    *last_successful_time = ((Component *)c)->memory->time;
    return stepped;
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                    const fmi3Int32 orders[], fmi3Float64 values[], size_t n_values)
{
    return n == 0 ? fmi3OK : refuse(c, "this FMU provides no derivatives of its outputs");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
    return refuse(c, "this FMU has no clocks and no model partitions");
}

/* ---- Model Exchange: continuous states and time events, no state events ---- */

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    component_set_time(c, time);
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *update_needed, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *states_changed,
                                    fmi3Boolean *next_event_defined, fmi3Float64 *next_event)
{
    const fmi3Status handled = status(c, component_event(c));
    *update_needed = fmi3False;
    *terminate = fmi3False;
    *nominals_changed = fmi3False;
    *states_changed = fmi3False;
    *next_event = component_next_event(c);
    *next_event_defined = isfinite(*next_event);
    return handled;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_set_state,
                                       fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    *enter_event_mode = fmi3False;
    *terminate = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
{
    return status(c, component_set_states(c, x, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    return status(c, component_get_states(c, x, n));
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n)
{
    return status(c, component_get_derivatives(c, dx, n));
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n)
{
    for (size_t i = 0; i < n; i++)
        nominals[i] = 1.0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
{
    *n = MODEL_STATES;
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n)
{
    return n == 0 ? fmi3OK : refuse(c, "this FMU has no event indicators");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
{
    *n = 0;
    return fmi3OK;
}
