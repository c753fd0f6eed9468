/* Calls of FMI 2.0 with arguments that are legal or random. */

static void log_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    note_message(message);
}

static const fmi2CallbackFunctions HOST = {log_message, calloc, free, NULL, NULL};
static const fmi2CallbackFunctions SILENT_HOST = {NULL, calloc, free, NULL, NULL};

static void *new_instance(bool logs)
{
    const fmi2Type type = MODEL_IS_MODEL_EXCHANGE ? fmi2ModelExchange : fmi2CoSimulation;
    return fmi2Instantiate("one", type, FMU_GUID, "", &HOST, fmi2False, logs);
}

static void free_instance(void *c) { fmi2FreeInstance(c); }

/* With wrong arguments there is no instance; one that comes all the same is freed. */
static int call_fmi2Instantiate(Instance *of)
{
    const fmi2Type type = MODEL_IS_MODEL_EXCHANGE ? fmi2ModelExchange : fmi2CoSimulation;
    const bool same = of->legal || one_in(2);
    begin_call("fmi2Instantiate");
    void *c = fmi2Instantiate(same ? "other" : NULL, same ? type : (fmi2Type)(1 - (int)type), same ? FMU_GUID : "{none}", NULL,
                              one_in(3) ? NULL : one_in(2) ? &HOST : &SILENT_HOST, fmi2False, one_in(2));
    end_call();
    if (c && !same) fail("instantiated with wrong arguments");
    fmi2FreeInstance(c);
    return STATUS_OK;
}

static int call_fmi2SetDebugLogging(Instance *of)
{
    return CALL(fmi2SetDebugLogging, self(of), of->logs, 0, NULL);
}
static int call_fmi2SetupExperiment(Instance *of)
{
    const double start = of->legal ? 0.0 : any_number(), stop = any_number();
    return CALL(fmi2SetupExperiment, self(of), fmi2False, any_number(), start, !of->legal && one_in(2), stop);
}

#define PLAIN(name) \
    static int call_##name(Instance *of) { return CALL(name, self(of)); }
PLAIN(fmi2EnterInitializationMode)
PLAIN(fmi2ExitInitializationMode)
PLAIN(fmi2Terminate)
PLAIN(fmi2Reset)
PLAIN(fmi2CancelStep)
PLAIN(fmi2EnterEventMode)
PLAIN(fmi2EnterContinuousTimeMode)

#define VALUES(name, listed)                                                  \
    static int call_##name(Instance *of)                                      \
    {                                                                         \
        const Values v = some_values(of, listed, sizeof listed / sizeof 0u);  \
        const int got = CALL(name, self(of), v.references, v.n, v.values);    \
        free_values(v);                                                       \
        return got;                                                           \
    }
VALUES(fmi2GetReal, OUTPUTS)
VALUES(fmi2SetReal, INPUTS)

/* A parameter, which may be set before the simulation. */
static int call_parameters(Instance *of)
{
    const Values v = some_values(of, PARAMETERS, sizeof PARAMETERS / sizeof 0u);
    const int got = CALL(fmi2SetReal, self(of), v.references, v.n, v.values);
    free_values(v);
    return got;
}

/* Of these types there are no variables. */
#define OTHER_VALUES(name, type)                                                                      \
    static int call_##name(Instance *of)                                                              \
    {                                                                                                 \
        type values[4] = {0};                                                                         \
        unsigned references[4] = {0, 1, 2, 3};                                                        \
        return CALL(name, self(of), result(of, references), of->legal ? 0 : below(4), result(of, values)); \
    }
OTHER_VALUES(fmi2GetInteger, fmi2Integer)
OTHER_VALUES(fmi2SetInteger, fmi2Integer)
OTHER_VALUES(fmi2GetBoolean, fmi2Boolean)
OTHER_VALUES(fmi2SetBoolean, fmi2Boolean)
OTHER_VALUES(fmi2GetString, fmi2String)
OTHER_VALUES(fmi2SetString, fmi2String)

static int call_fmi2GetDirectionalDerivative(Instance *of)
{
    double values[1] = {0.0};
    return CALL(fmi2GetDirectionalDerivative, self(of), OUTPUTS, 1, INPUTS, 1, values, values);
}

