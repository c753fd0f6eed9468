/* The block that rumoca emitted for FlexibleManipulator.DiagonalPID as a model for the FMI glue. */
#include "model.h"

#include "FlexibleManipulator_DiagonalPID.h"

/* The emitted struct begins with the block's inputs, outputs and parameters, as a model's struct must. */
typedef DiagonalPIDState Block;

enum { AXES = 2 };

const size_t model_size = sizeof(Block);
const size_t model_variables = offsetof(Block, T_s) / sizeof(double);

void model_start(void *model)
{
    Block *block = model;
    DiagonalPID_startup(block);
    /* The emitted start values are float literals: give those that have no exact float their double values. */
    block->T_s = 0.25e-3;
    block->z_p[0] = block->z_p[1] = 0.95;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Block *block = model;
    DiagonalPID_recalibrate(block);
    /* In Modelica s starts from the parameter u_m0; the emitted startup has fixed its default value. */
    for (int i = 0; i < AXES; i++)
        block->u_m[i] = block->s[i] = block->previous_s[i] = block->u_m0[i];
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    DiagonalPID_dostep(model);
    return true;
}

double model_sample_time(const void *model) { return ((const Block *)model)->T_s; }
