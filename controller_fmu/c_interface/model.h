/* What a model must provide, and all that the FMI glue knows of it.
 *
 * A model is a struct of plain data without pointers (so that copying it saves and restores it) which begins
 * with its variables: one double each, the value reference is the index. A model.c that defines the names
 * below becomes an FMU of any FMI version together with component.c and one of fmi1.c, fmi2.c, fmi3.c.
 *
 * Functions that can fail write the reason, what happened and how to mend it, to `message` and return false.
 * A message must not contain '%', because FMI loggers read it as a format.
 *
 * Before the glue calls one of them it has checked what holds for every model: the call is allowed in the state the
 * instance is in, a variable that is set is finite and may be set, a step begins where the last one ended.
 */
#ifndef MODEL_H
#define MODEL_H

#include <stdbool.h>
#include <stddef.h>

#define MODEL_MESSAGE_SIZE 256

/* Stops the compiler where a layout is not what the code that copies it takes for granted; C99 has no _Static_assert.
 */
#define ASSERT_LAYOUT(name, condition) typedef char name[(condition) ? 1 : -1]

/* Size of the model's struct in bytes. */
extern const size_t model_size;

/* How many variables it begins with. */
extern const size_t model_variables;

/* Sets the start values of the variables; the struct comes filled with zeros. */
void model_start(void *model);

/* Checks the parameters and computes outputs and states from them. It is called at the end of initialization,
 * and may be called any number of times before that when somebody reads outputs early. */
bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE]);

/* Computes the outputs of the step from time t to t + h [s] from the inputs; on false nothing has changed. Where the
 * description does not declare canHandleVariableCommunicationStepSize, h is the sample time. */
bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE]);

/* The sample time [s]: in Model Exchange the time between two events, at each of which model_step runs with this h.
 * INFINITY if there is none. */
double model_sample_time(const void *model);

/* Only where the description declares derivatives, in FMI 2.0 <Real derivative="...">, which makes continuous states
 * of the variables they belong to, or where it lists inputs that an output depends on directly and the model has this
 * function: computes derivatives and outputs from states and inputs. It is called whenever somebody reads variables. */
void model_evaluate(void *model);

#endif
