#include "component.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "identity.h" /* written by the build: MODEL_IDENTIFIER, MODEL_GUID, MODEL_STATES and more */

/* Importers compute times in their own way. A time may be so far beside where it should be, in parts of the step: one that
 * sums up steps of 0.25 ms is a hundredth of a step off after 9,000 s. Then what times are rounded to, in parts of the
 * time. */
static const double LEEWAY = 0.01, ROUNDING = 1e-14;

/* In Model Exchange an event counts as due so early, in parts of the sample time. */
static const double EARLY = 1e-6;

/* Largest time [s]: beyond it doubles are too coarse to count the steps of a controller. */
static const double LONGEST_TIME = 1e9;

/* When a variable may be set, in words of the model description that the build uses in MODEL_VARIABLES. */
enum {
    NEVER = 0,
    AT_START = INSTANTIATED | INITIALIZATION, /* initial = exact, and not tunable */
    AS_GUESS = INSTANTIATED,                  /* initial = approx */
    TUNABLE = AT_START | EVENT | STEP,
    DISCRETE_INPUT = AT_START | EVENT | STEP,
    INPUT = AT_START | INITIALIZED,
    STATE = CONTINUOUS_TIME
};

/* What the model description declares at a value reference, none where `extent` is 0. */
typedef struct {
    const char *name;
    unsigned extent; /* number of elements */
    unsigned settable;
} Variable;

static const Variable VARIABLES[] = {MODEL_VARIABLES};
enum { REFERENCES = sizeof VARIABLES / sizeof *VARIABLES };

/* Value references of the continuous states and of their derivatives; an array must not be empty. */
static const unsigned STATE_REFERENCES[MODEL_STATES + 1] = {MODEL_STATE_REFERENCES};
static const unsigned DERIVATIVE_REFERENCES[MODEL_STATES + 1] = {MODEL_DERIVATIVE_REFERENCES};

static size_t memory_size(void) { return sizeof(Memory) + model_size; }

