/* Loads an FMU's library and calls its functions for a process that cannot: the master, on Linux, for a DLL.
 *
 * A request begins with five doubles: what to do and four numbers. LOAD, FIND, CALL and CONNECT have a payload, whose
 * size in bytes is the first of these; they are answered by the size of a payload (uint64) and the payload. EXCHANGE is
 * one step of the closed loop: two inputs, time, step [s]; it is answered by four doubles: the last call (SET, STEP,
 * GET), its status, two outputs. orchestrator/fmi/host/wine.py is the other side, and loads this as a library of
 * Windows under Wine; on Linux the same source loads shared objects, for tests.
 */
#include <stdint.h>

#include "system.h"

#include "logger.h"

#include <xmmintrin.h>

enum { END, EXCHANGE, LOAD, FIND, CALL, CONNECT };
enum { SET, STEP, GET };

static const double TERMINATED = 4294967296.0, EARLY_RETURN = 4294967297.0, EVENT_MODE = 4294967300.0, CHANGED = 8589934592.0;
/* Statuses beyond those of FMI, as in orchestrator/fmi/port.py. */

enum { MOST_ARGUMENTS = 14, ARITHMETIC = 0xE040 };
/* Bits of the control word for rounding and for denormal numbers, as in orchestrator/jit.py. */

typedef int (*Access)(void *, const uint32_t *, size_t, void *);
typedef int (*Access3)(void *, const uint32_t *, size_t, void *, size_t);
typedef int (*DoStep)(void *, double, double, int);
typedef int (*DoStep3)(void *, double, double, int, char *, char *, char *, double *);

/* ---- Bytes ---- */

static int receive_all(void *data, uint64_t size)
{
    for (char *at = data; size > 0;) {
        const int64_t count = receive(at, size > 1 << 20 ? 1 << 20 : (uint32_t)size);
        if (count <= 0) return 0;
        at += count, size -= (uint64_t)count;
    }
    return 1;
}

static int deliver_all(const void *data, uint64_t size)
{
    for (const char *at = data; size > 0;) {
        const int64_t count = deliver(at, size > 1 << 16 ? 1 << 16 : (uint32_t)size);
        if (count <= 0) return 0;
        at += count, size -= (uint64_t)count;
    }
    return 1;
}

static int answer(const void *data, uint64_t size) { return deliver_all(&size, sizeof size) && deliver_all(data, size); }

/* ---- One call of any function ---- */

typedef struct {
    char kind; /* 'i' integer or handle, 'd' double, 'b' buffer, 'l' callbacks or logger */
    uint64_t value;
    double number;
    char *buffer;
    uint64_t size;
} Argument;

typedef uint64_t (*Plain)(uint64_t, uint64_t, uint64_t, uint64_t, uint64_t, uint64_t, uint64_t, uint64_t, uint64_t,
                          uint64_t, uint64_t, uint64_t, uint64_t, uint64_t);
typedef uint64_t (*At)(uint64_t, double, uint64_t, double);
typedef uint64_t (*Over)(uint64_t, double, double, uint64_t, uint64_t, uint64_t, uint64_t, uint64_t);
typedef uint64_t (*Experiment)(uint64_t, uint64_t, double, double, uint64_t, double);
typedef void *(*Instantiate1)(const char *, const char *, const char *, const char *, double, char, char, Callbacks1,
                              char);

