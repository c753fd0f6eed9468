/* Calls of FMI 3.0 with arguments that are legal or random. */

static void log_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    note_message(message);
}

static void *instance_of(bool model_exchange, const char *name, const char *token, fmi3LogMessageCallback logger,
                         bool logs, bool events)
{
    if (model_exchange) return fmi3InstantiateModelExchange(name, token, NULL, false, logs, NULL, logger);
    return fmi3InstantiateCoSimulation(name, token, NULL, false, logs, events, false, NULL, 0, NULL, logger, NULL);
}

static void *new_instance(bool logs)
{
    return instance_of(MODEL_IS_MODEL_EXCHANGE, "one", FMU_GUID, log_message, logs, false);
}

static void free_instance(void *c) { fmi3FreeInstance(c); }

/* With wrong arguments there is no instance; one that comes all the same is freed. */
static int call_instantiate(Instance *of)
{
    const bool same = of->legal || one_in(2), no_token = one_in(2);
    begin_call("fmi3Instantiate");
    void *c = instance_of(same == (bool)MODEL_IS_MODEL_EXCHANGE, same ? "other" : NULL, same || no_token ? FMU_GUID : "{none}",
                          one_in(3) ? NULL : log_message, one_in(2), !same);
    void *scheduled = fmi3InstantiateScheduledExecution("other", FMU_GUID, NULL, false, true, NULL, log_message, NULL, NULL, NULL);
    end_call();
    if ((c && !same) || scheduled) fail("instantiated with wrong arguments");
    fmi3FreeInstance(c);
    return STATUS_OK;
}

static int call_fmi3SetDebugLogging(Instance *of)
{
    return CALL(fmi3SetDebugLogging, self(of), of->logs, 0, NULL);
}
static int call_fmi3EnterInitializationMode(Instance *of)
{
    const double start = of->legal ? 0.0 : any_number(), stop = any_number();
    return CALL(fmi3EnterInitializationMode, self(of), false, any_number(), start, !of->legal && one_in(2), stop);
}

#define PLAIN(name) \
    static int call_##name(Instance *of) { return CALL(name, self(of)); }
PLAIN(fmi3ExitInitializationMode)
PLAIN(fmi3Terminate)
PLAIN(fmi3Reset)
PLAIN(fmi3EnterStepMode)
PLAIN(fmi3EnterConfigurationMode)
PLAIN(fmi3ExitConfigurationMode)
PLAIN(fmi3EvaluateDiscreteStates)
PLAIN(fmi3EnterEventMode)
PLAIN(fmi3EnterContinuousTimeMode)

#if MODEL_FLOAT_BITS == 64
#define GET_FLOAT fmi3GetFloat64
#define SET_FLOAT fmi3SetFloat64
typedef double Number;
#else
#define GET_FLOAT fmi3GetFloat32
#define SET_FLOAT fmi3SetFloat32
typedef float Number;
#endif

static Number *narrowed(Values v)
{
    Number *values = block(v.n_values * sizeof(Number));
    for (size_t i = 0; i < v.n_values; i++)
        values[i] = (Number)((double *)v.freed[1])[i];
    return values;
}

#define VALUES(function, operation, listed)                                                                            \
    static int operation(Instance *of)                                                                                 \
    {                                                                                                                  \
        const Values v = some_values(of, listed, sizeof listed / sizeof 0u);                                           \
        Number *values = narrowed(v);                                                                                  \
        const int got = CALL(function, self(of), v.references, v.n, v.values ? values : NULL, v.n_values);             \
        free(values);                                                                                                  \
        free_values(v);                                                                                                \
        return got;                                                                                                    \
    }
VALUES(GET_FLOAT, call_get, OUTPUTS)
VALUES(SET_FLOAT, call_set, INPUTS)
VALUES(SET_FLOAT, call_parameters, PARAMETERS)

/* Of these types there are no variables. */
#define OTHER_VALUES(name, type)                                                                                    \
    static int call_##name(Instance *of)                                                                            \
    {                                                                                                               \
        type values[4] = {0};                                                                                       \
        unsigned references[4] = {0, 1, 2, 3};                                                                      \
        const size_t n = of->legal ? 0 : below(4);                                                                  \
        return CALL(name, self(of), result(of, references), n, result(of, values), n);                              \
    }
OTHER_VALUES(fmi3GetInt32, fmi3Int32)
OTHER_VALUES(fmi3SetInt32, fmi3Int32)
OTHER_VALUES(fmi3GetUInt64, fmi3UInt64)
OTHER_VALUES(fmi3SetUInt64, fmi3UInt64)
OTHER_VALUES(fmi3GetBoolean, fmi3Boolean)
OTHER_VALUES(fmi3SetBoolean, fmi3Boolean)
OTHER_VALUES(fmi3GetString, fmi3String)
OTHER_VALUES(fmi3SetString, fmi3String)

