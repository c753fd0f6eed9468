/* What a model must provide, and all that the FMI glue knows of it.
 *
 * A model is a struct of plain data without pointers (so that copying it saves and restores it) which begins
 * with its variables: one double each, the value reference is the index. A model.c that defines the names
 * below becomes an FMU of any FMI version together with component.c and one of fmi1.c, fmi2.c, fmi3.c.
 *
 * Functions that can fail write the reason, what happened and how to mend it, to `message` and return false.
 * A message must not contain '%', because FMI loggers read it as a format.
 */
#ifndef MODEL_H
#define MODEL_H

#include <stdbool.h>
#include <stddef.h>

#define MODEL_MESSAGE_SIZE 256

/* Size of the model's struct in bytes. */
extern const size_t model_size;

/* How many variables it begins with. */
extern const size_t model_variables;

/* How many variables the FMI 3 array that begins with this value reference spans. Where the FMU is described
 * with scalars only, as always in FMI 1 and 2, nobody asks. */
size_t model_extent(unsigned value_reference);

/* Sets the start values of the variables; the struct comes filled with zeros. */
void model_start(void *model);

/* Checks the parameters and computes outputs and states from them. It is called at the end of initialization,
 * and may be called any number of times before that when somebody reads outputs early. */
bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE]);

/* Computes the outputs of the step from time t to t + h [s] from the inputs; on false nothing has changed. */
bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE]);

/* The time between two events in Model Exchange [s]: at each, model_step runs with this h. INFINITY if there are no
 * events. */
double model_sample_time(const void *model);

/* Only where the description declares derivatives, in FMI 2.0 <Real derivative="...">, which makes continuous states
 * of the variables they belong to, or where it lists inputs that an output depends on directly and the model has this
 * function: computes derivatives and outputs from states and inputs. It is called whenever somebody reads variables. */
void model_evaluate(void *model);

#endif
