/* What the translations of the standards to component.h share. Before it is included, FMI(name) makes the standard's
 * name of a type or constant, LOG(c) hands the message of the component c to the importer's logger, and LOGS_ERRORS(c)
 * tells whether the standard wants that for an error. */
#ifndef TRANSLATION_H
#define TRANSLATION_H

#include <math.h>

#include "component.h"
#include "identity.h"

#ifndef NAME
#define NAME(name) name
#define EXPORT /* the standard's header has declared what is exported */
#endif

/* The head of a function of the standard that gets an instance alone, or an instance and more. */
#define METHOD(name) EXPORT FMI(Status) NAME(name)(void *c)
#define METHOD_OF(name, ...) EXPORT FMI(Status) NAME(name)(void *c, __VA_ARGS__)

/* The first line of each of them: in which states the standard allows the call. Without an instance there is nobody to
 * log to. */
#define ALLOWED_IN(states)                                           \
    do {                                                             \
        if (!c) return FMI(Error);                                   \
        if (!(((Component *)c)->memory->state & (unsigned)(states))) \
            return status(c, component_refuse_call(c, __func__));    \
    } while (0)

/* Sets of states for the functions of one kind of FMU, and of a function that this FMU never allows. */
#define IN_MODEL_EXCHANGE(states) (MODEL_IS_MODEL_EXCHANGE ? (states) : 0)
#define IN_CO_SIMULATION(states) (MODEL_IS_MODEL_EXCHANGE ? 0 : (states))
#define NO_STATE 0

/* Variables are read in any state: before initialization, which FMI 1.0 and 2.0 do not ask for, importers show start
 * values; after an error values are for debugging. */
#define TO_READ ANY_STATE
/* Which variables may be set in which of these states, component.c decides. */
#define TO_SET (INSTANTIATED | INITIALIZATION | INITIALIZED)
#define TO_EVALUATE (INITIALIZATION | EVENT | CONTINUOUS_TIME | TERMINATED | FAILED)

#define SELF ((Component *)c)

static FMI(Status) status(Component *c, bool succeeded)
{
    if (succeeded) return FMI(OK);
    c->memory->state = FAILED;
    if (c->logger && LOGS_ERRORS(c)) LOG(c);
    return FMI(Error);
}

static FMI(Status) refuse(Component *c, const char *message) { return status(c, component_refuse(c, message)); }

/* Of what the FMU does not have, nobody may ask for more than 0. */
static FMI(Status) refuse_any(Component *c, size_t n, const char *message)
{
    return n == 0 ? FMI(OK) : refuse(c, message);
}

/* Where a function is to write to. */
static bool check_result(Component *c, const void *result)
{
    return result || component_refuse(c, "NULL was passed instead of the address of a result");
}

static FMI(Status) enter(Component *c, unsigned state)
{
    c->memory->state = state;
    return FMI(OK);
}

static FMI(Status) reset(Component *c)
{
    component_reset(c);
    return FMI(OK);
}

static FMI(Status) set_logging(Component *c, bool on)
{
    c->logging = on; /* there is one category */
    return FMI(OK);
}

/* FMI 1.0 has no saved states. */
static inline FMI(Status) serialized_size(Component *c, const void *state, size_t *size)
{
    if (!state) return refuse(c, "NULL was passed instead of a state");
    if (!check_result(c, size)) return status(c, false);
    *size = component_serialized_size();
    return FMI(OK);
}

/* A new instance, or NULL if there is no memory left, the FMU is described by another description, or is not of that
 * kind; the reason is logged in any case, as FMI 2.0 and 3.0 want it. */
static Component *instantiate(const char *name, const char *guid, Kind kind, AnyFunction logger, void *environment,
                              bool logging)
{
    Component *c = component_new(name);
    if (!c) return NULL;
    c->logger = logger;
    c->environment = environment;
    c->logging = logging;
    if ((name || component_refuse(c, "the instance has no name: NULL was passed")) &&
        component_check_identity(c, guid, kind))
        return c;
    if (logger) LOG(c);
    component_free(c);
    return NULL;
}

#endif