static int call_fmi3GetClock(Instance *of)
{
    fmi3Clock values[4] = {0};
    return CALL(fmi3GetClock, self(of), INPUTS, of->legal ? 0 : 1, result(of, values));
}
static int call_fmi3SetClock(Instance *of)
{
    fmi3Clock values[4] = {0};
    return CALL(fmi3SetClock, self(of), INPUTS, of->legal ? 0 : 1, result(of, values));
}
static int call_fmi3GetNumberOfVariableDependencies(Instance *of)
{
    size_t n;
    return CALL(fmi3GetNumberOfVariableDependencies, self(of), 0, result(of, &n));
}

static int call_fmi3GetDirectionalDerivative(Instance *of)
{
    double values[1] = {0.0};
    return CALL(fmi3GetDirectionalDerivative, self(of), OUTPUTS, 1, INPUTS, 1, values, 1, values, 1);
}

static int call_fmi3GetFMUState(Instance *of)
{
    void *none = foreign;
    if (!of->legal && one_in(10)) return CALL(fmi3GetFMUState, self(of), one_in(2) ? NULL : &none);
    return CALL(fmi3GetFMUState, self(of), some_state(of));
}
static int call_fmi3SetFMUState(Instance *of) { return CALL(fmi3SetFMUState, self(of), some_saved(of)); }
static int call_fmi3FreeFMUState(Instance *of)
{
    void *none = foreign;
    if (!of->legal && one_in(10)) return CALL(fmi3FreeFMUState, self(of), one_in(2) ? NULL : &none);
    return CALL(fmi3FreeFMUState, self(of), some_state(of));
}
static int call_fmi3SerializedFMUStateSize(Instance *of)
{
    size_t size = 0;
    return CALL(fmi3SerializedFMUStateSize, self(of), some_saved(of), result(of, &size));
}
static int call_fmi3SerializeFMUState(Instance *of)
{
    size_t size = component_serialized_size();
    if (!of->legal && one_in(4)) size = below(2 * size);
    unsigned char *bytes = block(size);
    const int got = CALL(fmi3SerializeFMUState, self(of), some_saved(of), result(of, bytes), size);
    if (got == STATUS_OK) keep_bytes(of, bytes, size);
    else free(bytes);
    return got;
}
static int call_fmi3DeserializeFMUState(Instance *of)
{
    size_t size;
    unsigned char *bytes = some_bytes(of, &size);
    const int got = CALL(fmi3DeserializeFMUState, self(of), result(of, bytes), size, result(of, some_state(of)));
    free(bytes);
    return got;
}

/* ---- Co-simulation ---- */

static int call_fmi3DoStep(Instance *of)
{
    bool event, end, early;
    double last;
    return CALL(fmi3DoStep, self(of), some_time(of), some_step(of), true, result(of, &event), result(of, &end),
                result(of, &early), result(of, &last));
}
static int call_fmi3GetOutputDerivatives(Instance *of)
{
    const fmi3Int32 order[1] = {1};
    double values[1];
    return CALL(fmi3GetOutputDerivatives, self(of), OUTPUTS, !of->legal, order, values, 1);
}
static int call_fmi3ActivateModelPartition(Instance *of)
{
    return CALL(fmi3ActivateModelPartition, self(of), 0, any_number());
}

/* ---- Model Exchange ---- */

static int call_fmi3SetTime(Instance *of) { return CALL(fmi3SetTime, self(of), some_time(of) + (of->legal ? STEP_SIZE : 0.0)); }

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
STATES_CALL(fmi3SetContinuousStates, MODEL_STATES)
STATES_CALL(fmi3GetContinuousStates, MODEL_STATES)
STATES_CALL(fmi3GetContinuousStateDerivatives, MODEL_STATES)
STATES_CALL(fmi3GetNominalsOfContinuousStates, MODEL_STATES)
STATES_CALL(fmi3GetEventIndicators, 0)

static int call_fmi3GetNumberOfContinuousStates(Instance *of)
{
    size_t n;
    return CALL(fmi3GetNumberOfContinuousStates, self(of), result(of, &n));
}
static int call_fmi3GetNumberOfEventIndicators(Instance *of)
{
    size_t n;
    return CALL(fmi3GetNumberOfEventIndicators, self(of), result(of, &n));
}
static int call_fmi3UpdateDiscreteStates(Instance *of)
{
    bool needed, end, nominals, states, defined;
    double next;
    return CALL(fmi3UpdateDiscreteStates, self(of), result(of, &needed), result(of, &end), result(of, &nominals),
                result(of, &states), result(of, &defined), result(of, &next));
}
static int call_fmi3CompletedIntegratorStep(Instance *of)
{
    fmi3Boolean wanted, ended;
    return CALL(fmi3CompletedIntegratorStep, self(of), fmi3True, result(of, &wanted), result(of, &ended));
}

