/* The closed loop of eight arms side by side: orchestrator/loop/closed_loop.py, whose words are used, with the sources of the
 * plant's FMU and of a controller's, and with the bits that each arm has alone. */
#include "number.h"

#define double Lane
#define bool Mask
#define uint64_t Bits
namespace lanes {
#include "elementary.h"
#include "plant/integrator.h"
#include "controller/feedback.h"
}
#undef double
#undef bool
#undef uint64_t

using namespace lanes;

enum { WHOLE, ENDED, REFUSED }; /* all samples are there; the arm left the workspace or a torque is no number; no start */

extern "C" {
double *plant_new(void);
double *controller_new(void);
bool plant_initialize(void *model, char message[256]);
bool controller_initialize(void *model, char message[256]);
const double *plant_numbers(const double *model, size_t count);
const double *controller_numbers(const double *model, size_t count);

/* Where in the values of an FMU the first of two stands; -1 where it has none. */
typedef struct {
    int64_t q_a, q_m, X, q_m_ref, u_m0;
} Places;

/* One simulation. The pointers are to what Loop, Plan and SampleArrays of closed_loop.py have, and `driven` is u_d and F at the
 * begin of each part, shape (samples, parts, 4); those of plant and controller are to all their variables. */
typedef struct {
    int64_t samples, rows, parts;
    const double *step;
    const int64_t *drive_lag, *sample_part, *sensor_lag;
    const double *noise, *driven;
    const uint8_t *dropped;
    double gain[2], limit[2], torque_quantum[2], angle_quantum, abort_distance;
    int64_t taken_at_0[2];
    const double *plant, *controller;
    double *outputs, *measured, *given, *command, *torque;
    double q_m_ref[2], u_m0[2];
    int64_t reason, ended;
} Simulation;

void simulate(Simulation all[], int count, const Places *of_plant, const Places *of_controller, size_t plant_values,
              size_t controller_values);
}

/* The plant's numbers, as they end its model. */
struct Body {
    Arm arm;
    Joint joints[2];
    Lane substep;
};

static double *plants[LANES], *controllers[LANES];
static Body body;
static Feedback feedback;

/* Puts the numbers of eight models side by side. */
static void join(void *joined, const double *const models[], const double *(*numbers)(const double *, size_t), size_t bytes)
{
    const size_t count = bytes / sizeof(Lane);
    for (int lane = 0; lane < LANES; lane++)
        for (size_t i = 0; i < count; i++)
            ((double *)joined)[i * LANES + lane] = numbers(models[lane], count)[i];
}

static bool begin(Simulation *of, int lane, const Places *plant, const Places *controller, size_t plant_values,
                  size_t controller_values)
{
    char message[256];
    if (!plants[lane]) plants[lane] = plant_new();
    if (!controllers[lane]) controllers[lane] = controller_new();
    double *arm = plants[lane], *law = controllers[lane];
    memcpy(arm, of->plant, plant_values * sizeof *arm);
    memcpy(law, of->controller, controller_values * sizeof *law);
    if (!plant_initialize(arm, message)) return false;
    for (int i = 0; i < 2; i++) {
        of->q_m_ref[i] = law[controller->q_m_ref + i] = arm[plant->q_m_ref + i];
        of->u_m0[i] = law[controller->u_m0 + i] = arm[plant->u_m0 + i];
        of->outputs[i] = arm[plant->q_m + i];
        of->outputs[2 + i] = arm[plant->X + i];
        of->measured[i] = of->taken_at_0[i] ? of->outputs[i] + of->noise[i] : of->q_m_ref[i];
    }
    return controller_initialize(law, message);
}

static Lane quantized(Lane value, Lane quantum) { return choose(quantum > 0.0, rint(value / quantum) * quantum, value); }

static Lane of_each(double (*function)(const Simulation *, int), const Simulation all[], int count, int axis)
{
    Lane made;
    for (int lane = 0; lane < LANES; lane++)
        made.of[lane] = function(&all[lane < count ? lane : 0], axis);
    return made;
}