/* By which arguments are doubles: functions of FMI have these four kinds. Arguments too many do no harm. */
static int call(void *function, const Argument *a, int count, uint64_t *result)
{
    unsigned doubles = 0;
    for (int i = 0; i < count; i++) doubles |= (unsigned)(a[i].kind == 'd') << i;
    const uint64_t *v[MOST_ARGUMENTS];
    for (int i = 0; i < MOST_ARGUMENTS; i++) v[i] = &a[i].value;
    if (count == 9 && doubles == 1 << 4) {
        *result = (uint64_t)(uintptr_t)((Instantiate1)function)(a[0].buffer, a[1].buffer, a[2].buffer, a[3].buffer,
                                                               a[4].number, (char)a[5].value, (char)a[6].value,
                                                               callbacks.common, (char)a[8].value);
    } else if (doubles == 0) {
        *result = ((Plain)function)(*v[0], *v[1], *v[2], *v[3], *v[4], *v[5], *v[6], *v[7], *v[8], *v[9], *v[10],
                                    *v[11], *v[12], *v[13]);
    } else if (doubles == 2 || doubles == 10) {
        *result = ((At)function)(*v[0], a[1].number, *v[2], a[3].number);
    } else if (doubles == 6) {
        *result = ((Over)function)(*v[0], a[1].number, a[2].number, *v[3], *v[4], *v[5], *v[6], *v[7]);
    } else if (doubles == 44) {
        *result = ((Experiment)function)(*v[0], *v[1], a[2].number, a[3].number, *v[4], a[5].number);
    } else {
        return 0;
    }
    return 1;
}

/* A word of the payload. */
static uint64_t word(const char **at)
{
    uint64_t value;
    memcpy(&value, *at, sizeof value);
    *at += sizeof value;
    return value;
}

/* The payload: the function's address, the number of arguments, and of each its kind and its value, or the size of its
 * contents. The answer: 1 if it was called, its result, the contents of all buffers, and what the FMU has said. Of no
 * function (address 0) the answer is the last alone. */
static int answer_call(const char *at)
{
    void *function = (void *)(uintptr_t)word(&at);
    const int count = (int)word(&at);
    Argument a[MOST_ARGUMENTS] = {{0}};
    uint64_t size = 2 * sizeof(uint64_t) + sizeof kept;
    for (int i = 0; i < count && i < MOST_ARGUMENTS; i++) {
        a[i].kind = (char)word(&at);
        const uint64_t value = word(&at);
        if (a[i].kind == 'd') {
            memcpy(&a[i].number, &value, sizeof value);
        } else if (a[i].kind == 'l') {
            a[i].value = value == 3 ? (uint64_t)(uintptr_t)on_message_3 : (uint64_t)(uintptr_t)&callbacks;
        } else if (a[i].kind == 'b') {
            a[i].buffer = malloc(value + 1);
            memcpy(a[i].buffer, at, value);
            at += value, size += value;
            a[i].size = value, a[i].value = (uint64_t)(uintptr_t)a[i].buffer;
        } else {
            a[i].value = value;
        }
    }
    char *found = malloc(size), *end = found + 2 * sizeof(uint64_t);
    uint64_t result = 0;
    const uint64_t called = function && count <= MOST_ARGUMENTS && call(function, a, count, &result);
    memcpy(found, &called, sizeof called);
    memcpy(found + sizeof called, &result, sizeof result);
    for (int i = 0; i < count && i < MOST_ARGUMENTS; i++)
        if (a[i].kind == 'b') {
            memcpy(end, a[i].buffer, a[i].size);
            end += a[i].size;
            free(a[i].buffer);
        }
    for (unsigned i = said > MESSAGES ? said - MESSAGES : 0; i < said; i++) {
        const size_t length = strlen(kept[i % MESSAGES]) + 1;
        memcpy(end, kept[i % MESSAGES], length);
        end += length;
    }
    said = 0;
    const int sent = answer(found, (uint64_t)(end - found));
    free(found);
    return sent;
}

/* ---- The loop ---- */

static struct {
    uint64_t version, instance, set, step, get, size_in, size_out, single_in, single_out, count_in, count_out;
} loop;

static uint32_t *inputs, *outputs;
static double input_values[2], output_values[2];

/* The payload: the fields of loop, then value references of inputs and of outputs. */
static int connect_loop(const char *at)
{
    memcpy(&loop, at, sizeof loop);
    at += sizeof loop;
    if (loop.size_in > 2 || loop.size_out > 2 || loop.count_in > 2 || loop.count_out > 2) return 0;
    static uint32_t references[4];
    memcpy(references, at, 4 * (loop.count_in + loop.count_out));
    inputs = references, outputs = references + loop.count_in;
    return 1;
}