#define N(name) {#name, call_##name}
static const Named OPERATIONS[] = {
    {"fmi3GetFloat", call_get}, {"fmi3SetFloat", call_set}, {"fmi3Instantiate", call_instantiate},
    N(fmi3SetDebugLogging), N(fmi3EnterInitializationMode), N(fmi3ExitInitializationMode), N(fmi3Terminate),
    N(fmi3Reset), N(fmi3GetInt32), N(fmi3SetInt32), N(fmi3GetUInt64), N(fmi3SetUInt64), N(fmi3GetBoolean),
    N(fmi3SetBoolean), N(fmi3GetString), N(fmi3SetString), N(fmi3GetClock), N(fmi3SetClock), N(fmi3GetFMUState),
    N(fmi3SetFMUState), N(fmi3FreeFMUState), N(fmi3SerializedFMUStateSize), N(fmi3SerializeFMUState),
    N(fmi3DeserializeFMUState), N(fmi3GetDirectionalDerivative), N(fmi3GetNumberOfVariableDependencies),
    N(fmi3GetOutputDerivatives), N(fmi3DoStep), N(fmi3ActivateModelPartition), N(fmi3EnterStepMode),
    N(fmi3EnterConfigurationMode), N(fmi3ExitConfigurationMode), N(fmi3EvaluateDiscreteStates), N(fmi3EnterEventMode),
    N(fmi3UpdateDiscreteStates), N(fmi3EnterContinuousTimeMode), N(fmi3CompletedIntegratorStep), N(fmi3SetTime),
    N(fmi3SetContinuousStates), N(fmi3GetEventIndicators), N(fmi3GetContinuousStates),
    N(fmi3GetContinuousStateDerivatives), N(fmi3GetNominalsOfContinuousStates), N(fmi3GetNumberOfContinuousStates),
    N(fmi3GetNumberOfEventIndicators),
};

/* What leads on from each state. */
static Operation *const SAVE = call_fmi3GetFMUState, *const SERIALIZE = call_fmi3SerializeFMUState;
static Operation *const RESTORE = call_fmi3SetFMUState, *const FORGET = call_fmi3FreeFMUState;
static Operation *const RESET = call_fmi3Reset, *const END = call_fmi3Terminate;
static Operation *const PARAMETERS_SET = call_parameters, *const INPUTS_SET = call_set, *const READ = call_get;
static Operation *const ENTER = call_fmi3EnterInitializationMode, *const EXIT = call_fmi3ExitInitializationMode;
static Operation *const STEP_ON = call_fmi3DoStep, *const TIME_SET = call_fmi3SetTime;
static Operation *const EVENTS = call_fmi3EnterEventMode, *const UPDATE = call_fmi3UpdateDiscreteStates;
static Operation *const CONTINUE = call_fmi3EnterContinuousTimeMode;

/* ---- The reference trajectory ---- */

static int begin_simulation(void *c)
{
    return fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0) | fmi3ExitInitializationMode(c);
}
static int set_inputs(void *c, const double values[])
{
    Number narrow[INPUT_SIZE];
    for (int i = 0; i < INPUT_SIZE; i++)
        narrow[i] = (Number)values[i];
    return SET_FLOAT(c, INPUTS, sizeof INPUTS / sizeof 0u, narrow, INPUT_SIZE);
}
static int get_outputs(void *c, double values[])
{
    Number narrow[OUTPUT_SIZE];
    const int got = GET_FLOAT(c, OUTPUTS, sizeof OUTPUTS / sizeof 0u, narrow, OUTPUT_SIZE);
    for (int i = 0; i < OUTPUT_SIZE; i++)
        values[i] = narrow[i];
    return got;
}
static int step_on(void *c, double t)
{
    bool event, end, early;
    double last;
    return fmi3DoStep(c, t, STEP_SIZE, true, &event, &end, &early, &last);
}
static int update(void *c)
{
    bool needed, end, nominals, states, defined;
    double next;
    return fmi3UpdateDiscreteStates(c, &needed, &end, &nominals, &states, &defined, &next) | fmi3EnterContinuousTimeMode(c);
}
static int move(void *c, double t, double x[], double dx[])
{
    int got = fmi3GetContinuousStates(c, x, MODEL_STATES) | fmi3GetContinuousStateDerivatives(c, dx, MODEL_STATES);
    for (int i = 0; i < MODEL_STATES; i++)
        x[i] += STEP_SIZE * dx[i];
    return got | fmi3SetTime(c, t + STEP_SIZE) | fmi3SetContinuousStates(c, x, MODEL_STATES) | fmi3EnterEventMode(c);
}
