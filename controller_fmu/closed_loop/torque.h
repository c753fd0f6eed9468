/* Follows the sources of the imperfections in their unit, where component.h is known. */
#include "closed_loop.h"

double driven(fmi2Component imperfections, int axis, double asked)
{
    return drive((const Loop *)((const Component *)imperfections)->memory->model, axis, asked);
}
