/* One instance of the model and its life, free of the types of any FMI version; fmi1.c, fmi2.c and fmi3.c only
 * translate between this and their standard. A function that returns false leaves the reason in `message`; some cannot
 * fail. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include "model.h"

/* All that a saved state consists of, one block of memory. */
typedef struct {
    double start_time; /* [s] */
    double time;       /* end of the last step, or the time the importer has set [s] */
    double samples;    /* events handled so far, a whole number */
    bool running;      /* initialization is over */
    double model[];    /* the model's struct; declared as double for its alignment */
} Memory;

/* A function of a type that only the glue knows. */
typedef void (*AnyFunction)(void);

typedef struct {
    char *name;
    AnyFunction logger; /* the importer's; may be NULL */
    void *environment;  /* the importer's, passed back with each message */
    bool logging;
    char message[MODEL_MESSAGE_SIZE];
    Memory *memory;
} Component;

/* NULL if there is no memory left. */
Component *component_new(const char *name);
void component_free(Component *component);

/* The FMU must be described by the model description it was built with. */
bool component_check_guid(Component *component, const char *guid);

/* Writes the message, returns false. */
bool component_refuse(Component *component, const char *message);

/* Back to the state after component_new. */
void component_reset(Component *component);

/* Variables by value reference; `values` holds n_values numbers, in FMI 3 the arrays one after the other. The
 * reference after the last variable is the time, read only. */
bool component_get(Component *component, const unsigned references[], size_t n, double values[], size_t n_values);
bool component_set(Component *component, const unsigned references[], size_t n, const double values[], size_t n_values);

/* Ends initialization; the time set before is the start time. */
bool component_initialize(Component *component);

/* One communication step of co-simulation from t to t + h [s]. */
bool component_step(Component *component, double t, double h);

/* Model Exchange: handles the event that is due at the present time, if one is, and only once. */
bool component_event(Component *component);

/* Time of the next event: start time + samples * sample time, never summed up; INFINITY if there is none [s]. */
double component_next_event(const Component *component);

/* Model Exchange: the continuous states and their derivatives, of which the description has MODEL_STATES; n must be
 * that number. */
bool component_get_states(Component *component, double x[], size_t n);
bool component_set_states(Component *component, const double x[], size_t n);
bool component_get_derivatives(Component *component, double dx[], size_t n);
void component_get_nominals(double x[], size_t n);

/* A state is saved to *state, which is allocated where it is NULL. */
bool component_save(Component *component, void **state);
void component_restore(Component *component, const void *state);
void component_forget(void **state);

/* A state as bytes; they are good for the same binary only. */
size_t component_serialized_size(void);
bool component_serialize(Component *component, const void *state, void *bytes, size_t size);
bool component_deserialize(Component *component, const void *bytes, size_t size, void **state);

#endif
