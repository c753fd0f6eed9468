/* The flexible manipulator as a model for the FMI glue; its equations are in the headers beside it. */
#include "model.h"

#include <stdio.h>

#include "equilibrium.h"
#include "identity.h" /* written by the build: MODEL_STATES */
#include "integrator.h"

/* The variables in the order of their value references. Speeds and derivatives are variables in Model Exchange only,
 * whose states are q_a, q_m and the speeds; in co-simulation they belong to what the model remembers. */
typedef struct {
    Variables of;
    double speeds[4]; /* of links and motors [rad/s] */
    double derivatives[STATES];

    double substep; /* [s] */
    Arm arm;
    Joint joints[2];
} Manipulator;

const size_t model_size = sizeof(Manipulator);
const size_t model_variables =
    (MODEL_STATES ? offsetof(Manipulator, substep) : sizeof(Variables)) / sizeof(double);

size_t model_extent(unsigned value_reference) { return 1; } /* described with scalars only */

void model_start(void *model) { ((Manipulator *)model)->of = START; }

/* The parameters of Table 1 in their physical ranges, in the words of flexible_manipulator/parameters.py. */
static bool check(const Variables *of, char message[MODEL_MESSAGE_SIZE])
{
    for (size_t i = 0; i < sizeof TABLE_1 / sizeof *TABLE_1; i++) {
        const Parameter *row = &TABLE_1[i];
        const double value = ((const double *)of)[row->reference];
        if (isfinite(value) && value >= 0.0 && !(row->positive && value == 0.0)) continue;
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "%s = %g %s is outside its physical range: %s must be finite and %s", row->name, value, row->unit,
                 row->description, row->positive ? "> 0" : ">= 0");
        return false;
    }
    return true;
}

static State state_of(const Manipulator *plant)
{
    const double *q_a = plant->of.q_a, *q_m = plant->of.q_m, *w = plant->speeds;
    return (State){{q_a[0], q_a[1], q_m[0], q_m[1], w[0], w[1], w[2], w[3]}};
}

/* The motors' torques gamma u_m + u_d. */
static void drive(const Manipulator *plant, double tau[2])
{
    for (int i = 0; i < 2; i++)
        tau[i] = plant->joints[i].gamma * plant->of.u_m[i] + plant->of.u_d[i];
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Manipulator *plant = model;
    Variables *of = &plant->of;
    if (!check(of, message)) return false;
    plant->arm = arm_of(of);
    for (int i = 0; i < 2; i++)
        plant->joints[i] = joint_of(of, i);
    plant->substep = longest_substep(plant->joints);
    solve_rest(&plant->arm, plant->joints, of->q_a_start, of->q_m_ref, of->u_m0);
    for (int i = 0; i < 2; i++) {
        of->q_a[i] = of->q_a_start[i];
        of->q_m[i] = of->q_m_ref[i];
        plant->speeds[i] = plant->speeds[2 + i] = 0.0;
    }
    tool_position(&plant->arm, of->q_a, of->X);
    return true;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Manipulator *plant = model;
    Variables *of = &plant->of;
    if (!(h >= 0.0 && isfinite(h))) {
        snprintf(message, MODEL_MESSAGE_SIZE,
                 "step of %.17g s at t = %.17g s refused: it must be finite and not negative", h, t);
        return false;
    }
    double tau[2];
    drive(plant, tau);
    const State x = advance(&plant->arm, plant->joints, plant->substep, state_of(plant), h, tau, of->F);
    for (int i = 0; i < 2; i++) {
        of->q_a[i] = x.of[Q_A + i];
        of->q_m[i] = x.of[Q_M + i];
        plant->speeds[i] = x.of[W_A + i];
        plant->speeds[2 + i] = x.of[W_M + i];
    }
    tool_position(&plant->arm, of->q_a, of->X);
    return true;
}

void model_evaluate(void *model)
{
    Manipulator *plant = model;
    double tau[2];
    drive(plant, tau);
    const State x = state_of(plant), dx = derivative(&plant->arm, plant->joints, &x, tau, plant->of.F);
    for (int i = 0; i < STATES; i++)
        plant->derivatives[i] = dx.of[i];
    tool_position(&plant->arm, plant->of.q_a, plant->of.X);
}

double model_sample_time(const void *model) { return INFINITY; }