Component *component_new(const char *name)
{
    Component *component = calloc(1, sizeof(Component));
    if (!component) return NULL;
    component->name = malloc((name ? strlen(name) : 0) + 1);
    component->memory = malloc(memory_size());
    if (!component->name || !component->memory) {
        component_free(component);
        return NULL;
    }
    strcpy(component->name, name ? name : "");
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

void component_reset(Component *component)
{
    Memory *memory = component->memory;
    memset(memory, 0, memory_size());
    memory->tag = MODEL_TAG;
    memory->size = memory_size();
    memory->state = INSTANTIATED;
    memory->stale = true;
    memory->stop_time = INFINITY;
    model_start(memory->model);
}

/* ---- Refusals ---- */

bool component_refuse(Component *component, const char *message)
{
    snprintf(component->message, MODEL_MESSAGE_SIZE, "%s", message);
    return false;
}

bool component_refuse_number(Component *component, const char *format, double number)
{
    snprintf(component->message, MODEL_MESSAGE_SIZE, format, number);
    return false;
}

bool component_check_identity(Component *component, const char *guid, Kind kind)
{
    if (!guid || strcmp(guid, MODEL_GUID) != 0)
        return component_refuse(component,
                                "the GUID is not " MODEL_GUID ", with which this FMU was built: pass the one "
                                "in its own modelDescription.xml");
    if (kind == (MODEL_IS_MODEL_EXCHANGE ? MODEL_EXCHANGE : CO_SIMULATION)) return true;
    return component_refuse(component, MODEL_IS_MODEL_EXCHANGE
                                           ? "the model description of this FMU declares Model Exchange alone"
                                           : "the model description of this FMU declares co-simulation alone");
}

static const char *state_name(unsigned state)
{
    switch (state) {
    case INSTANTIATED:
        return "instantiated";
    case INITIALIZATION:
        return "initialization mode";
    case EVENT:
        return "event mode";
    case CONTINUOUS_TIME:
        return "continuous-time mode";
    case STEP:
        return "step mode";
    case TERMINATED:
        return "terminated";
    default:
        return "error";
    }
}

bool component_refuse_call(Component *component, const char *function)
{
    const unsigned state = component->memory->state;
    snprintf(component->message, MODEL_MESSAGE_SIZE, "%.100s is not allowed in the state \"%s\"%s", function,
             state_name(state), state == FAILED ? ": reset the instance, or set a state saved before" : "");
    return false;
}

/* ---- Variables ---- */

/* The variable at a reference, or NULL if none is declared there or there are fewer values left than it has. */
static const Variable *find(Component *component, unsigned reference, size_t n_values)
{
    const Variable *variable = reference < REFERENCES ? &VARIABLES[reference] : NULL;
    if (!variable || variable->extent == 0) {
        snprintf(component->message, MODEL_MESSAGE_SIZE,
                 "value reference %u unknown: the model description has no variable with it", reference);
        return NULL;
    }
    if (variable->extent <= n_values) return variable;
    snprintf(component->message, MODEL_MESSAGE_SIZE, "value reference %u (%.100s) has %u values, only %u were passed",
             reference, variable->name, variable->extent, (unsigned)n_values);
    return NULL;
}

/* The time is declared in FMI 3 only, as the variable after the last one of the model. */
static double *place(Component *component, unsigned reference)
{
    Memory *memory = component->memory;
    return reference == model_variables ? &memory->time : memory->model + reference;
}

static bool check_arrays(Component *component, const void *references, size_t n, const void *values, size_t n_values)
{
    if ((references || n == 0) && (values || n_values == 0)) return true;
    return component_refuse(component, "NULL was passed instead of an array");
}

static bool check_all_used(Component *component, size_t done, size_t n_values)
{
    if (done == n_values) return true;
    snprintf(component->message, MODEL_MESSAGE_SIZE, "%lu values were passed for variables that have %lu",
             (unsigned long)n_values, (unsigned long)done);
    return false;
}

/* Brings what can be read up to date. */
static void refresh(Component *component)
{
    Memory *memory = component->memory;
    /* Until initialization has ended, outputs follow the parameters; a bad one is reported at its end. */
    if (!memory->running && memory->stale) {
        memory->stale = false;
        model_initialize(memory->model, component->message);
    }
#if MODEL_EVALUATES
    model_evaluate(memory->model);
#endif
}

bool component_get(Component *component, const unsigned references[], size_t n, double values[], size_t n_values)
{
    if (!check_arrays(component, references, n, values, n_values)) return false;
    refresh(component);
    size_t done = 0;
    for (size_t i = 0; i < n; i++) {
        const Variable *variable = find(component, references[i], n_values - done);
        if (!variable) return false;
        const double *from = place(component, references[i]);
        values[done] = from[0];
        for (unsigned k = 1; k < variable->extent; k++)
            values[done + k] = from[k];
        done += variable->extent;
    }
    return check_all_used(component, done, n_values);
}

static bool check_settable(Component *component, const Variable *variable, unsigned reference, double value)
{
    const unsigned state = component->memory->state;
    if (variable->settable & state) return true;
    snprintf(component->message, MODEL_MESSAGE_SIZE,
             "%.100s = %.15g (value reference %u) refused: it cannot be set%s%s", variable->name, value, reference,
             variable->settable == NEVER ? "" : " in the state ", variable->settable == NEVER ? "" : state_name(state));
    return false;
}

static bool check_finite(Component *component, const Variable *variable, unsigned reference, const double values[])
{
    for (unsigned i = 0; i < variable->extent; i++) {
        if (isfinite(values[i])) continue;
        snprintf(component->message, MODEL_MESSAGE_SIZE,
                 "%.100s = %g (value reference %u, element %u) refused: it must "
                 "be finite",
                 variable->name, values[i], reference, i + 1);
        return false;
    }
    return true;
}

/* Whether a variable that the reference stands for may be set to the values that follow. */
static bool check_value(Component *component, unsigned reference, const double values[], size_t n_values)
{
    const Variable *variable = find(component, reference, n_values);
    return variable && check_settable(component, variable, reference, values[0]) &&
           check_finite(component, variable, reference, values);
}

bool component_set(Component *component, const unsigned references[], size_t n, const double values[], size_t n_values)
{
    if (!check_arrays(component, references, n, values, n_values)) return false;
    Memory *memory = component->memory;
    const unsigned state = memory->state;
    size_t done = 0;
    for (size_t i = 0; i < n; i++) {
        const unsigned reference = references[i];
        /* Nearly all are scalars that may be set: this is called in every step. */
        const Variable *variable = &VARIABLES[reference < REFERENCES ? reference : 0];
        const bool is_plain = reference < REFERENCES && variable->extent == 1 && variable->settable & state &&
                              done < n_values && isfinite(values[done]);
        if (!is_plain && !check_value(component, reference, values + done, n_values - done)) return false;
        done += variable->extent;
    }
    if (!check_all_used(component, done, n_values)) return false;
    done = 0;
    for (size_t i = 0; i < n; i++) {
        double *to = memory->model + references[i];
        const unsigned extent = VARIABLES[references[i]].extent;
        to[0] = values[done];
        for (unsigned k = 1; k < extent; k++)
            to[k] = values[done + k];
        done += extent;
    }
    memory->stale = true;
    return true;
}

/* ---- Time ---- */

static bool check_time(Component *component, double time)
{
    if (fabs(time) <= LONGEST_TIME) return true;
    return component_refuse_number(component, "time = %.15g s refused: it must be within 1e9 s", time);
}

bool component_set_times(Component *component, double start_time, double stop_time)
{
    Memory *memory = component->memory;
    if (!check_time(component, start_time)) return false;
    if (!(stop_time >= start_time)) {
        snprintf(component->message, MODEL_MESSAGE_SIZE,
                 "stop time = %.15g s refused: it must not be before the start time %.15g s", stop_time, start_time);
        return false;
    }
    memory->start_time = memory->time = memory->latest_event = start_time;
    memory->stop_time = stop_time;
    return true;
}

bool component_initialize(Component *component)
{
    Memory *memory = component->memory;
    memory->running = model_initialize(memory->model, component->message);
    if (memory->running) memory->state = MODEL_IS_MODEL_EXCHANGE ? EVENT : STEP;
    return memory->running;
}

/* How far a time may be from where it should be [s]. */
static double leeway(double t, double step) { return LEEWAY * step + ROUNDING * fabs(t); }

/* What holds for the steps of every model. */
static bool check_step(Component *component, double t, double h, double allowed)
{
    const Memory *memory = component->memory;
    char *message = component->message;
    if (!check_time(component, t)) return false;
    if (!(h >= 0.0 && h <= LONGEST_TIME)) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.15g s at t = %.15g s refused: it must not be negative and not be above 1e9 s", h, t);
        return false;
    }
    if (!(fabs(t - memory->time) <= allowed)) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.15g s at t = %.15g s refused: it must begin where the last one ended, at t = %.15g s", h, t,
                 memory->time);
        return false;
    }
    if (t + h > memory->stop_time + allowed) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.15g s at t = %.15g s refused: it ends behind the stop time %.15g s", h, t,
                 memory->stop_time);
        return false;
    }
    return true;
}

