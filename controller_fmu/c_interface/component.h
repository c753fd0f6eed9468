/* One instance of the model and its life, free of the types of any FMI version; fmi1.c, fmi2.c and fmi3.c only
 * translate between this and their standard. A function that returns false leaves the reason in `message`; some cannot
 * fail. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include <stdint.h>

#include "model.h"

/* The states of an instance in the standards' state machines, and sets of them. A standard has those it needs: FMI 1.0
 * has no initialization mode, co-simulation no event mode and no continuous-time mode, Model Exchange no step mode. */
enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    EVENT = 4,
    CONTINUOUS_TIME = 8,
    STEP = 16, /* FMI 1.0 and 2.0: step complete */
    TERMINATED = 32,
    FAILED = 64, /* after a call that was answered with an error */
    INITIALIZED = EVENT | CONTINUOUS_TIME | STEP,
    ANY_STATE = 127
};

/* What an FMU can be. */
typedef enum { CO_SIMULATION, MODEL_EXCHANGE, ANOTHER_KIND } Kind;

/* All that a saved state consists of, one block of memory. */
typedef struct {
    uint64_t tag, size, checksum; /* of the FMU; of the block [bytes]; of a serialized block, else 0 */
    uint32_t state;
    bool running;                 /* initialization is over */
    bool stale;                   /* before that: a variable was set since the outputs were computed */
    double start_time, stop_time; /* [s] */
    double time;                  /* end of the last step, or the time the importer has set [s] */
    double latest_event;          /* Model Exchange: time does not go back behind this [s] */
    double samples;               /* taken so far, a whole number; in Model Exchange one at each event */
    double model[];               /* the model's struct; declared as double for its alignment */
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

/* Write the message, and the number in it, to component->message; return false. */
bool component_refuse(Component *component, const char *message);
bool component_refuse_number(Component *component, const char *format, double number);

/* The FMU must be described by the model description it was built with, and be of the kind that is asked for. */
bool component_check_identity(Component *component, const char *guid, Kind kind);

/* Writes that the function is not allowed in the state the instance is in, returns false. */
bool component_refuse_call(Component *component, const char *function);

/* Back to the state after component_new. */
void component_reset(Component *component);

/* From the first state to initialization; the stop time is INFINITY where none is defined [s]. */
bool component_set_times(Component *component, double start_time, double stop_time);

/* Variables by value reference; `values` holds n_values numbers, in FMI 3 the arrays one after the other. A call that
 * fails has set nothing. */
bool component_get(Component *component, const unsigned references[], size_t n, double values[], size_t n_values);
bool component_set(Component *component, const unsigned references[], size_t n, const double values[], size_t n_values);

/* Ends initialization; the time set before is the start time. */
bool component_initialize(Component *component);

/* One communication step of co-simulation from t to t + h [s]. One that is as long as the sample time is a sample; the
 * last may be shorter, and one of next to nothing is none. */
bool component_step(Component *component, double t, double h);

/* Model Exchange: the time [s], which must not go back behind the last event. */
bool component_set_time(Component *component, double time);

/* Model Exchange: handles the event that is due at the present time, if one is, and only once. */
bool component_event(Component *component);

/* Time of the next sample, in Model Exchange an event: start time + samples * sample time, never summed up; INFINITY if
 * there is none [s]. */
double component_next_event(const Component *component);

/* Model Exchange: the continuous states and their derivatives, of which the description has MODEL_STATES; n must be
 * that number. */
bool component_get_states(Component *component, double x[], size_t n);
bool component_set_states(Component *component, const double x[], size_t n);
bool component_get_derivatives(Component *component, double dx[], size_t n);
bool component_get_nominals(Component *component, double x[], size_t n);

/* A state is saved to *state, which is allocated where it is NULL. A state of another FMU is refused. */
bool component_save(Component *component, void **state);
bool component_restore(Component *component, const void *state);
bool component_forget(Component *component, void **state);

/* A state as bytes; they are good for the same binary only, and refused where a byte has changed. */
size_t component_serialized_size(void);
bool component_serialize(Component *component, const void *state, void *bytes, size_t size);
bool component_deserialize(Component *component, const void *bytes, size_t size, void **state);

#endif
