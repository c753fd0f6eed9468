/* FMI 1.0 co-simulation: a translation to component.h, nothing else. */
#include <stddef.h>

#include "fmi1Functions.h"

#include "component.h"
#include "identity.h"

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT
#endif

/* In FMI 1.0 the names of all functions begin with the model's. */
#define JOIN(identifier, name) identifier##_##name
#define JOIN_EXPANDED(identifier, name) JOIN(identifier, name)
#define FMI(name) JOIN_EXPANDED(MODEL_IDENTIFIER, name)

static fmi1Status status(Component *component, bool succeeded)
{
    if (succeeded) return fmi1OK;
    if (component->logging && component->logger)
        ((fmi1CallbackLogger)component->logger)(component, component->name, fmi1Error, "logStatusError",
                                                component->message);
    return fmi1Error;
}

static fmi1Status refuse(Component *component, const char *message)
{
    return status(component, component_refuse(component, message));
}

/* ---- Life of an instance ---- */

EXPORT const char *FMI(fmiGetTypesPlatform)(void) { return "standard32"; }

EXPORT const char *FMI(fmiGetVersion)(void) { return "1.0"; }

EXPORT fmi1Status FMI(fmiSetDebugLogging)(fmi1Component c, fmi1Boolean on)
{
    ((Component *)c)->logging = on;
    return fmi1OK;
}

EXPORT fmi1Component FMI(fmiInstantiateSlave)(fmi1String name, fmi1String guid, fmi1String location,
                                              fmi1String mime, fmi1Real timeout, fmi1Boolean visible,
                                              fmi1Boolean interactive, fmi1CallbackFunctions host,
                                              fmi1Boolean logging)
{
    Component *component = component_new(name);
    if (!component) return NULL;
    component->logger = (AnyFunction)host.logger;
    component->logging = logging;
    if (status(component, component_check_guid(component, guid)) == fmi1OK) return component;
    component_free(component);
    return NULL;
}

EXPORT void FMI(fmiFreeSlaveInstance)(fmi1Component c) { component_free(c); }

EXPORT fmi1Status FMI(fmiInitializeSlave)(fmi1Component c, fmi1Real start, fmi1Boolean stop_defined,
                                          fmi1Real stop)
{
    component_set_time(c, start);
    return status(c, component_initialize(c));
}

EXPORT fmi1Status FMI(fmiTerminateSlave)(fmi1Component c) { return fmi1OK; }

EXPORT fmi1Status FMI(fmiResetSlave)(fmi1Component c)
{
    component_reset(c);
    return fmi1OK;
}

/* ---- Variables ---- */

EXPORT fmi1Status FMI(fmiGetReal)(fmi1Component c, const fmi1ValueReference vr[], size_t n, fmi1Real value[])
{
    return status(c, component_get(c, vr, n, value, n));
}

EXPORT fmi1Status FMI(fmiSetReal)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                  const fmi1Real value[])
{
    return status(c, component_set(c, vr, n, value, n));
}

#define NO_VARIABLES(function, value_type)                                                            \
    EXPORT fmi1Status FMI(function)(fmi1Component c, const fmi1ValueReference vr[], size_t n,         \
                                    value_type value[])                                               \
    {                                                                                                 \
        return n == 0 ? fmi1OK : refuse(c, #function ": all variables of this FMU are of type Real"); \
    }

NO_VARIABLES(fmiGetInteger, fmi1Integer)
NO_VARIABLES(fmiSetInteger, const fmi1Integer)
NO_VARIABLES(fmiGetBoolean, fmi1Boolean)
NO_VARIABLES(fmiSetBoolean, const fmi1Boolean)
NO_VARIABLES(fmiGetString, fmi1String)
NO_VARIABLES(fmiSetString, const fmi1String)

/* ---- Steps ---- */

EXPORT fmi1Status FMI(fmiDoStep)(fmi1Component c, fmi1Real t, fmi1Real h, fmi1Boolean new_step)
{
    return status(c, component_step(c, t, h));
}

EXPORT fmi1Status FMI(fmiCancelStep)(fmi1Component c)
{
    return refuse(c, "steps end at once, there is none to cancel");
}

EXPORT fmi1Status FMI(fmiSetRealInputDerivatives)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                                  const fmi1Integer order[], const fmi1Real value[])
{
    return n == 0 ? fmi1OK : refuse(c, "this FMU does not interpolate its inputs");
}

EXPORT fmi1Status FMI(fmiGetRealOutputDerivatives)(fmi1Component c, const fmi1ValueReference vr[], size_t n,
                                                   const fmi1Integer order[], fmi1Real value[])
{
    return n == 0 ? fmi1OK : refuse(c, "this FMU provides no derivatives of its outputs");
}

/* Steps end at once and nothing is pending, so there is no such status to ask for. */
#define NO_STATUS(function, value_type)                                                       \
    EXPORT fmi1Status FMI(function)(fmi1Component c, fmi1StatusKind kind, value_type * value) \
    {                                                                                         \
        return fmi1Discard;                                                                   \
    }

NO_STATUS(fmiGetStatus, fmi1Status)
NO_STATUS(fmiGetIntegerStatus, fmi1Integer)
NO_STATUS(fmiGetBooleanStatus, fmi1Boolean)
NO_STATUS(fmiGetStringStatus, fmi1String)

EXPORT fmi1Status FMI(fmiGetRealStatus)(fmi1Component c, fmi1StatusKind kind, fmi1Real *value)
{
    if (kind != fmi1LastSuccessfulTime) return fmi1Discard;
    *value = ((Component *)c)->memory->time;
    return fmi1OK;
}
