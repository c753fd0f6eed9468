/* Drives the native plant's FMU without any other software: drive_plant LIBRARY GUID STEPS, to be run on any platform.
 * Prints q_m, q_a, X after each step of 0.25 ms under inputs without structure, in hexadecimal. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"

#ifdef _WIN32
#include <windows.h>
#define FIND(library, name) ((name##TYPE *)(void *)GetProcAddress(library, #name))
#define OPEN(path) LoadLibraryA(path)
#else
#include <dlfcn.h>
#define FIND(library, name) ((name##TYPE *)dlsym(library, #name))
#define OPEN(path) dlopen(path, RTLD_NOW)
#define HMODULE void *
#endif

static void no_logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                      fmi2String message, ...)
{
}

int main(int count, char *arguments[])
{
    HMODULE library = count == 4 ? OPEN(arguments[1]) : NULL;
    if (!library) return 2;
    const fmi2CallbackFunctions host = {no_logger, calloc, free, NULL, NULL};
    fmi2Component plant =
        FIND(library, fmi2Instantiate)("plant", fmi2CoSimulation, arguments[2], "", &host, fmi2False, fmi2False);
    if (!plant) return 3;
    const double step = 0.25e-3, sizes[6] = {20.0, 10.0, 1.0, 1.0, 300.0, 300.0}, q_a_start[2] = {0.3, -0.9};
    const fmi2ValueReference inputs[6] = {0, 1, 2, 3, 4, 5}, outputs[6] = {6, 7, 8, 9, 10, 11}, pose[2] = {16, 17};
    int status = FIND(library, fmi2SetupExperiment)(plant, fmi2False, 0.0, 0.0, fmi2False, 0.0);
    status |= FIND(library, fmi2SetReal)(plant, pose, 2, q_a_start);
    status |= FIND(library, fmi2EnterInitializationMode)(plant);
    status |= FIND(library, fmi2ExitInitializationMode)(plant);
    for (int k = 0; k < atoi(arguments[3]) && status == fmi2OK; k++) {
        double values[6];
        for (int i = 0; i < 6; i++) /* a whole number of 64ths, the same on every platform */
            values[i] = sizes[i] * ((37 * k * (i + 1) + 11) % 129 - 64) / 64.0;
        status |= FIND(library, fmi2SetReal)(plant, inputs, 6, values);
        status |= FIND(library, fmi2DoStep)(plant, k * step, step, fmi2True);
        status |= FIND(library, fmi2GetReal)(plant, outputs, 6, values);
        for (int i = 0; i < 6; i++)
            printf("%a%c", values[i], i < 5 ? ' ' : '\n');
    }
    FIND(library, fmi2FreeInstance)(plant);
    return status;
}
