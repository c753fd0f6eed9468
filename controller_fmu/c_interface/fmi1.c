/* FMI 1.0 co-simulation: a translation to component.h, nothing else. */
#include <stddef.h>

#include "fmi1Functions.h"

#define FMI(name) fmi1##name
#define LOG(c) ((fmi1CallbackLogger)c->logger)(c, c->name, fmi1Error, "logStatusError", c->message)

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
METHOD_OF(fmiSetDebugLogging, fmi1Boolean on) { return DONE(SELF->logging = on); }

EXPORT fmi1Component NAME(fmiInstantiateSlave)(fmi1String name, fmi1String guid, fmi1String location, fmi1String mime,
                                               fmi1Real timeout, fmi1Boolean visible, fmi1Boolean interactive,
                                               fmi1CallbackFunctions host, fmi1Boolean logging)
{
    return instantiate(name, guid, (AnyFunction)host.logger, NULL, logging);
}

EXPORT void NAME(fmiFreeSlaveInstance)(fmi1Component c) { component_free(c); }
METHOD(fmiTerminateSlave) { return fmi1OK; }
METHOD(fmiResetSlave) { return DONE(component_reset(c)); }
METHOD_OF(fmiInitializeSlave, fmi1Real start, fmi1Boolean stop_defined, fmi1Real stop)
{
    SELF->memory->time = start;
    return status(c, component_initialize(c));
}

/* ---- Variables ---- */

#define VARIABLES(name, type) METHOD_OF(name, const fmi1ValueReference vr[], size_t n, type value[])
VARIABLES(fmiGetReal, fmi1Real) { return status(c, component_get(c, vr, n, value, n)); }
VARIABLES(fmiSetReal, const fmi1Real) { return status(c, component_set(c, vr, n, value, n)); }

#define NO_VARIABLES(name, type) \
    VARIABLES(name, type) { return refuse_any(c, n, #name ": all variables of this FMU are of type Real"); }
NO_VARIABLES(fmiGetInteger, fmi1Integer)
NO_VARIABLES(fmiSetInteger, const fmi1Integer)
NO_VARIABLES(fmiGetBoolean, fmi1Boolean)
NO_VARIABLES(fmiSetBoolean, const fmi1Boolean)
NO_VARIABLES(fmiGetString, fmi1String)
NO_VARIABLES(fmiSetString, const fmi1String)

/* ---- Steps ---- */

METHOD_OF(fmiDoStep, fmi1Real t, fmi1Real h, fmi1Boolean new_step) { return status(c, component_step(c, t, h)); }
METHOD(fmiCancelStep) { return refuse(c, "steps end at once, there is none to cancel"); }

#define DERIVATIVES(name, type) \
    METHOD_OF(name, const fmi1ValueReference vr[], size_t n, const fmi1Integer order[], type value[])
DERIVATIVES(fmiSetRealInputDerivatives, const fmi1Real)
{
    return refuse_any(c, n, "this FMU does not interpolate its inputs");
}
DERIVATIVES(fmiGetRealOutputDerivatives, fmi1Real)
{
    return refuse_any(c, n, "this FMU provides no derivatives of its outputs");
}

/* Steps end at once and nothing is pending, so there is no such status to ask for. */
#define NO_STATUS(name, type) \
    METHOD_OF(name, fmi1StatusKind kind, type *value) { return fmi1Discard; }
NO_STATUS(fmiGetStatus, fmi1Status)
NO_STATUS(fmiGetIntegerStatus, fmi1Integer)
NO_STATUS(fmiGetBooleanStatus, fmi1Boolean)
NO_STATUS(fmiGetStringStatus, fmi1String)
METHOD_OF(fmiGetRealStatus, fmi1StatusKind kind, fmi1Real *value)
{
    if (kind != fmi1LastSuccessfulTime) return fmi1Discard;
    *value = SELF->memory->time;
    return fmi1OK;
}
