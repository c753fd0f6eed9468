/* FMI 1.0 co-simulation: a translation to component.h, nothing else. Beyond the standard, an instance may be freed and
 * reset in any state. */
#include <stddef.h>

#include "fmi1Functions.h"

#define FMI(name) fmi1##name
#define LOG(c) ((fmi1CallbackLogger)c->logger)(c, c->name, fmi1Error, "logStatusError", c->message)
#define LOGS_ERRORS(c) (c->logging)

/* The names of all functions begin with the model's. */
#define JOIN(identifier, name) identifier##_##name
#define JOIN_EXPANDED(identifier, name) JOIN(identifier, name)
#define NAME(name) JOIN_EXPANDED(MODEL_IDENTIFIER, name)
#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

#include "translation.h"

/* ---- Life of an instance ---- */

EXPORT const char *NAME(fmiGetTypesPlatform)(void) { return "standard32"; }
EXPORT const char *NAME(fmiGetVersion)(void) { return "1.0"; }
METHOD_OF(fmiSetDebugLogging, fmi1Boolean on)
{
    ALLOWED_IN(ANY_STATE);
    return set_logging(c, on);
}

EXPORT fmi1Component NAME(fmiInstantiateSlave)(fmi1String name, fmi1String guid, fmi1String location, fmi1String mime,
                                               fmi1Real timeout, fmi1Boolean visible, fmi1Boolean interactive,
                                               fmi1CallbackFunctions host, fmi1Boolean logging)
{
    return instantiate(name, guid, CO_SIMULATION, (AnyFunction)host.logger, NULL, logging);
}

EXPORT void NAME(fmiFreeSlaveInstance)(fmi1Component c) { component_free(c); }
METHOD(fmiTerminateSlave)
{
    ALLOWED_IN(STEP);
    return enter(c, TERMINATED);
}
METHOD(fmiResetSlave)
{
    ALLOWED_IN(ANY_STATE);
    return reset(c);
}
METHOD_OF(fmiInitializeSlave, fmi1Real start, fmi1Boolean stop_defined, fmi1Real stop)
{
    ALLOWED_IN(INSTANTIATED);
    return status(c, component_set_times(c, start, stop_defined ? stop : INFINITY) && component_initialize(c));
}

/* ---- Variables ---- */

#define VARIABLES(name, type) METHOD_OF(name, const fmi1ValueReference vr[], size_t n, type value[])
VARIABLES(fmiGetReal, fmi1Real)
{
    ALLOWED_IN(TO_READ);
    return status(c, component_get(c, vr, n, value, n));
}
VARIABLES(fmiSetReal, const fmi1Real)
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
NO_VARIABLES(fmiGetInteger, fmi1Integer, TO_READ)
NO_VARIABLES(fmiSetInteger, const fmi1Integer, TO_SET)
NO_VARIABLES(fmiGetBoolean, fmi1Boolean, TO_READ)
NO_VARIABLES(fmiSetBoolean, const fmi1Boolean, TO_SET)
NO_VARIABLES(fmiGetString, fmi1String, TO_READ)
NO_VARIABLES(fmiSetString, const fmi1String, TO_SET)

/* ---- Steps ---- */

METHOD_OF(fmiDoStep, fmi1Real t, fmi1Real h, fmi1Boolean new_step)
{
    ALLOWED_IN(STEP);
    return status(c, component_step(c, t, h));
}
METHOD(fmiCancelStep)
{
    ALLOWED_IN(NO_STATE);
    return fmi1OK;
} /* steps end at once, none is in progress */

#define DERIVATIVES(name, type) \
    METHOD_OF(name, const fmi1ValueReference vr[], size_t n, const fmi1Integer order[], type value[])
DERIVATIVES(fmiSetRealInputDerivatives, const fmi1Real)
{
    ALLOWED_IN(INSTANTIATED | STEP);
    return refuse_any(c, n, "this FMU does not interpolate its inputs");
}
DERIVATIVES(fmiGetRealOutputDerivatives, fmi1Real)
{
    ALLOWED_IN(STEP | TERMINATED | FAILED);
    return refuse_any(c, n, "this FMU provides no derivatives of its outputs");
}

/* Steps end at once and nothing is pending, so there is no such status to ask for. */
#define NO_STATUS(name, type)                         \
    METHOD_OF(name, fmi1StatusKind kind, type *value) \
    {                                                 \
        ALLOWED_IN(STEP | TERMINATED);                \
        return fmi1Discard;                           \
    }
NO_STATUS(fmiGetStatus, fmi1Status)
NO_STATUS(fmiGetIntegerStatus, fmi1Integer)
NO_STATUS(fmiGetBooleanStatus, fmi1Boolean)
NO_STATUS(fmiGetStringStatus, fmi1String)
METHOD_OF(fmiGetRealStatus, fmi1StatusKind kind, fmi1Real *value)
{
    ALLOWED_IN(STEP | TERMINATED);
    if (kind != fmi1LastSuccessfulTime) return fmi1Discard;
    if (!check_result(c, value)) return status(c, false);
    *value = SELF->memory->time;
    return fmi1OK;
}
