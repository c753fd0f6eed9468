/* FMI 3.0 co-simulation and Model Exchange: a translation to component.h, nothing else. Beyond the standard (sections
 * 2.3, 3.2 and 4.2), variables may be read before initialization, and time may be set in event mode. */
#include "fmi3Functions.h"

#include <stdlib.h>

#define FMI(name) fmi3##name
#define LOG(c) ((fmi3LogMessageCallback)c->logger)(c->environment, fmi3Error, "logStatusError", c->message)
#define LOGS_ERRORS(c) true

#include "translation.h"

/* ---- Life of an instance ---- */

const char *fmi3GetVersion(void) { return fmi3Version; }
METHOD_OF(fmi3SetDebugLogging, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    ALLOWED_IN(ANY_STATE);
    return set_logging(c, on);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger)
{
    return instantiate(name, token, MODEL_EXCHANGE, (AnyFunction)logger, environment, logging);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode_used,
                                         fmi3Boolean early_return_allowed, const fmi3ValueReference intermediate[],
                                         size_t n_intermediate, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logger, fmi3IntermediateUpdateCallback update)
{
    Component *component = instantiate(name, token, CO_SIMULATION, (AnyFunction)logger, environment, logging);
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
    return instantiate(name, token, ANOTHER_KIND, (AnyFunction)logger, environment, logging);
}

void fmi3FreeInstance(fmi3Instance c) { component_free(c); }
METHOD_OF(fmi3EnterInitializationMode, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start,
          fmi3Boolean stop_defined, fmi3Float64 stop)
{
    ALLOWED_IN(INSTANTIATED);
    if (!component_set_times(c, start, stop_defined ? stop : INFINITY)) return status(c, false);
    return enter(c, INITIALIZATION);
}
METHOD(fmi3ExitInitializationMode)
{
    ALLOWED_IN(INITIALIZATION);
    return status(c, component_initialize(c));
}
METHOD(fmi3Terminate)
{
    ALLOWED_IN(INITIALIZED);
    return enter(c, TERMINATED);
}
METHOD(fmi3Reset)
{
    ALLOWED_IN(ANY_STATE);
    return reset(c);
}

METHOD(fmi3EnterEventMode)
{
    ALLOWED_IN(CONTINUOUS_TIME);
    SELF->memory->latest_event = SELF->memory->time;
    return enter(c, EVENT);
}
METHOD(fmi3EnterContinuousTimeMode)
{
    ALLOWED_IN(EVENT);
    return enter(c, CONTINUOUS_TIME);
}
METHOD(fmi3EnterStepMode)
{
    ALLOWED_IN(NO_STATE);
    return fmi3OK;
} /* hasEventMode = false */

/* There are no structural parameters to configure, and no discrete states to evaluate beside events. */
METHOD(fmi3EnterConfigurationMode)
{
    ALLOWED_IN(NO_STATE);
    return fmi3OK;
}
METHOD(fmi3ExitConfigurationMode)
{
    ALLOWED_IN(NO_STATE);
    return fmi3OK;
}
METHOD(fmi3EvaluateDiscreteStates)
{
    ALLOWED_IN(NO_STATE);
    return fmi3OK;
}

/* ---- Variables ---- */

