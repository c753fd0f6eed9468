/* A controller of FMI 2.0 for Windows, u_m = u_m0 + q_m_ref - q_m, with the fault that its resources/fault.txt names.
 * It is compiled once; where it is, it finds by its own path, since some faults strike before it is told anything. */
#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <windows.h>
#include <xmmintrin.h>

#include "fmi2Functions.h"

enum { VARIABLES = 8 };

static double values[VARIABLES];
static fmi2CallbackLogger logger;
static fmi2ComponentEnvironment environment;
static char fault[64];
static int (*volatile nothing)(void);
static volatile int zero;

static int recurse(volatile int depth)
{
    volatile char block[4096];
    block[depth % 4096] = (char)depth;
    return recurse(depth + 1) + block[depth % 4096];
}

static DWORD WINAPI crash_beside(void *unused)
{
    (void)unused;
    return (DWORD)nothing();
}

static void spin(void)
{
    for (volatile unsigned long i = 0;; i++) continue;
}

static void start_child(void)
{
    STARTUPINFOA start = {.cb = sizeof start};
    PROCESS_INFORMATION child;
    char command[] = "Z:\\bin\\sleep 1000";
    if (!CreateProcessA(NULL, command, NULL, NULL, FALSE, DETACHED_PROCESS, NULL, NULL, &start, &child)) abort();
}

static void write_everywhere(void)
{
    char noise[200];
    DWORD count;
    memset(noise, 'x', sizeof noise);
    for (uintptr_t i = 4; i < 2000; i += 4) WriteFile((HANDLE)i, noise, sizeof noise, &count, NULL);
}

static void close_everything(void)
{
    for (uintptr_t i = 4; i < 2000; i += 4) CloseHandle((HANDLE)i);
}

/* What goes wrong in the step, if it is there. */
static fmi2Status strike(const char *where)
{
    char what[64];
    const size_t length = strlen(where);
    if (strncmp(fault, where, length) != 0 || fault[length] != '-') return fmi2OK;
    strcpy(what, fault + length + 1);
    if (!strcmp(what, "crash")) nothing();
    if (!strcmp(what, "hang")) spin();
    if (!strcmp(what, "wait")) Sleep(INFINITE);
    if (!strcmp(what, "exit")) exit(0);
    if (!strcmp(what, "kill")) TerminateProcess(GetCurrentProcess(), 7);
    if (!strcmp(what, "abort")) abort();
    if (!strcmp(what, "divide")) values[0] = 7 / zero;
    if (!strcmp(what, "raise")) RaiseException(0xE0000001, EXCEPTION_NONCONTINUABLE, 0, NULL);
    if (!strcmp(what, "overflow")) values[0] = recurse(0);
    if (!strcmp(what, "rounding")) _mm_setcsr(_mm_getcsr() | 0x4000);
    if (!strcmp(what, "denormal")) _mm_setcsr(_mm_getcsr() | 0x8040);
    if (!strcmp(what, "thread")) CreateThread(NULL, 0, crash_beside, NULL, 0, NULL), Sleep(1000);
    if (!strcmp(what, "child")) start_child();
    if (!strcmp(what, "noise")) write_everywhere();
    if (!strcmp(what, "close")) close_everything();
    if (!strcmp(what, "window")) MessageBoxA(NULL, "Is there anybody?", "hostile", MB_OK);
    if (!strcmp(what, "nan")) values[4] = nothing == NULL ? 0.0 / (double)zero : 0.0;
    if (!strcmp(what, "print"))
        for (;;) puts("and on and on and on and on and on and on");
    if (!strcmp(what, "log"))
        for (;;) logger(environment, "hostile", fmi2Warning, "log", "and on and on and on %d", zero);
    if (!strcmp(what, "memory"))
        for (;;) memset(malloc(1 << 24), 1, 1 << 24), Sleep(10);
    if (!strcmp(what, "discard")) return logger(environment, "hostile", fmi2Error, "log", "no: %s", "why?"), fmi2Discard;
    if (!strcmp(what, "status")) return (fmi2Status)77;
    return fmi2OK;
}

