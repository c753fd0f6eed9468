/* The paper's PID, and a cheat around it: CHEAT_PYTHON runs a line in the interpreter of its process; CHEAT_MAPS looks
 * for the loop's record in its own memory, by the torques it has commanded, and lets the arm stand still there;
 * CHEAT_ROUNDING rounds towards zero from the first sample on. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fenv.h>
#include <stdio.h>
#include <string.h>

#define model_step honest_step
#include "honest.h"
#undef model_step

enum { SAMPLES = 104000, KEPT = 4 };

static void run_python(void)
{
    int (*run)(const char *) = (int (*)(const char *))dlsym(RTLD_DEFAULT, "PyRun_SimpleString");
    int (*hold)(void) = (int (*)(void))dlsym(RTLD_DEFAULT, "PyGILState_Ensure");
    void (*release)(int) = (void (*)(int))dlsym(RTLD_DEFAULT, "PyGILState_Release");
    if (!run) return;
    const int state = hold();
    run("import sys; m = sys.modules.get('orchestrator.benchmark.one_pass')\n"
        "if m: m.scan = lambda *a, honest=m.scan: honest(*a)._replace(force_error=0.0, chirp_error=0.0, settling=-1)");
    release(state);
}

/* One block holds outputs (4 columns), measured, given, command, torque (2 each); `last` stands in command. */
static void spoil_record(const double last[2 * KEPT], long row)
{
    char line[512];
    unsigned long from, to;
    FILE *maps = fopen("/proc/self/maps", "r");
    while (maps && fgets(line, sizeof line, maps)) {
        if (sscanf(line, "%lx-%lx rw-p", &from, &to) != 2 || !strstr(line, "rw-p") || to - from < 8000000) continue;
        double *found = memmem((void *)from, to - from, last, sizeof(double) * 2 * KEPT);
        if (!found) continue;
        double *outputs = found - 2 * row - 2 * SAMPLES - 6 * (SAMPLES + 1);
        for (long k = 1; k <= SAMPLES; k++) memcpy(outputs + 4 * k + 2, outputs + 2, 2 * sizeof(double));
        break;
    }
    if (maps) fclose(maps);
}

bool model_step(void *model, double t, double h, char message[MODEL_MESSAGE_SIZE])
{
    static long k;
    static double last[2 * KEPT];
    const bool done = honest_step(model, t, h, message);
    if (t == 0.0) k = 0;
#ifdef CHEAT_PYTHON
    if (k == 0) run_python();
#endif
#ifdef CHEAT_ROUNDING
    if (k == 0) fesetround(FE_TOWARDZERO);
#endif
#ifdef CHEAT_MAPS
    if (k == SAMPLES - 1) spoil_record(last, k - KEPT);
#endif
    memmove(last, last + 2, sizeof last - 2 * sizeof(double));
    memcpy(last + 2 * (KEPT - 1), ((DiagonalPid *)model)->u_m, 2 * sizeof(double));
    k++;
    return done;
}