/* What a step is to a model that samples. */
typedef enum { REFUSED, LEFT_OVER, SAMPLE } StepKind;

/* A step is a sample if it begins at an instant of the grid start time + k * sample time and ends at the next; the last
 * step may end before. One that ends where it began is left over by an importer's arithmetic, and no sample. Whatever
 * else an importer does, it is told before samples get another distance than the sample time. */
static StepKind step_kind(Component *component, double t, double h, double T_s, double allowed)
{
    const Memory *memory = component->memory;
    const double due = component_next_event(component), end = t + h - due;
    if (!(fabs(t - due) <= allowed)) {
        snprintf(component->message, MODEL_MESSAGE_SIZE,
                 "step of %.15g s at t = %.15g s refused: the next sample is due at t = %.15g s, and only the last step "
                 "may be shorter than the sample time",
                 h, t, due);
        return REFUSED;
    }
    if (end <= allowed) return LEFT_OVER;
    /* Not all importers tell the stop time: without it, any step may be the last. */
    const bool may_be_last = isinf(memory->stop_time) || t + h >= memory->stop_time - allowed;
    if (fabs(end - T_s) <= allowed || (end < T_s && may_be_last)) return SAMPLE;
    snprintf(component->message, MODEL_MESSAGE_SIZE,
             "step of %.15g s at t = %.15g s refused: the communication step must equal the sample time T_s = %.15g s",
             h, t, T_s);
    return REFUSED;
}

