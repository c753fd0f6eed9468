/* The FMUs' models themselves, which compute where each arm begins. Compiled twice, as PLANT and as CONTROLLER, with names that
 * begin with that. */
#include <stdlib.h>
#include <string.h>

#define PASTE(a, b) a##_##b
#define NAMED(a, b) PASTE(a, b)
#define model_size NAMED(UNIT, size)
#define model_variables NAMED(UNIT, variables)
#define model_start NAMED(UNIT, start)
#define model_initialize NAMED(UNIT, initialize)
#define model_step NAMED(UNIT, step)
#define model_evaluate NAMED(UNIT, evaluate)
#define model_sample_time NAMED(UNIT, sample_time)

#ifdef OF_PLANT
#include "plant/model.c"
#else
#include "controller/design.c"
#include "controller/model.c"
#endif

double *NAMED(UNIT, new)(void)
{
    double *model = calloc(1, model_size);
    if (model) model_start(model);
    return model;
}

/* The last so many numbers of the model: what eight of them side by side have, too. */
const double *NAMED(UNIT, numbers)(const double *model, size_t count)
{
    return (const double *)((const char *)model + model_size) - count;
}
