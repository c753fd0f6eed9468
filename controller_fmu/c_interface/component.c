#include "component.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "identity.h" /* written by the build: MODEL_IDENTIFIER, MODEL_GUID, MODEL_STATES and more */

/* An event counts as due a little early, in parts of the sample time: importers compute its time in their own
 * way and may miss it by a rounding error. */
static const double EVENT_TOLERANCE = 1e-6;

/* Value references of the continuous states and of their derivatives; an array must not be empty. */
static const unsigned STATE_REFERENCES[MODEL_STATES + 1] = {MODEL_STATE_REFERENCES};
static const unsigned DERIVATIVE_REFERENCES[MODEL_STATES + 1] = {MODEL_DERIVATIVE_REFERENCES};

static size_t memory_size(void) { return sizeof(Memory) + model_size; }

Component *component_new(const char *name)
{
    Component *component = calloc(1, sizeof(Component));
    if (!component) return NULL;
    component->name = malloc(strlen(name) + 1);
    component->memory = malloc(memory_size());
    if (!component->name || !component->memory) {
        component_free(component);
        return NULL;
    }
    strcpy(component->name, name);
    component_reset(component);
    return component;
}

void component_free(Component *component)
{
    if (!component) return;
    free(component->name);
    free(component->memory);
    free(component);
}

bool component_refuse(Component *component, const char *message)
{
    snprintf(component->message, MODEL_MESSAGE_SIZE, "%s", message);
    return false;
}

bool component_check_guid(Component *component, const char *guid)
{
    if (guid && strcmp(guid, MODEL_GUID) == 0) return true;
    return component_refuse(component, "the GUID is not " MODEL_GUID ", with which this FMU was built: pass the one "
                                       "in its own modelDescription.xml");
}

void component_reset(Component *component)
{
    memset(component->memory, 0, memory_size());
    model_start(component->memory->model);
}

/* The variables a reference stands for, or NULL if there are none or fewer values than variables. */
static double *find(Component *component, unsigned reference, size_t n_values, size_t *extent)
{
    const bool is_time = reference == model_variables;
    if (reference > model_variables) {
        snprintf(component->message, MODEL_MESSAGE_SIZE, "value reference %u unknown: the model has 0 to %u", reference,
                 (unsigned)model_variables);
        return NULL;
    }
    *extent = MODEL_HAS_ARRAYS && !is_time ? model_extent(reference) : 1;
    if (*extent > n_values) {
        snprintf(component->message, MODEL_MESSAGE_SIZE, "value reference %u has %u values, only %u were passed",
                 reference, (unsigned)*extent, (unsigned)n_values);
        return NULL;
    }
    return is_time ? &component->memory->time : component->memory->model + reference;
}

/* Brings what can be read up to date. */
static void refresh(Component *component)
{
    /* Until initialization has ended, outputs follow the parameters; a bad one is reported at its end. */
    if (!component->memory->running) model_initialize(component->memory->model, component->message);
#if MODEL_EVALUATES
    model_evaluate(component->memory->model);
#endif
}

bool component_get(Component *component, const unsigned references[], size_t n, double values[], size_t n_values)
{
    refresh(component);
    for (size_t i = 0, done = 0, extent = 0; i < n; i++, done += extent) {
        const double *variable = find(component, references[i], n_values - done, &extent);
        if (!variable) return false;
        memcpy(values + done, variable, extent * sizeof(double));
    }
    return true;
}

bool component_set(Component *component, const unsigned references[], size_t n, const double values[], size_t n_values)
{
    for (size_t i = 0, done = 0, extent = 0; i < n; i++, done += extent) {
        double *variable = find(component, references[i], n_values - done, &extent);
        if (!variable) return false;
        if (variable == &component->memory->time) return component_refuse(component, "the time cannot be set so");
        memcpy(variable, values + done, extent * sizeof(double));
    }
    return true;
}

bool component_initialize(Component *component)
{
    Memory *memory = component->memory;
    memory->start_time = memory->time;
    memory->running = model_initialize(memory->model, component->message);
    return memory->running;
}

bool component_step(Component *component, double t, double h)
{
    Memory *memory = component->memory;
    if (!model_step(memory->model, t, h, component->message)) return false;
    memory->time = t + h;
    return true;
}

double component_next_event(const Component *component)
{
    const Memory *memory = component->memory;
    const double h = model_sample_time(memory->model);
    return isfinite(h) ? memory->start_time + memory->samples * h : INFINITY;
}

bool component_event(Component *component)
{
    Memory *memory = component->memory;
    const double h = model_sample_time(memory->model);
    if (!isfinite(h) || memory->time < component_next_event(component) - EVENT_TOLERANCE * h) return true;
    if (!model_step(memory->model, memory->time, h, component->message)) return false;
    memory->samples += 1.0;
    return true;
}

static bool check_count(Component *component, size_t n)
{
    if (n == MODEL_STATES) return true;
    snprintf(component->message, MODEL_MESSAGE_SIZE, "the FMU has %u continuous states, %u were passed",
             (unsigned)MODEL_STATES, (unsigned)n);
    return false;
}

static bool read(Component *component, const unsigned references[], double values[], size_t n)
{
    if (!check_count(component, n)) return false;
    refresh(component);
    for (size_t i = 0; i < n; i++)
        values[i] = component->memory->model[references[i]];
    return true;
}

bool component_get_states(Component *component, double x[], size_t n)
{
    return read(component, STATE_REFERENCES, x, n);
}

bool component_get_derivatives(Component *component, double dx[], size_t n)
{
    return read(component, DERIVATIVE_REFERENCES, dx, n);
}

bool component_set_states(Component *component, const double x[], size_t n)
{
    if (!check_count(component, n)) return false;
    for (size_t i = 0; i < n; i++)
        component->memory->model[STATE_REFERENCES[i]] = x[i];
    return true;
}

void component_get_nominals(double x[], size_t n)
{
    for (size_t i = 0; i < n; i++)
        x[i] = 1.0;
}

static bool copy(Component *component, const void *memory, void **state)
{
    if (!*state) *state = malloc(memory_size());
    if (!*state) return component_refuse(component, "no memory left for a state");
    memcpy(*state, memory, memory_size());
    return true;
}

bool component_save(Component *component, void **state) { return copy(component, component->memory, state); }

void component_restore(Component *component, const void *state) { memcpy(component->memory, state, memory_size()); }

void component_forget(void **state)
{
    free(*state);
    *state = NULL;
}

size_t component_serialized_size(void) { return memory_size(); }

bool component_serialize(Component *component, const void *state, void *bytes, size_t size)
{
    if (size < memory_size()) return component_refuse(component, "the buffer is too small for the serialized state");
    memcpy(bytes, state, memory_size());
    return true;
}

bool component_deserialize(Component *component, const void *bytes, size_t size, void **state)
{
    if (size != memory_size()) return component_refuse(component, "the serialized state is not one of this FMU");
    return copy(component, bytes, state);
}