/* What stands between the references and the end differs. */
#define VARIABLES(name, ...) METHOD_OF(name, const fmi3ValueReference vr[], size_t n, __VA_ARGS__)
#define NO_VARIABLES(name, states, ...)                                                       \
    VARIABLES(name, __VA_ARGS__)                                                              \
    {                                                                                         \
        ALLOWED_IN(states);                                                                   \
        return refuse_any(c, n, #name ": all variables of this FMU are of type " FLOAT_TYPE); \
    }
#define NO_VARIABLES_OF_TYPE(name)                                             \
    NO_VARIABLES(fmi3Get##name, TO_READ, fmi3##name values[], size_t n_values) \
    NO_VARIABLES(fmi3Set##name, TO_SET, const fmi3##name values[], size_t n_values)

#if MODEL_FLOAT_BITS == 64
#define FLOAT_TYPE "Float64"

VARIABLES(fmi3GetFloat64, fmi3Float64 values[], size_t n_values)
{
    ALLOWED_IN(TO_READ);
    return status(c, component_get(c, vr, n, values, n_values));
}
VARIABLES(fmi3SetFloat64, const fmi3Float64 values[], size_t n_values)
{
    ALLOWED_IN(TO_SET);
    return status(c, component_set(c, vr, n, values, n_values));
}
NO_VARIABLES_OF_TYPE(Float32)

#else /* single precision outside, double precision inside */
#define FLOAT_TYPE "Float32"

/* Memory for the values of n variables in double precision; NULL if there is none left, or no variables can have so
 * many values. */
static double *new_doubles(Component *c, size_t n, size_t n_values)
{
    double *inside = NULL;
    if (n_values / (model_variables + 1) > n)
        component_refuse(c, "far more values were passed than the variables have");
    else if (!(inside = calloc(n_values + 1, sizeof(double)))) /* + 1: calloc(0) may return NULL */
        component_refuse(c, "no memory left for the values");
    return inside;
}

VARIABLES(fmi3GetFloat32, fmi3Float32 values[], size_t n_values)
{
    ALLOWED_IN(TO_READ);
    double *inside = new_doubles(c, n, n_values);
    const bool found =
        inside && (n_values == 0 || check_result(c, values)) && component_get(c, vr, n, inside, n_values);
    for (size_t i = 0; found && i < n_values; i++)
        values[i] = (fmi3Float32)inside[i];
    free(inside);
    return status(c, found);
}
VARIABLES(fmi3SetFloat32, const fmi3Float32 values[], size_t n_values)
{
    ALLOWED_IN(TO_SET);
    if (!(n_values == 0 || check_result(c, values))) return status(c, false);
    double *inside = new_doubles(c, n, n_values);
    for (size_t i = 0; inside && i < n_values; i++)
        inside[i] = values[i];
    const bool found = inside && component_set(c, vr, n, inside, n_values);
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
NO_VARIABLES(fmi3GetBinary, TO_READ, size_t sizes[], fmi3Binary values[], size_t n_values)
NO_VARIABLES(fmi3SetBinary, TO_SET, const size_t sizes[], const fmi3Binary values[], size_t n_values)
NO_VARIABLES(fmi3GetClock, TO_READ, fmi3Clock values[])
NO_VARIABLES(fmi3SetClock, TO_SET, const fmi3Clock values[])
NO_VARIABLES(fmi3GetIntervalDecimal, TO_READ, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(fmi3SetIntervalDecimal, TO_SET, const fmi3Float64 intervals[])
NO_VARIABLES(fmi3GetIntervalFraction, TO_READ, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
             fmi3IntervalQualifier qualifiers[])
NO_VARIABLES(fmi3SetIntervalFraction, TO_SET, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
NO_VARIABLES(fmi3GetShiftDecimal, TO_READ, fmi3Float64 shifts[])
NO_VARIABLES(fmi3SetShiftDecimal, TO_SET, const fmi3Float64 shifts[])
NO_VARIABLES(fmi3GetShiftFraction, TO_READ, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NO_VARIABLES(fmi3SetShiftFraction, TO_SET, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])

static const char *const NO_DEPENDENCIES = "this FMU provides no dependencies per element";
METHOD_OF(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *n)
{
    ALLOWED_IN(ANY_STATE);
    return refuse(c, NO_DEPENDENCIES);
}
METHOD_OF(fmi3GetVariableDependencies, fmi3ValueReference dependent, size_t dependent_elements[],
          fmi3ValueReference independents[], size_t independent_elements[], fmi3DependencyKind kinds[], size_t n)
{
    ALLOWED_IN(ANY_STATE);
    return refuse(c, NO_DEPENDENCIES);
}

#define NO_DERIVATIVES(name)                                                                                   \
    METHOD_OF(name, const fmi3ValueReference unknowns[], size_t n_unknowns, const fmi3ValueReference knowns[], \
              size_t n_knowns, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[],             \
              size_t n_sensitivity)                                                                            \
    {                                                                                                          \
        ALLOWED_IN(TO_EVALUATE | STEP);                                                                        \
        return refuse(c, #name ": this FMU provides no partial derivatives");                                  \
    }
NO_DERIVATIVES(fmi3GetDirectionalDerivative)
NO_DERIVATIVES(fmi3GetAdjointDerivative)

/* ---- State ---- */

METHOD_OF(fmi3GetFMUState, fmi3FMUState *state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_save(c, state));
}
METHOD_OF(fmi3SetFMUState, fmi3FMUState state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_restore(c, state));
}
METHOD_OF(fmi3FreeFMUState, fmi3FMUState *state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_forget(c, state));
}
METHOD_OF(fmi3SerializedFMUStateSize, fmi3FMUState state, size_t *size)
{
    ALLOWED_IN(ANY_STATE);
    return serialized_size(c, state, size);
}
METHOD_OF(fmi3SerializeFMUState, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_serialize(c, state, bytes, size));
}
METHOD_OF(fmi3DeserializeFMUState, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    ALLOWED_IN(ANY_STATE);
    return status(c, component_deserialize(c, bytes, size, state));
}

/* ---- Co-simulation ---- */

METHOD_OF(fmi3DoStep, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_set_state, fmi3Boolean *event_handling_needed,
          fmi3Boolean *terminate, fmi3Boolean *early_return, fmi3Float64 *last_successful_time)
{
    ALLOWED_IN(STEP);
    if (!check_result(c, event_handling_needed) || !check_result(c, terminate) || !check_result(c, early_return) ||
        !check_result(c, last_successful_time))
        return status(c, false);
    const bool stepped = h == 0.0 ? component_refuse_number(c, "step of %g s refused: FMI 3.0 has no steps of zero", h)
                                  : component_step(c, t, h);
    *event_handling_needed = *terminate = *early_return = fmi3False;
    *last_successful_time = SELF->memory->time;
    return status(c, stepped);
}

METHOD_OF(fmi3GetOutputDerivatives, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
          fmi3Float64 values[], size_t n_values)
{
    ALLOWED_IN(IN_CO_SIMULATION(STEP | TERMINATED | FAILED));
    return refuse_any(c, n, "this FMU provides no derivatives of its outputs");
}
METHOD_OF(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
{
    ALLOWED_IN(NO_STATE); /* there are no clocks and no model partitions */
    return fmi3OK;
}

/* ---- Model Exchange: continuous states and time events, no state events ---- */

METHOD_OF(fmi3SetTime, fmi3Float64 time)
{
    ALLOWED_IN(EVENT | CONTINUOUS_TIME);
    return status(c, component_set_time(c, time));
}
METHOD_OF(fmi3SetContinuousStates, const fmi3Float64 x[], size_t n)
{
    ALLOWED_IN(CONTINUOUS_TIME);
    return status(c, component_set_states(c, x, n));
}
METHOD_OF(fmi3GetContinuousStates, fmi3Float64 x[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(TO_EVALUATE));
    return status(c, component_get_states(c, x, n));
}
METHOD_OF(fmi3GetContinuousStateDerivatives, fmi3Float64 dx[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(TO_EVALUATE));
    return status(c, component_get_derivatives(c, dx, n));
}
METHOD_OF(fmi3GetNominalsOfContinuousStates, fmi3Float64 x[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(TO_EVALUATE));
    return status(c, component_get_nominals(c, x, n));
}
METHOD_OF(fmi3GetEventIndicators, fmi3Float64 z[], size_t n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(TO_EVALUATE));
    return refuse_any(c, n, "this FMU has no event indicators");
}

static fmi3Status give_number(Component *c, size_t *n, size_t number)
{
    if (!check_result(c, n)) return status(c, false);
    *n = number;
    return fmi3OK;
}
METHOD_OF(fmi3GetNumberOfContinuousStates, size_t *n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(ANY_STATE));
    return give_number(c, n, MODEL_STATES);
}
METHOD_OF(fmi3GetNumberOfEventIndicators, size_t *n)
{
    ALLOWED_IN(IN_MODEL_EXCHANGE(ANY_STATE));
    return give_number(c, n, 0);
}

METHOD_OF(fmi3UpdateDiscreteStates, fmi3Boolean *update_needed, fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
          fmi3Boolean *states_changed, fmi3Boolean *next_event_defined, fmi3Float64 *next_event)
{
    ALLOWED_IN(EVENT);
    if (!check_result(c, update_needed) || !check_result(c, terminate) || !check_result(c, nominals_changed) ||
        !check_result(c, states_changed) || !check_result(c, next_event_defined) || !check_result(c, next_event) ||
        !component_event(c))
        return status(c, false);
    *update_needed = *terminate = *nominals_changed = *states_changed = fmi3False;
    *next_event = component_next_event(c);
    *next_event_defined = isfinite(*next_event);
    return fmi3OK;
}

METHOD_OF(fmi3CompletedIntegratorStep, fmi3Boolean no_set_state, fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    ALLOWED_IN(CONTINUOUS_TIME);
    if (!check_result(c, enter_event_mode) || !check_result(c, terminate)) return status(c, false);
    *enter_event_mode = *terminate = fmi3False;
    return fmi3OK;
}
