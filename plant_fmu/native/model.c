/* The flexible manipulator as a model for the FMI glue; its equations are in the headers beside it. */
#include "model.h"

#include <stdio.h>

#include "coefficients.h"
#include "equilibrium.h"
#include "identity.h" /* written by the build: MODEL_STATES */
#include "integrator.h"

/* The variables in the order of their value references. Speeds and derivatives are variables in Model Exchange only,
 * whose states are q_a, q_m and the speeds; in co-simulation they belong to what the model remembers. */
typedef struct {
    Variables of;
    double speeds[4]; /* of links and motors [rad/s] */
    double derivatives[STATES];

    Arm arm;
    Joint joints[2];
    double substep; /* [s] */
} Manipulator;

const size_t model_size = sizeof(Manipulator);
const size_t model_variables =
    (MODEL_STATES ? offsetof(Manipulator, arm) : sizeof(Variables)) / sizeof(double);

void model_start(void *model) { ((Manipulator *)model)->of = START; }

ASSERT_LAYOUT(variables_are_numbers_side_by_side,
              sizeof(Variables) % sizeof(double) == 0);
ASSERT_LAYOUT(variables_come_first,
              offsetof(Manipulator, speeds) == sizeof(Variables));

/* The parameters of Table 1 in their physical ranges, in the words of flexible_manipulator/parameters.py. */
static bool check_table_1(const Variables *of,
                          char message[MODEL_MESSAGE_SIZE]) {
  for (size_t i = 0; i < sizeof TABLE_1 / sizeof *TABLE_1; i++) {
    const Parameter *row = &TABLE_1[i];
    const double value = ((const double *)of)[row->reference];
    if (isfinite(value) && value >= 0.0 && !(row->positive && value == 0.0))
      continue;
    snprintf(
        message, MODEL_MESSAGE_SIZE,
        "%s = %g %s is outside its physical range: %s must be finite and %s",
        row->name, value, row->unit, row->description,
        row->positive ? "> 0" : ">= 0");
    return false;
  }
  return true;
}

/* The parameters must not need substeps so short that a step would take very
 * long. */
static bool check_substep(const Manipulator *plant,
                          char message[MODEL_MESSAGE_SIZE]) {
  if (plant->substep >= MIN_SUBSTEP)
    return true;
  const Variables *of = &plant->of;
  double fastest[2];
  rates(&plant->arm, plant->joints, fastest);
  const int i = fastest[1] > fastest[0] ? 1 : 0;
  snprintf(message, MODEL_MESSAGE_SIZE,
           "alpha[%d] = %g s/rad, f_c[%d] = %g N.m, f_d[%d] = %g N.m.s/rad, d[%d] = %g N.m.s/rad, "
           "j_m[%d] = %g kg.m2 refused: they need substeps of %g s, shorter than %g s",
           i + 1, of->alpha[i], i + 1, of->f_c[i], i + 1, of->f_d[i], i + 1, of->d[i], i + 1, of->j_m[i],
           plant->substep, MIN_SUBSTEP);
  return false;
}

static State state_of(const Manipulator *plant)
{
    const double *q_a = plant->of.q_a, *q_m = plant->of.q_m, *w = plant->speeds;
    return (State){{q_a[0], q_a[1], q_m[0], q_m[1], w[0], w[1], w[2], w[3]}};
}

static void drive(const Manipulator *plant, double tau[2])
{
    motor_torques(plant->joints, plant->of.u_m, plant->of.u_d, tau);
}

/* Finite, and angles within what sine and cosine are made for. NaN and infinity times 0 are both NaN. */
static bool is_finite(const State *x)
{
    double sum = 0.0;
    for (int i = 0; i < STATES; i++)
        sum += 0.0 * x->of[i];
    return sum == 0.0 && fabs(x->of[Q_A]) + fabs(x->of[Q_A + 1]) <= ELEMENTARY_ANGLE_MAX;
}

bool model_initialize(void *model, char message[MODEL_MESSAGE_SIZE])
{
    Manipulator *plant = model;
    Variables *of = &plant->of;
    if (!check_table_1(of, message))
      return false;
    plant->arm = arm_of(of);
    for (int i = 0; i < 2; i++)
        plant->joints[i] = joint_of(of, i);
    plant->substep = longest_substep(&plant->arm, plant->joints);
    if (!check_substep(plant, message))
      return false;
    solve_rest(&plant->arm, plant->joints, of->q_a_start, of->q_m_ref, of->u_m0);
    for (int i = 0; i < 2; i++) {
        of->q_a[i] = of->q_a_start[i];
        of->q_m[i] = of->q_m_ref[i];
        plant->speeds[i] = plant->speeds[2 + i] = 0.0;
    }
    tool_position(&plant->arm, of->q_a, of->X);
    const State x = state_of(plant);
    if (is_finite(&x) && isfinite(of->X[0]) && isfinite(of->X[1])) return true;
    snprintf(message, MODEL_MESSAGE_SIZE, "q_a_start = %.15g, %.15g rad refused: the arm has no state of rest there",
             of->q_a_start[0], of->q_a_start[1]);
    return false;
}

/* Apart from model_step, whose machine code they would slow down. */
static bool refuse_torques(const Manipulator *plant, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    const Variables *of = &plant->of;
    snprintf(message, MODEL_MESSAGE_SIZE,
             "step of %.15g s at t = %.15g s refused: the state does not stay finite with u_m = %g, %g N.m, "
             "u_d = %g, %g N.m and F = %g, %g N",
             h, t, of->u_m[0], of->u_m[1], of->u_d[0], of->u_d[1], of->F[0], of->F[1]);
    return false;
}

static bool refuse_step(double t, double h, double substeps, char message[MODEL_MESSAGE_SIZE])
{
    snprintf(message, MODEL_MESSAGE_SIZE,
             "step of %.15g s at t = %.15g s refused: it needs %.0f substeps, more than %.0f", h, t, substeps,
             MOST_SUBSTEPS);
    return false;
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    Manipulator *plant = model;
    Variables *of = &plant->of;
    const double substeps = substeps_in(h, plant->substep);
    if (!(substeps <= MOST_SUBSTEPS)) return refuse_step(t, h, substeps, message);
    double tau[2];
    drive(plant, tau);
    const State x = advance(&plant->arm, plant->joints, substeps,
                            state_of(plant), h, tau, of->F);
    if (!is_finite(&x)) return refuse_torques(plant, t, h, message);
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
