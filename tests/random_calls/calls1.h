/* Calls of FMI 1.0, co-simulation, with arguments that are legal or random. */

static void log_message(fmi1Component c, fmi1String name, fmi1Status status, fmi1String category, fmi1String message, ...)
{
    note_message(message);
}

static void *instance_of(const char *name, const char *guid, bool has_logger, bool logs)
{
    const fmi1CallbackFunctions host = {has_logger ? log_message : NULL, calloc, free, NULL};
    return NAME(fmiInstantiateSlave)(name, guid, NULL, NULL, 0.0, 0, 0, host, logs);
}

static void *new_instance(bool logs) { return instance_of("one", FMU_GUID, true, logs); }

static void free_instance(void *c) { NAME(fmiFreeSlaveInstance)(c); }

/* With wrong arguments there is no instance; one that comes all the same is freed. */
static int call_fmiInstantiateSlave(Instance *of)
{
    const bool same = of->legal || one_in(2);
    begin_call("fmiInstantiateSlave");
    void *c = instance_of(same ? "other" : NULL, same ? FMU_GUID : "{none}", one_in(2), one_in(2));
    end_call();
    if (c && !same) fail("instantiated with wrong arguments");
    free_instance(c);
    return STATUS_OK;
}

#define CALL_1(name, ...) \
    (begin_call(#name), messages_before = messages, judged((int)NAME(name)(__VA_ARGS__), of->logs))

static int call_fmiSetDebugLogging(Instance *of) { return CALL_1(fmiSetDebugLogging, self(of), of->logs); }
static int call_fmiInitializeSlave(Instance *of)
{
    const double start = of->legal ? 0.0 : any_number(), stop = any_number();
    return CALL_1(fmiInitializeSlave, self(of), start, !of->legal && one_in(2), stop);
}

#define PLAIN(name) \
    static int call_##name(Instance *of) { return CALL_1(name, self(of)); }
PLAIN(fmiTerminateSlave)
PLAIN(fmiResetSlave)
PLAIN(fmiCancelStep)

#define VALUES(name, operation, listed)                                       \
    static int operation(Instance *of)                                        \
    {                                                                         \
        const Values v = some_values(of, listed, sizeof listed / sizeof 0u);  \
        const int got = CALL_1(name, self(of), v.references, v.n, v.values);  \
        free_values(v);                                                       \
        return got;                                                           \
    }
VALUES(fmiGetReal, call_fmiGetReal, OUTPUTS)
VALUES(fmiSetReal, call_fmiSetReal, INPUTS)
VALUES(fmiSetReal, call_parameters, PARAMETERS)

/* Of these types there are no variables. */
#define OTHER_VALUES(name, type)                                                                             \
    static int call_##name(Instance *of)                                                                     \
    {                                                                                                        \
        type values[4] = {0};                                                                                \
        unsigned references[4] = {0, 1, 2, 3};                                                               \
        return CALL_1(name, self(of), result(of, references), of->legal ? 0 : below(4), result(of, values)); \
    }
OTHER_VALUES(fmiGetInteger, fmi1Integer)
OTHER_VALUES(fmiSetInteger, fmi1Integer)
OTHER_VALUES(fmiGetBoolean, fmi1Boolean)
OTHER_VALUES(fmiSetBoolean, fmi1Boolean)
OTHER_VALUES(fmiGetString, fmi1String)
OTHER_VALUES(fmiSetString, fmi1String)

static int call_fmiDoStep(Instance *of) { return CALL_1(fmiDoStep, self(of), some_time(of), some_step(of), 1); }
static int call_fmiSetRealInputDerivatives(Instance *of)
{
    const int order[1] = {1};
    const double values[1] = {0.0};
    return CALL_1(fmiSetRealInputDerivatives, self(of), INPUTS, !of->legal, order, values);
}
static int call_fmiGetRealOutputDerivatives(Instance *of)
{
    const int order[1] = {1};
    double values[1];
    return CALL_1(fmiGetRealOutputDerivatives, self(of), OUTPUTS, !of->legal, order, values);
}

#define STATUS(name, type, kind)                                                                           \
    static int call_##name(Instance *of)                                                                   \
    {                                                                                                      \
        type value = (type)0;                                                                              \
        return CALL_1(name, self(of), of->legal ? kind : (fmi1StatusKind)below(3), result(of, &value));    \
    }
STATUS(fmiGetStatus, fmi1Status, fmi1DoStepStatus)
STATUS(fmiGetRealStatus, fmi1Real, fmi1LastSuccessfulTime)
STATUS(fmiGetIntegerStatus, fmi1Integer, fmi1DoStepStatus)
STATUS(fmiGetBooleanStatus, fmi1Boolean, fmi1DoStepStatus)
STATUS(fmiGetStringStatus, fmi1String, fmi1PendingStatus)

#define N(name) {#name, call_##name}
static const Named OPERATIONS[] = {
    N(fmiSetDebugLogging), N(fmiInitializeSlave), N(fmiTerminateSlave), N(fmiResetSlave), N(fmiGetReal),
    N(fmiGetInteger), N(fmiGetBoolean), N(fmiGetString), N(fmiSetReal), N(fmiSetInteger), N(fmiSetBoolean),
    N(fmiSetString), N(fmiSetRealInputDerivatives), N(fmiGetRealOutputDerivatives), N(fmiDoStep), N(fmiCancelStep),
    N(fmiGetStatus), N(fmiGetRealStatus), N(fmiGetIntegerStatus), N(fmiGetBooleanStatus), N(fmiGetStringStatus),
    N(fmiInstantiateSlave),
};

/* What leads on from each state; FMI 1.0 has no saved states, no initialization mode and here no Model Exchange. */
static Operation *const SAVE = call_fmiGetReal, *const SERIALIZE = call_fmiGetReal, *const FORGET = call_fmiGetReal;
static Operation *const RESET = call_fmiResetSlave, *const RESTORE = call_fmiResetSlave, *const END = call_fmiTerminateSlave;
static Operation *const PARAMETERS_SET = call_parameters, *const INPUTS_SET = call_fmiSetReal, *const READ = call_fmiGetReal;
static Operation *const ENTER = call_fmiInitializeSlave, *const EXIT = call_fmiInitializeSlave;
static Operation *const STEP_ON = call_fmiDoStep;
static Operation *const EVENTS = call_fmiDoStep, *const UPDATE = call_fmiDoStep, *const CONTINUE = call_fmiDoStep;
static Operation *const TIME_SET = call_fmiDoStep;

/* ---- The reference trajectory ---- */

static int begin_simulation(void *c) { return NAME(fmiInitializeSlave)(c, 0.0, 0, 0.0); }
static int set_inputs(void *c, const double values[])
{
    return NAME(fmiSetReal)(c, INPUTS, sizeof INPUTS / sizeof 0u, values);
}
static int get_outputs(void *c, double values[])
{
    return NAME(fmiGetReal)(c, OUTPUTS, sizeof OUTPUTS / sizeof 0u, values);
}
static int step_on(void *c, double t) { return NAME(fmiDoStep)(c, t, STEP_SIZE, 1); }
static int update(void *c) { return STATUS_OK; }
static int move(void *c, double t, double x[], double dx[]) { return STATUS_OK; }
