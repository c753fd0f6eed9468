/* The closed loop of plant, imperfections and a controller, made of the sources of their FMUs, each compiled as a unit
 * with names of its own (controller_fmu/export/one_program.py). */
#ifndef CLOSED_LOOP_H
#define CLOSED_LOOP_H

#include <stdbool.h>

#include "fmi2FunctionTypes.h"

/* What is exchanged, in pairs of variables; the names are those of the FMUs. */
typedef enum {
    SIGNAL_q_m,
    SIGNAL_X,
    SIGNAL_u_m,
    SIGNAL_u_d,
    SIGNAL_F,
    SIGNAL_q_m_ref,
    SIGNAL_u_m0,
    SIGNAL_q_a,
    SIGNAL_q_a_ref,
    SIGNAL_y,
    SIGNAL_u_c,
    SIGNALS
} Signal;

/* The value references of a signal; none where the FMU does not have it. */
typedef struct {
    size_t count;
    fmi2ValueReference of[2];
} References;

/* The functions of an FMI 2.0 slave that the loop calls. A controller of matrices reads them, in its unit, from where
 * `matrices` stands in the case, and returns where they end there. */
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
    References signals[SIGNALS];
    const double *(*matrices)(const double *matrices, double sample_time);
} Slave;

/* In a unit, after its sources. */
#define FUNCTIONS                                                                                               \
    MODEL_GUID, fmi2Instantiate, fmi2SetupExperiment, fmi2EnterInitializationMode, fmi2ExitInitializationMode, \
        fmi2SetReal, fmi2GetReal, fmi2DoStep, fmi2FreeInstance

/* The torque of the drive for the one that is asked for: amplified, limited, quantized, before its delay [N.m]. In the
 * unit of the imperfections, whose functions it calls. */
double driven(fmi2Component imperfections, int axis, double asked);

/* Why a loop ended. */
typedef enum { FINISHED, DIVERGED, ABSURD_TORQUE, PLANT_FAILED, CONTROLLER_FAILED, NOT_STARTED } Reason;

/* The samples: row k of a state belongs to time k T_s, with one more row than of torques. */
typedef struct {
    double (*q_m)[2], (*X)[2];     /* motor angles [rad], position of the tool [m] */
    double (*q_a)[2];              /* link angles [rad] */
    double (*u_d)[2];              /* torque disturbance [N.m] */
    double (*command)[2];          /* torques as the controller asks for them [N.m] */
    double (*torque)[2];           /* torques as they leave for the drive [N.m] */
    double q_m_ref[2], u_m0[2];    /* of the initial steady state [rad, N.m] */
    Reason reason;
    long sample;                   /* at which it ended */
    char message[512];             /* of an FMU that refuses */
} Record;

/* The values of the three FMUs in a case: for each its number, how many values are set, and these, each with its value
 * reference before it; then the matrices of a controller that has some. Begins a loop that can be as long as `samples`;
 * false if an FMU refuses or memory is short, with the reason in the record. */
bool loop_begin(const double *parts, long samples, double sample_time, long ticks, double abort_distance);

/* Simulates from where it ended until so many samples. */
void loop_run(long samples);

void loop_end(void);

/* Of the loop that was begun last. */
extern Record record;

#endif
