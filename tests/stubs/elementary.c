/* The functions of elementary.h over arrays, for tests/test_elementary.py. */
#include <stddef.h>

#include "elementary.h"

#ifdef _WIN32
#define PUBLIC __declspec(dllexport)
#else
#define PUBLIC
#endif

#define OVER_ARRAYS(name)                                                      \
    PUBLIC void all_##name(size_t n, const double *x, const double *y, double *found) \
    {                                                                          \
        for (size_t i = 0; i < n; i++)                                         \
            found[i] = name(x[i], y[i]);                                       \
    }

static double first_sin(double x, double y) { return elementary_sin(x); }
static double first_cos(double x, double y) { return elementary_cos(x); }
static double first_exp(double x, double y) { return elementary_exp(x); }
static double first_log(double x, double y) { return elementary_log(x); }
static double first_tanh(double x, double y) { return elementary_tanh(x); }

OVER_ARRAYS(first_sin)
OVER_ARRAYS(first_cos)
OVER_ARRAYS(first_exp)
OVER_ARRAYS(first_log)
OVER_ARRAYS(first_tanh)
OVER_ARRAYS(elementary_hypot)
OVER_ARRAYS(elementary_pow)
