/* FMI 3.0 co-simulation and Model Exchange: a translation to component.h, nothing else. */
#include "fmi3Functions.h"

#include <math.h>
#include <stdlib.h>

#define FMI(name) fmi3##name
#define LOG(c) ((fmi3LogMessageCallback)c->logger)(c->environment, fmi3Error, "logStatusError", c->message)

#include "translation.h"

/* ---- Life of an instance ---- */

const char *fmi3GetVersion(void) { return fmi3Version; }
METHOD_OF(fmi3SetDebugLogging, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    return DONE(SELF->logging = on); /* there is one category */
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger)
{
    return instantiate(name, token, (AnyFunction)logger, environment, logging);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode_used,
                                         fmi3Boolean early_return_allowed, const fmi3ValueReference intermediate[],
                                         size_t n_intermediate, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logger, fmi3IntermediateUpdateCallback update)
{
    Component *component = instantiate(name, token, (AnyFunction)logger, environment, logging);
    if (!component || !event_mode_used) return component;
    refuse(component, "this FMU has no event mode in co-simulation (hasEventMode = false)");
    component_free(component);
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    return NULL; /* the model description offers no scheduled execution */
}

void fmi3FreeInstance(fmi3Instance c) { component_free(c); }
METHOD_OF(fmi3EnterInitializationMode, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start,
          fmi3Boolean stop_defined, fmi3Float64 stop)
{
    return DONE(SELF->memory->time = start);
}
METHOD(fmi3ExitInitializationMode) { return status(c, component_initialize(c)); }
METHOD(fmi3Terminate) { return fmi3OK; }
METHOD(fmi3Reset) { return DONE(component_reset(c)); }

/* Modes without anything to do in them. */
METHOD(fmi3EnterEventMode) { return fmi3OK; }
METHOD(fmi3EnterStepMode) { return fmi3OK; }
METHOD(fmi3EnterContinuousTimeMode) { return fmi3OK; }
METHOD(fmi3EnterConfigurationMode) { return fmi3OK; }
METHOD(fmi3ExitConfigurationMode) { return fmi3OK; }
METHOD(fmi3EvaluateDiscreteStates) { return fmi3OK; }

/* ---- Variables ---- */