/* Takes the sample that the step is, if it is one: the model knows the exact sample time only. */
static bool take_sample(Component *component, double t, double h, double T_s, double allowed)
{
    const StepKind kind = step_kind(component, t, h, T_s, allowed);
    if (kind != SAMPLE) return kind == LEFT_OVER;
    if (!model_step(component->memory->model, t, T_s, component->message)) return false;
    component->memory->samples += 1.0;
    return true;
}

bool component_step(Component *component, double t, double h)
{
    Memory *memory = component->memory;
    const double T_s = MODEL_HAS_VARIABLE_STEPS ? INFINITY : model_sample_time(memory->model);
    const bool samples = isfinite(T_s);
    const double allowed = leeway(t, samples ? T_s : h);
    if (!check_step(component, t, h, allowed)) return false;
    if (!(samples ? take_sample(component, t, h, T_s, allowed) : model_step(memory->model, t, h, component->message)))
        return false;
    memory->time = t + h;
    return true;
}

/* ---- Model Exchange ---- */

bool component_set_time(Component *component, double time)
{
    Memory *memory = component->memory;
    if (!check_time(component, time)) return false;
    const double h = model_sample_time(memory->model);
    if (time < memory->latest_event - EARLY * (isfinite(h) ? h : 1.0) - ROUNDING * fabs(time)) {
        snprintf(component->message, MODEL_MESSAGE_SIZE,
                 "time = %.15g s refused: it must not go back behind the last event at t = %.15g s", time,
                 memory->latest_event);
        return false;
    }
    memory->time = time;
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
    const double h = model_sample_time(memory->model), due = component_next_event(component);
    if (!isfinite(h) || memory->time < due - EARLY * h) return true;
    if (memory->time > due + (1.0 - EARLY) * h) {
        snprintf(component->message, MODEL_MESSAGE_SIZE,
                 "event at t = %.15g s refused: the one at t = %.15g s was left out", memory->time, due);
        return false;
    }
    if (!model_step(memory->model, memory->time, h, component->message)) return false;
    memory->samples += 1.0;
    return true;
}

static bool check_states(Component *component, const double values[], size_t n)
{
    if (n != MODEL_STATES) {
        snprintf(component->message, MODEL_MESSAGE_SIZE, "the FMU has %u continuous states, %lu were passed",
                 (unsigned)MODEL_STATES, (unsigned long)n);
        return false;
    }
    return check_arrays(component, component, n, values, n);
}

static bool read_states(Component *component, const unsigned references[], double values[], size_t n)
{
    if (!check_states(component, values, n)) return false;
    refresh(component);
    for (size_t i = 0; i < n; i++)
        values[i] = component->memory->model[references[i]];
    return true;
}

bool component_get_states(Component *component, double x[], size_t n)
{
    return read_states(component, STATE_REFERENCES, x, n);
}

bool component_get_derivatives(Component *component, double dx[], size_t n)
{
    return read_states(component, DERIVATIVE_REFERENCES, dx, n);
}

