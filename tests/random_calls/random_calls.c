/* Random sequences of calls, legal and illegal, on one FMU that is compiled with sanitizers; see test_random_calls.py.
 *
 *     random_calls random SEED CALLS    no crash, no call beyond 1 s of processor time, an error has a message, and after
 *                                       each sequence a reset and a new instance give the reference trajectory
 *     random_calls table                the status of each function in each state, called with legal arguments
 *
 * It is one translation unit with the glue, whose functions FMI 1.0 declares in no header.
 */
#define _GNU_SOURCE

#include "fmu.h"

#include GLUE

#include "harness.h"

#include CALLS

enum { STEPS = 12, SEQUENCE = 400 };

/* ---- The reference trajectory ---- */

typedef struct {
    double of[STEPS][OUTPUT_SIZE];
} Trajectory;

static Trajectory simulated(void *c)
{
    Trajectory found;
    memset(&found, 0, sizeof found);
    double inputs[INPUT_SIZE], x[MODEL_STATES + 1], dx[MODEL_STATES + 1];
    int got = begin_simulation(c);
    for (int k = 0; k < STEPS; k++) {
        for (int i = 0; i < INPUT_SIZE; i++) /* whole numbers of 64ths without structure */
            inputs[i] = ((37 * k * (i + 1) + 11) % 129 - 64) / 640.0;
        got |= set_inputs(c, inputs);
        got |= MODEL_IS_MODEL_EXCHANGE ? update(c) | move(c, k * STEP_SIZE, x, dx) : step_on(c, k * STEP_SIZE);
        got |= get_outputs(c, found.of[k]);
    }
    function = "the reference trajectory";
    if (got != STATUS_OK) fail(((Component *)c)->message);
    return found;
}

static void check_trajectory(void *c, const Trajectory *reference, const char *what)
{
    const Trajectory found = simulated(c);
    if (memcmp(&found, reference, sizeof found) == 0) return;
    fprintf(stderr, "after random calls, %s gives another trajectory (call %lu)\n", what, calls);
    exit(1);
}

/* ---- Random calls ---- */

/* A call that leads on, so that random ones come upon every state. */
static Operation *leading_on(const Instance *of)
{
    switch (((Component *)of->c)->memory->state) {
    case INSTANTIATED: return one_in(3) ? PARAMETERS_SET : ENTER;
    case INITIALIZATION: return one_in(3) ? INPUTS_SET : EXIT;
    case EVENT: return one_in(3) ? INPUTS_SET : one_in(2) ? UPDATE : CONTINUE;
    case CONTINUOUS_TIME: return one_in(3) ? TIME_SET : one_in(2) ? READ : EVENTS;
    case STEP: return one_in(3) ? INPUTS_SET : one_in(3) ? READ : STEP_ON;
    default: return one_in(4) ? RESET : RESTORE;
    }
}

static void call_one(Instance *of)
{
    of->legal = one_in(2);
    if (one_in(10))
        (one_in(4) ? SERIALIZE : one_in(2) ? FORGET : SAVE)(of);
    else if (of->legal || one_in(2))
        leading_on(of)(of);
    else
        OPERATIONS[below(sizeof OPERATIONS / sizeof *OPERATIONS)].call(of);
}

static void forget_states(Instance *of)
{
    for (size_t i = 0; i < KEPT_STATES; i++)
        component_forget(of->c, &of->states[i]);
    free(of->bytes);
    of->bytes = NULL;
    of->size = 0;
}

static int random_sequences(unsigned long wanted)
{
    void *first = new_instance(true);
    if (!first) return 2;
    const Trajectory reference = simulated(first);
    free_instance(first);
    unsigned long sequences = 0;
    for (; calls < wanted; sequences++) {
        Instance of = {.logs = one_in(2)};
        of.c = new_instance(of.logs);
        const unsigned long end = calls + 1 + below(2 * SEQUENCE);
        while (calls < end)
            call_one(&of);
        of.legal = true;
        if (RESET(&of) != STATUS_OK) fail("an instance cannot be reset");
        check_trajectory(of.c, &reference, "a reset");
        forget_states(&of);
        free_instance(of.c);
        of.c = new_instance(true);
        check_trajectory(of.c, &reference, "a new instance");
        free_instance(of.c);
    }
    printf("%lu calls in %lu sequences, %lu errors, longest call %.6f s (%s)\n", calls, sequences, errors, longest,
           longest_function);
    return 0;
}

/* ---- The table ---- */

/* Leads a new instance to a state; false if it has no such state. */
static bool lead_to(Instance *of, unsigned state)
{
    of->c = new_instance(true);
    of->legal = true;
    SAVE(of);
    SERIALIZE(of);
    if (state == INSTANTIATED) return true;
    if (state == FAILED) return STEP_ON(of) == STATUS_ERROR; /* not allowed before initialization */
    if (FMI_VERSION > 1) ENTER(of);
    if (state == INITIALIZATION) return FMI_VERSION > 1;
    EXIT(of);
    if (state == EVENT || state == CONTINUOUS_TIME) {
        if (!MODEL_IS_MODEL_EXCHANGE) return false;
        if (state == CONTINUOUS_TIME) UPDATE(of), CONTINUE(of);
        return true;
    }
    if (state == STEP) return !MODEL_IS_MODEL_EXCHANGE;
    END(of);
    return true;
}

static int table(void)
{
    static const struct {
        unsigned state;
        const char *name;
    } STATES[] = {{INSTANTIATED, "instantiated"}, {INITIALIZATION, "initialization"}, {EVENT, "event"},
                  {CONTINUOUS_TIME, "continuous"}, {STEP, "step"}, {TERMINATED, "terminated"}, {FAILED, "error"}};
    for (size_t s = 0; s < sizeof STATES / sizeof *STATES; s++)
        for (size_t i = 0; i < sizeof OPERATIONS / sizeof *OPERATIONS; i++) {
            Instance of = {.logs = true};
            if (lead_to(&of, STATES[s].state)) {
                if (((Component *)of.c)->memory->state != STATES[s].state) fail("the state was not reached");
                printf("%s %s %d\n", OPERATIONS[i].name, STATES[s].name, OPERATIONS[i].call(&of));
            }
            forget_states(&of);
            free_instance(of.c);
        }
    return 0;
}

int main(int count, char *arguments[])
{
    signal(SIGPROF, too_long);
    if (count == 2 && strcmp(arguments[1], "table") == 0) return table();
    if (count != 4) return 2;
    seed = strtoull(arguments[2], NULL, 10);
    return random_sequences(strtoul(arguments[3], NULL, 10));
}