static int call_fmi2GetFMUstate(Instance *of)
{
    void *none = foreign;
    if (!of->legal && one_in(10)) return CALL(fmi2GetFMUstate, self(of), one_in(2) ? NULL : &none);
    return CALL(fmi2GetFMUstate, self(of), some_state(of));
}
static int call_fmi2SetFMUstate(Instance *of) { return CALL(fmi2SetFMUstate, self(of), some_saved(of)); }
static int call_fmi2FreeFMUstate(Instance *of)
{
    void *none = foreign;
    if (!of->legal && one_in(10)) return CALL(fmi2FreeFMUstate, self(of), one_in(2) ? NULL : &none);
    return CALL(fmi2FreeFMUstate, self(of), some_state(of));
}
static int call_fmi2SerializedFMUstateSize(Instance *of)
{
    size_t size = 0;
    return CALL(fmi2SerializedFMUstateSize, self(of), some_saved(of), result(of, &size));
}
static int call_fmi2SerializeFMUstate(Instance *of)
{
    size_t size = component_serialized_size();
    if (!of->legal && one_in(4)) size = below(2 * size);
    unsigned char *bytes = block(size);
    const int got = CALL(fmi2SerializeFMUstate, self(of), some_saved(of), result(of, bytes), size);
    if (got == STATUS_OK) keep_bytes(of, bytes, size);
    else free(bytes);
    return got;
}
static int call_fmi2DeSerializeFMUstate(Instance *of)
{
    size_t size;
    unsigned char *bytes = some_bytes(of, &size);
    const int got = CALL(fmi2DeSerializeFMUstate, self(of), result(of, bytes), size, result(of, some_state(of)));
    free(bytes);
    return got;
}

/* ---- Co-simulation ---- */

static int call_fmi2DoStep(Instance *of)
{
    return CALL(fmi2DoStep, self(of), some_time(of), some_step(of), fmi2True);
}
static int call_fmi2SetRealInputDerivatives(Instance *of)
{
    const int order[1] = {1};
    const double values[1] = {0.0};
    return CALL(fmi2SetRealInputDerivatives, self(of), INPUTS, !of->legal, order, values);
}
static int call_fmi2GetRealOutputDerivatives(Instance *of)
{
    const int order[1] = {1};
    double values[1];
    return CALL(fmi2GetRealOutputDerivatives, self(of), OUTPUTS, !of->legal, order, values);
}

#define STATUS(name, type, kind)                                                                          \
    static int call_##name(Instance *of)                                                                  \
    {                                                                                                     \
        type value = (type)0;                                                                             \
        return CALL(name, self(of), of->legal ? kind : (fmi2StatusKind)below(4), result(of, &value));     \
    }
STATUS(fmi2GetStatus, fmi2Status, fmi2DoStepStatus)
STATUS(fmi2GetRealStatus, fmi2Real, fmi2LastSuccessfulTime)
STATUS(fmi2GetIntegerStatus, fmi2Integer, fmi2DoStepStatus)
STATUS(fmi2GetBooleanStatus, fmi2Boolean, fmi2Terminated)
STATUS(fmi2GetStringStatus, fmi2String, fmi2PendingStatus)

/* ---- Model Exchange ---- */

static int call_fmi2SetTime(Instance *of) { return CALL(fmi2SetTime, self(of), some_time(of) + (of->legal ? STEP_SIZE : 0.0)); }

#define STATES_CALL(name, right)                                        \
    static int call_##name(Instance *of)                                \
    {                                                                   \
        const size_t n = of->legal ? (right) : below((right) + 3);      \
        double *values = block(n * sizeof(double));                     \
        for (size_t i = 0; i < n; i++)                                  \
            values[i] = of->legal ? 0.0 : any_number();                 \
        const int got = CALL(name, self(of), result(of, values), n);    \
        free(values);                                                   \
        return got;                                                     \
    }
STATES_CALL(fmi2SetContinuousStates, MODEL_STATES)
STATES_CALL(fmi2GetContinuousStates, MODEL_STATES)
STATES_CALL(fmi2GetDerivatives, MODEL_STATES)
STATES_CALL(fmi2GetNominalsOfContinuousStates, MODEL_STATES)
STATES_CALL(fmi2GetEventIndicators, 0)