/* What stands between the references and the end differs. */
#define VARIABLES(name, ...) METHOD_OF(name, const fmi3ValueReference vr[], size_t n, __VA_ARGS__)
#define NO_VARIABLES(name, ...)                                                               \
    VARIABLES(name, __VA_ARGS__)                                                              \
    {                                                                                         \
        return refuse_any(c, n, #name ": all variables of this FMU are of type " FLOAT_TYPE); \
    }
#define NO_VARIABLES_OF_TYPE(name)                                    \
    NO_VARIABLES(fmi3Get##name, fmi3##name values[], size_t n_values) \
    NO_VARIABLES(fmi3Set##name, const fmi3##name values[], size_t n_values)

#if MODEL_FLOAT_BITS == 64
#define FLOAT_TYPE "Float64"

VARIABLES(fmi3GetFloat64, fmi3Float64 values[], size_t n_values)
{
    return status(c, component_get(c, vr, n, values, n_values));
}
VARIABLES(fmi3SetFloat64, const fmi3Float64 values[], size_t n_values)
{
    return status(c, component_set(c, vr, n, values, n_values));
}
NO_VARIABLES_OF_TYPE(Float32)

#else /* single precision outside, double precision inside */
#define FLOAT_TYPE "Float32"

VARIABLES(fmi3GetFloat32, fmi3Float32 values[], size_t n_values)
{
    double *inside = calloc(n_values + 1, sizeof(double)); /* + 1: calloc(0) may return NULL */
    if (!inside) return refuse(c, "no memory left to read variables");
    const bool found = component_get(c, vr, n, inside, n_values);
    for (size_t i = 0; found && i < n_values; i++)
        values[i] = (fmi3Float32)inside[i];
    free(inside);
    return status(c, found);
}
VARIABLES(fmi3SetFloat32, const fmi3Float32 values[], size_t n_values)
{
    double *inside = calloc(n_values + 1, sizeof(double));
    if (!inside) return refuse(c, "no memory left to set variables");
    for (size_t i = 0; i < n_values; i++)
        inside[i] = values[i];
    const bool found = component_set(c, vr, n, inside, n_values);
    free(inside);
    return status(c, found);
}
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

static const char *const NO_DEPENDENCIES = "this FMU provides no dependencies per element";
METHOD_OF(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *n) { return refuse(c, NO_DEPENDENCIES); }
METHOD_OF(fmi3GetVariableDependencies, fmi3ValueReference dependent, size_t dependent_elements[],
          fmi3ValueReference independents[], size_t independent_elements[], fmi3DependencyKind kinds[], size_t n)
{
    return refuse(c, NO_DEPENDENCIES);
}

#define NO_DERIVATIVES(name)                                                                                   \
    METHOD_OF(name, const fmi3ValueReference unknowns[], size_t n_unknowns, const fmi3ValueReference knowns[], \
              size_t n_knowns, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[],             \
              size_t n_sensitivity)                                                                            \
    {                                                                                                          \
        return refuse(c, #name ": this FMU provides no partial derivatives");                                  \
    }
NO_DERIVATIVES(fmi3GetDirectionalDerivative)
NO_DERIVATIVES(fmi3GetAdjointDerivative)

/* ---- State ---- */

METHOD_OF(fmi3GetFMUState, fmi3FMUState *state) { return status(c, component_save(c, state)); }
METHOD_OF(fmi3SetFMUState, fmi3FMUState state) { return DONE(component_restore(c, state)); }
METHOD_OF(fmi3FreeFMUState, fmi3FMUState *state) { return DONE(component_forget(state)); }
METHOD_OF(fmi3SerializedFMUStateSize, fmi3FMUState state, size_t *size)
{
    return DONE(*size = component_serialized_size());
}
METHOD_OF(fmi3SerializeFMUState, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return status(c, component_serialize(c, state, bytes, size));
}
METHOD_OF(fmi3DeserializeFMUState, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return status(c, component_deserialize(c, bytes, size, state));
}

/* ---- Co-simulation ---- */

METHOD_OF(fmi3DoStep, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_set_state, fmi3Boolean *event_handling_needed,
          fmi3Boolean *terminate, fmi3Boolean *early_return, fmi3Float64 *last_successful_time)
{
    const fmi3Status stepped = status(c, component_step(c, t, h));
    *event_handling_needed = *terminate = *early_return = fmi3False;
    *last_successful_time = SELF->memory->time;
    return stepped;
}

METHOD_OF(fmi3GetOutputDerivatives, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
          fmi3Float64 values[], size_t n_values)
{
    return refuse_any(c, n, "this FMU provides no derivatives of its outputs");
}
METHOD_OF(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
{
    return refuse(c, "this FMU has no clocks and no model partitions");
}

/* ---- Model Exchange: continuous states and time events, no state events ---- */

METHOD_OF(fmi3SetTime, fmi3Float64 time) { return DONE(SELF->memory->time = time); }
METHOD_OF(fmi3SetContinuousStates, const fmi3Float64 x[], size_t n) { return status(c, component_set_states(c, x, n)); }
METHOD_OF(fmi3GetContinuousStates, fmi3Float64 x[], size_t n) { return status(c, component_get_states(c, x, n)); }
METHOD_OF(fmi3GetContinuousStateDerivatives, fmi3Float64 dx[], size_t n)
{
    return status(c, component_get_derivatives(c, dx, n));
}
METHOD_OF(fmi3GetNominalsOfContinuousStates, fmi3Float64 x[], size_t n) { return DONE(component_get_nominals(x, n)); }
METHOD_OF(fmi3GetNumberOfContinuousStates, size_t *n) { return DONE(*n = MODEL_STATES); }
METHOD_OF(fmi3GetEventIndicators, fmi3Float64 z[], size_t n)
{
    return refuse_any(c, n, "this FMU has no event indicators");
}
METHOD_OF(fmi3GetNumberOfEventIndicators, size_t *n) { return DONE(*n = 0); }

METHOD_OF(fmi3UpdateDiscreteStates, fmi3Boolean *update_needed, fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
          fmi3Boolean *states_changed, fmi3Boolean *next_event_defined, fmi3Float64 *next_event)
{
    const fmi3Status handled = status(c, component_event(c));
    *update_needed = *terminate = *nominals_changed = *states_changed = fmi3False;
    *next_event = component_next_event(c);
    *next_event_defined = isfinite(*next_event);
    return handled;
}

METHOD_OF(fmi3CompletedIntegratorStep, fmi3Boolean no_set_state, fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    return DONE(*enter_event_mode = *terminate = fmi3False);
}