static int access_values(uint64_t function, const uint32_t *references, uint64_t count, void *values, uint64_t size)
{
    void *instance = (void *)(uintptr_t)loop.instance, *at = (void *)(uintptr_t)function;
    if (loop.version == 3) return ((Access3)at)(instance, references, count, values, size);
    return ((Access)at)(instance, references, count, values);
}

static int write_inputs(void)
{
    float singles[2] = {(float)input_values[0], (float)input_values[1]};
    void *values = loop.single_in ? (void *)singles : (void *)input_values;
    return access_values(loop.set, inputs, loop.count_in, values, loop.size_in);
}

static int read_outputs(void)
{
    /* What the FMU does not write is not a number, and not the value of the sample before. */
    const double none = __builtin_nan("");
    float singles[2] = {(float)none, (float)none};
    output_values[0] = output_values[1] = none;
    void *values = loop.single_out ? (void *)singles : (void *)output_values;
    const int status = access_values(loop.get, outputs, loop.count_out, values, loop.size_out);
    if (loop.single_out) output_values[0] = singles[0], output_values[1] = singles[1];
    return status;
}

static double do_step(double time, double step)
{
    void *instance = (void *)(uintptr_t)loop.instance, *at = (void *)(uintptr_t)loop.step;
    if (loop.version != 3) return (uint32_t)((DoStep)at)(instance, time, step, 1);
    char event = 0, terminate = 0, early = 0;
    double last = time + step;
    const uint32_t status = (uint32_t)((DoStep3)at)(instance, time, step, 1, &event, &terminate, &early, &last);
    if (status > 1) return status;
    if (terminate) return TERMINATED;
    if (event) return EVENT_MODE;
    return early || last < time + step * (1.0 - 1e-6) ? EARLY_RETURN : status;
}

static int exchange(const double *request)
{
    double found[4] = {SET, 0.0, 0.0, 0.0};
    input_values[0] = request[1], input_values[1] = request[2];
    const double written = loop.count_in ? (uint32_t)write_inputs() : 0;
    found[1] = written;
    if (written <= 1.0) {
        const double stepped = do_step(request[3], request[4]);
        found[0] = STEP, found[1] = stepped;
        if (stepped <= 1.0) {
            const double got = (uint32_t)read_outputs();
            found[0] = GET;
            found[1] = got > stepped ? got : stepped;
            if (written > found[1]) found[1] = written;
            const unsigned changed = _mm_getcsr() & ARITHMETIC;
            if (found[1] <= 1.0 && changed) found[1] = CHANGED + changed;
        }
    }
    found[2] = output_values[0], found[3] = output_values[1];
    return deliver_all(found, sizeof found);
}

/* ---- Requests ---- */

static int serve(int what, const char *payload)
{
    static void *library;
    if (what == LOAD) {
        static char reason[LONGEST];
        own_name = strdup(payload);
        library = load(payload + strlen(payload) + 1, reason, LONGEST);
        return answer(reason, library ? 0 : strlen(reason));
    }
    if (what == FIND) {
        const uint64_t found = (uint64_t)(uintptr_t)function_of(library, payload);
        return answer(&found, sizeof found);
    }
    if (what == CALL) return answer_call(payload);
    const uint64_t found = (uint64_t)connect_loop(payload);
    return answer(&found, sizeof found);
}

int main(void)
{
    double request[5];
    open_pipes();
    while (receive_all(request, sizeof request) && request[0] != END) {
        if (request[0] == EXCHANGE) {
            if (!exchange(request)) break;
            continue;
        }
        char *payload = malloc((size_t)request[1] + 1);
        if (!payload || !receive_all(payload, (uint64_t)request[1])) break;
        payload[(size_t)request[1]] = 0;
        const int sent = serve((int)request[0], payload);
        free(payload);
        if (!sent) break;
    }
    return 0;
}