bool component_set_states(Component *component, const double x[], size_t n)
{
    if (!check_states(component, x, n)) return false;
    for (size_t i = 0; i < n; i++)
        if (!check_finite(component, &VARIABLES[STATE_REFERENCES[i]], STATE_REFERENCES[i], x + i)) return false;
    for (size_t i = 0; i < n; i++)
        component->memory->model[STATE_REFERENCES[i]] = x[i];
    return true;
}

bool component_get_nominals(Component *component, double x[], size_t n)
{
    if (!check_states(component, x, n)) return false;
    for (size_t i = 0; i < n; i++)
        x[i] = 1.0;
    return true;
}

/* ---- Saved states ---- */

/* FNV-1a (Fowler, Noll, Vo) of the bytes behind the checksum. */
static uint64_t checksum(const void *memory)
{
    uint64_t hash = 0xcbf29ce484222325;
    const unsigned char *bytes = memory;
    for (size_t i = offsetof(Memory, checksum) + sizeof hash; i < memory_size(); i++)
        hash = (hash ^ bytes[i]) * 0x100000001b3;
    return hash;
}

static bool check_state(Component *component, const void *state)
{
    const Memory *memory = state;
    if (!memory) return component_refuse(component, "NULL was passed instead of a state");
    if (memory->tag == MODEL_TAG && memory->size == memory_size()) return true;
    return component_refuse(component, "the state is not one of this FMU");
}

/* The memory of a state, allocated where there is none yet. */
static Memory *state_memory(Component *component, void **state)
{
    if (!state) return component_refuse(component, "NULL was passed instead of the address of a state"), NULL;
    if (*state && !check_state(component, *state)) return NULL;
    if (!*state) *state = malloc(memory_size());
    if (!*state) component_refuse(component, "no memory left for a state");
    return *state;
}

bool component_save(Component *component, void **state)
{
    Memory *saved = state_memory(component, state);
    if (saved) memcpy(saved, component->memory, memory_size());
    return saved;
}

bool component_restore(Component *component, const void *state)
{
    if (!check_state(component, state)) return false;
    memcpy(component->memory, state, memory_size());
    return true;
}

bool component_forget(Component *component, void **state)
{
    if (!state || !*state) return true; /* as the standards want it */
    if (!check_state(component, *state)) return false;
    ((Memory *)*state)->tag = 0;
    free(*state);
    *state = NULL;
    return true;
}

size_t component_serialized_size(void) { return memory_size(); }

static bool check_bytes(Component *component, const void *bytes, size_t size)
{
    if (!bytes) return component_refuse(component, "NULL was passed instead of the bytes of a state");
    if (size == memory_size()) return true;
    snprintf(component->message, MODEL_MESSAGE_SIZE, "%lu bytes were passed, a serialized state has %lu",
             (unsigned long)size, (unsigned long)memory_size());
    return false;
}

bool component_serialize(Component *component, const void *state, void *bytes, size_t size)
{
    if (!check_state(component, state) || !check_bytes(component, bytes, size)) return false;
    const uint64_t sum = checksum(state);
    memcpy(bytes, state, memory_size());
    memcpy((char *)bytes + offsetof(Memory, checksum), &sum, sizeof sum);
    return true;
}

bool component_deserialize(Component *component, const void *bytes, size_t size, void **state)
{
    if (!check_bytes(component, bytes, size)) return false;
    uint64_t head[3]; /* tag, size, checksum; `bytes` need not be aligned */
    memcpy(head, bytes, sizeof head);
    if (head[0] != MODEL_TAG || head[1] != memory_size() || head[2] != checksum(bytes))
        return component_refuse(component, "the bytes are not a serialized state of this FMU");
    Memory *saved = state_memory(component, state);
    if (!saved) return false;
    memcpy(saved, bytes, memory_size());
    saved->checksum = 0;
    return true;
}
