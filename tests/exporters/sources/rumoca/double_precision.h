/* Goes before everything that rumoca emitted: its Reals are float, the benchmark's are double. */
#ifndef DOUBLE_PRECISION_H
#define DOUBLE_PRECISION_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define float double

#endif