void simulate(Simulation all[], int count, const Places *plant, const Places *controller, size_t plant_values,
              size_t controller_values)
{
    int64_t samples = 0, parts = 0;
    int whole = -1;
    for (int lane = 0; lane < count; lane++) {
        all[lane].ended = 0;
        all[lane].reason = begin(&all[lane], lane, plant, controller, plant_values, controller_values) ? WHOLE : REFUSED;
        if (all[lane].reason == REFUSED) continue;
        whole = lane;
        samples = all[lane].samples > samples ? all[lane].samples : samples;
        parts = all[lane].parts > parts ? all[lane].parts : parts;
    }
    if (whole < 0) return;
    const double *arms[LANES], *laws[LANES];
    for (int lane = 0; lane < LANES; lane++) {
        const int other = lane < count && all[lane].reason == WHOLE ? lane : whole;
        arms[lane] = plants[other];
        laws[lane] = controllers[other];
    }
    join(&body, arms, plant_numbers, sizeof body);
    join(&feedback, laws, controller_numbers, sizeof feedback);
    State x;
    Lane u_m0[2], gain[2], limit[2], torque_quantum[2];
    const Lane angle_quantum = of_each([](const Simulation *of, int) { return of->angle_quantum; }, all, count, 0);
    const Lane reach = of_each([](const Simulation *of, int) { return of->abort_distance * of->abort_distance; }, all, count, 0);
    for (int i = 0; i < 2; i++) {
        gain[i] = of_each([](const Simulation *of, int axis) { return of->gain[axis]; }, all, count, i);
        limit[i] = of_each([](const Simulation *of, int axis) { return of->limit[axis]; }, all, count, i);
        torque_quantum[i] = of_each([](const Simulation *of, int axis) { return of->torque_quantum[axis]; }, all, count, i);
        x.of[W_A + i] = x.of[W_M + i] = 0.0;
        for (int lane = 0; lane < LANES; lane++) {
            x.of[Q_A + i].of[lane] = arms[lane][plant->q_a + i];
            x.of[Q_M + i].of[lane] = arms[lane][plant->q_m + i];
            u_m0[i].of[lane] = arms[lane][plant->u_m0 + i];
        }
    }
    Lane X_0[2];
    tool_position(&body.arm, x.of + Q_A, X_0);

    for (int64_t k = 0; k < samples; k++) {
        int running[LANES], runs = 0;
        for (int lane = 0; lane < count; lane++)
            if (all[lane].reason == WHOLE && k < all[lane].samples) running[runs++] = lane;
        if (runs == 0) break;

        Lane y[2] = {x.of[Q_M], x.of[Q_M + 1]}, u[2], next[LAWS][LAW];
        for (int r = 0; r < runs; r++) {
            const Simulation *of = &all[running[r]];
            for (int i = 0; i < 2; i++) {
                const int64_t taken = k - of->sensor_lag[i];
                y[i].of[running[r]] = taken >= 0 ? of->measured[2 * taken + i] : of->q_m_ref[i];
            }
        }
        for (int i = 0; i < 2; i++)
            y[i] = quantized(y[i], angle_quantum);
        estimate(&feedback, y, next);
        const Lane in_all = asked_in_all(next, 0) + asked_in_all(next, 1);
        const Mask finite = in_all - in_all == 0.0;
        command(&feedback, next, u);

        Lane torque[2];
        for (int i = 0; i < 2; i++) {
            const Lane amplified = choose(gain[i] == 1.0, u[i], u_m0[i] + gain[i] * (u[i] - u_m0[i]));
            torque[i] = quantized(fmin(fmax(amplified, -limit[i]), limit[i]), torque_quantum[i]);
        }
        for (int r = 0; r < runs; r++) {
            const int lane = running[r];
            const Simulation *of = &all[lane];
            for (int i = 0; i < 2; i++) {
                of->given[2 * k + i] = y[i].of[lane];
                of->command[2 * k + i] = u[i].of[lane];
                const double held = k > 0 ? of->torque[2 * (k - 1) + i] : of->u_m0[i];
                of->torque[2 * k + i] = of->dropped[k] ? held : torque[i].of[lane];
            }
        }

        for (int64_t part = 0; part < parts; part++) {
            Lane step = 0.0, arrived[2] = {0.0, 0.0}, u_d[2] = {0.0, 0.0}, F[2] = {0.0, 0.0}, tau[2];
            for (int r = 0; r < runs; r++) {
                const int lane = running[r];
                const Simulation *of = &all[lane];
                if (part >= of->parts) continue; /* a step of nothing */
                const int64_t row = of->rows == 1 ? 0 : k % of->rows, at = row * of->parts + part;
                const double *driven = of->driven + 4 * (k * of->parts + part);
                step.of[lane] = of->step[at];
                for (int i = 0; i < 2; i++) {
                    const int64_t sent = k - of->drive_lag[2 * at + i];
                    arrived[i].of[lane] = sent >= 0 ? of->torque[2 * sent + i] : of->u_m0[i];
                    u_d[i].of[lane] = driven[i];
                    F[i].of[lane] = driven[2 + i];
                }
            }
            motor_torques(body.joints, arrived, u_d, tau);
            x = advance(&body.arm, body.joints, substeps_in(step, body.substep), x, step, tau, F);
            for (int r = 0; r < runs; r++) {
                const int lane = running[r];
                const Simulation *of = &all[lane];
                const int64_t row = of->rows == 1 ? 0 : k % of->rows;
                for (int i = 0; i < 2; i++)
                    if (of->sample_part[2 * row + i] == part)
                        of->measured[2 * (k + 1) + i] = x.of[Q_M + i].of[lane] + of->noise[2 * (k + 1) + i];
            }
        }

        Lane X[2];
        tool_position(&body.arm, x.of + Q_A, X);
        const Lane dx = X[0] - X_0[0], dz = X[1] - X_0[1];
        const Mask near = dx * dx + dz * dz <= reach;
        for (int r = 0; r < runs; r++) {
            const int lane = running[r];
            Simulation *of = &all[lane];
            double *row = of->outputs + 4 * (k + 1);
            for (int i = 0; i < 2; i++) {
                row[i] = x.of[Q_M + i].of[lane];
                row[2 + i] = X[i].of[lane];
            }
            of->ended = k + 1;
            if (!near.of[lane] || !finite.of[lane]) of->reason = ENDED;
        }
    }
}