BOOL WINAPI DllMain(HINSTANCE library, DWORD reason, void *unused)
{
    (void)unused;
    if (reason != DLL_PROCESS_ATTACH) return TRUE;
    char path[MAX_PATH + 64];
    GetModuleFileNameA(library, path, MAX_PATH);
    for (int i = 0; i < 3; i++) *strrchr(path, '\\') = 0;
    strcat(path, "\\resources\\fault.txt");
    FILE *file = fopen(path, "r");
    if (file && fgets(fault, sizeof fault, file)) fclose(file);
    if (!strcmp(fault, "main-no")) return FALSE;
    strike("main");
    return TRUE;
}

fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions *f,
                              fmi2Boolean v, fmi2Boolean l)
{
    (void)n, (void)t, (void)g, (void)r, (void)v, (void)l;
    logger = f->logger, environment = f->componentEnvironment;
    memset(values, 0, sizeof values);
    strike("instantiate");
    return strcmp(fault, "instantiate-no") ? values : NULL;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[])
{
    (void)c;
    for (size_t i = 0; i < n; i++) values[r[i]] = v[i];
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[])
{
    (void)c;
    for (size_t i = 0; i < n; i++) v[i] = values[r[i]];
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean b)
{
    (void)c, (void)h, (void)b;
    for (int i = 0; i < 2; i++) values[4 + i] = values[6 + i] + values[i] - values[2 + i];
    return t < 0.02 ? fmi2OK : strike("step");
}

void fmi2FreeInstance(fmi2Component c)
{
    (void)c;
    strike("free");
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return strike("terminate");
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

#define EMPTY(name, ...) \
    fmi2Status name(__VA_ARGS__) { return fmi2OK; }

typedef const fmi2ValueReference References[];

EMPTY(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean l, size_t n, const fmi2String s[])
EMPTY(fmi2SetupExperiment, fmi2Component c, fmi2Boolean d, fmi2Real t, fmi2Real s, fmi2Boolean e, fmi2Real f)
EMPTY(fmi2EnterInitializationMode, fmi2Component c)
EMPTY(fmi2ExitInitializationMode, fmi2Component c)
EMPTY(fmi2Reset, fmi2Component c)
EMPTY(fmi2GetInteger, fmi2Component c, References r, size_t n, fmi2Integer v[])
EMPTY(fmi2GetBoolean, fmi2Component c, References r, size_t n, fmi2Boolean v[])
EMPTY(fmi2GetString, fmi2Component c, References r, size_t n, fmi2String v[])
EMPTY(fmi2SetInteger, fmi2Component c, References r, size_t n, const fmi2Integer v[])
EMPTY(fmi2SetBoolean, fmi2Component c, References r, size_t n, const fmi2Boolean v[])
EMPTY(fmi2SetString, fmi2Component c, References r, size_t n, const fmi2String v[])
EMPTY(fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *s)
EMPTY(fmi2SetFMUstate, fmi2Component c, fmi2FMUstate s)
EMPTY(fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *s)
EMPTY(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n)
EMPTY(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n)
EMPTY(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
EMPTY(fmi2GetDirectionalDerivative, fmi2Component c, References u, size_t n, References k, size_t m,
      const fmi2Real d[], fmi2Real e[])
EMPTY(fmi2SetRealInputDerivatives, fmi2Component c, References r, size_t n, const fmi2Integer o[], const fmi2Real v[])
EMPTY(fmi2GetRealOutputDerivatives, fmi2Component c, References r, size_t n, const fmi2Integer o[], fmi2Real v[])
EMPTY(fmi2CancelStep, fmi2Component c)
EMPTY(fmi2GetStatus, fmi2Component c, const fmi2StatusKind k, fmi2Status *s)
EMPTY(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind k, fmi2Real *s)
EMPTY(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind k, fmi2Integer *s)
EMPTY(fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind k, fmi2Boolean *s)
EMPTY(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind k, fmi2String *s)
