/* What the translations of the standards to component.h share. Before it is included, FMI(name) makes the standard's
 * name of a type or constant, and LOG(c) hands the message of the component c to the importer's logger. */
#ifndef TRANSLATION_H
#define TRANSLATION_H

#include "component.h"
#include "identity.h"

#ifndef NAME
#define NAME(name) name
#define EXPORT /* the standard's header has declared what is exported */
#endif

/* The head of a function of the standard that gets an instance alone, or an instance and more. */
#define METHOD(name) EXPORT FMI(Status) NAME(name)(void *c)
#define METHOD_OF(name, ...) EXPORT FMI(Status) NAME(name)(void *c, __VA_ARGS__)

/* What a function returns after an effect that cannot fail. */
#define DONE(effect) ((effect), FMI(OK))
#define SELF ((Component *)c)

static FMI(Status) status(Component *c, bool succeeded)
{
    if (succeeded) return FMI(OK);
    if (c->logging && c->logger) LOG(c);
    return FMI(Error);
}

static FMI(Status) refuse(Component *c, const char *message) { return status(c, component_refuse(c, message)); }

/* Of what the FMU does not have, nobody may ask for more than 0. */
static FMI(Status) refuse_any(Component *c, size_t n, const char *message)
{
    return n == 0 ? FMI(OK) : refuse(c, message);
}

/* A new instance, or NULL if there is no memory left or the FMU is described by another description. */
static Component *instantiate(const char *name, const char *guid, AnyFunction logger, void *environment, bool logging)
{
    Component *c = component_new(name);
    if (!c) return NULL;
    c->logger = logger;
    c->environment = environment;
    c->logging = logging;
    if (status(c, component_check_guid(c, guid)) == FMI(OK)) return c;
    component_free(c);
    return NULL;
}

#endif