static int call_fmi2NewDiscreteStates(Instance *of)
{
    fmi2EventInfo info;
    return CALL(fmi2NewDiscreteStates, self(of), result(of, &info));
}
static int call_fmi2CompletedIntegratorStep(Instance *of)
{
    fmi2Boolean wanted, ended;
    return CALL(fmi2CompletedIntegratorStep, self(of), fmi2True, result(of, &wanted), result(of, &ended));
}

#define N(name) {#name, call_##name}
static const Named OPERATIONS[] = {
    N(fmi2SetDebugLogging), N(fmi2SetupExperiment), N(fmi2EnterInitializationMode), N(fmi2ExitInitializationMode),
    N(fmi2Terminate), N(fmi2Reset), N(fmi2GetReal), N(fmi2GetInteger), N(fmi2GetBoolean), N(fmi2GetString),
    N(fmi2SetReal), N(fmi2SetInteger), N(fmi2SetBoolean), N(fmi2SetString), N(fmi2GetFMUstate), N(fmi2SetFMUstate),
    N(fmi2FreeFMUstate), N(fmi2SerializedFMUstateSize), N(fmi2SerializeFMUstate), N(fmi2DeSerializeFMUstate),
    N(fmi2GetDirectionalDerivative), N(fmi2SetRealInputDerivatives), N(fmi2GetRealOutputDerivatives), N(fmi2DoStep),
    N(fmi2CancelStep), N(fmi2GetStatus), N(fmi2GetRealStatus), N(fmi2GetIntegerStatus), N(fmi2GetBooleanStatus),
    N(fmi2GetStringStatus), N(fmi2EnterEventMode), N(fmi2NewDiscreteStates), N(fmi2EnterContinuousTimeMode),
    N(fmi2CompletedIntegratorStep), N(fmi2SetTime), N(fmi2SetContinuousStates), N(fmi2GetEventIndicators),
    N(fmi2GetContinuousStates), N(fmi2GetDerivatives), N(fmi2GetNominalsOfContinuousStates), N(fmi2Instantiate),
};

/* What leads on from each state. */
static Operation *const SAVE = call_fmi2GetFMUstate, *const SERIALIZE = call_fmi2SerializeFMUstate;
static Operation *const RESTORE = call_fmi2SetFMUstate, *const FORGET = call_fmi2FreeFMUstate, *const RESET = call_fmi2Reset;
static Operation *const PARAMETERS_SET = call_parameters, *const INPUTS_SET = call_fmi2SetReal, *const READ = call_fmi2GetReal;
static Operation *const ENTER = call_fmi2EnterInitializationMode, *const EXIT = call_fmi2ExitInitializationMode;
static Operation *const STEP_ON = call_fmi2DoStep, *const EVENTS = call_fmi2EnterEventMode, *const UPDATE = call_fmi2NewDiscreteStates;
static Operation *const CONTINUE = call_fmi2EnterContinuousTimeMode, *const TIME_SET = call_fmi2SetTime;
static Operation *const END = call_fmi2Terminate;

/* ---- The reference trajectory ---- */

static int begin_simulation(void *c)
{
    return fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) | fmi2EnterInitializationMode(c) |
           fmi2ExitInitializationMode(c);
}
static int set_inputs(void *c, const double values[]) { return fmi2SetReal(c, INPUTS, sizeof INPUTS / sizeof 0u, values); }
static int get_outputs(void *c, double values[]) { return fmi2GetReal(c, OUTPUTS, sizeof OUTPUTS / sizeof 0u, values); }
static int step_on(void *c, double t) { return fmi2DoStep(c, t, STEP_SIZE, fmi2True); }
static int update(void *c)
{
    fmi2EventInfo info;
    return fmi2NewDiscreteStates(c, &info) | fmi2EnterContinuousTimeMode(c);
}
static int move(void *c, double t, double x[], double dx[])
{
    int got = fmi2GetContinuousStates(c, x, MODEL_STATES) | fmi2GetDerivatives(c, dx, MODEL_STATES);
    for (int i = 0; i < MODEL_STATES; i++)
        x[i] += STEP_SIZE * dx[i];
    return got | fmi2SetTime(c, t + STEP_SIZE) | fmi2SetContinuousStates(c, x, MODEL_STATES) | fmi2EnterEventMode(c);
}
