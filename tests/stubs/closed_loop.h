/* The functions of an FMI 2.0 slave that the closed loop calls; each FMU is compiled as a unit with names of its own. */
#ifndef CLOSED_LOOP_H
#define CLOSED_LOOP_H

#include "fmi2FunctionTypes.h"

typedef struct {
    const char *guid;
    fmi2InstantiateTYPE *instantiate;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *leave;
    fmi2SetRealTYPE *set;
    fmi2GetRealTYPE *get;
    fmi2DoStepTYPE *step;
    fmi2FreeInstanceTYPE *free;
} Slave;

/* In a unit, after its sources. */
#define SLAVE                                                                                                \
    {                                                                                                        \
        MODEL_GUID, fmi2Instantiate, fmi2SetupExperiment, fmi2EnterInitializationMode,                       \
            fmi2ExitInitializationMode, fmi2SetReal, fmi2GetReal, fmi2DoStep, fmi2FreeInstance               \
    }

#endif
