/* A well-behaved FMI 2.0 controller, u_m = u_m0 + q_m_ref - q_m, until the fault strikes that is written in its
 * resources/fault.txt: what, in which call, from which time on [s], in which simulations (0: all, else the number
 * of the instance in this process, or minus its stop time in ms). */
#define _GNU_SOURCE
#include <fcntl.h>
#include <fenv.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"

enum { AXES = 2, Q_M_REF = 0, Q_M = 2, U_M = 4, U_M0 = 6, VARIABLES = 8, HUGE_MESSAGE = 8 << 20 };

typedef struct {
    double values[VARIABLES];
    double time;
    double stop_time;
    int number;
    char resources[4096];
    char what[64], where[64];
    double from, which;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    struct Chat *chat;
} Controller;

static int instances;
/* After the status fatal no function may be called any more, for any instance: this one ends the process then. */
static int is_broken;

/* ---- Faults ---- */

static void say(Controller *own, fmi2Status status, const char *message)
{
    own->logger(own->environment, "hostile", status, "log", "%s", message);
}

/* Of this process [s]. */
static double processor_time(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void spin(void)
{
    for (volatile unsigned long i = 0;; i++) continue;
}

static void *spin_beside(void *unused)
{
    spin();
    return unused;
}

/* ---- Threads that log while a step waits for them ---- */

enum { MOST_THREADS = 8 };

struct Chat {
    int threads, messages, status, over;
    pthread_t thread[MOST_THREADS];
    pthread_barrier_t begin, end;
};

static void log_messages(const Controller *own, const struct Chat *chat)
{
    for (int i = 0; i < chat->messages; i++)
        own->logger(own->environment, "hostile", (fmi2Status)chat->status, "log", "%d of %s at %g s", i, "many", own->time);
}

static void *log_beside(void *controller)
{
    const Controller *own = controller;
    struct Chat *chat = own->chat;
    for (;;) {
        pthread_barrier_wait(&chat->begin);
        if (chat->over) return NULL;
        log_messages(own, chat);
        pthread_barrier_wait(&chat->end);
    }
}

/* One step: each of so many threads, or with none this one, logs so many messages of a status. */
static void chat(Controller *own, const char *words)
{
    struct Chat *chat = own->chat;
    if (!chat) {
        chat = own->chat = calloc(1, sizeof *chat);
        sscanf(words, "%d:%d:%d", &chat->threads, &chat->messages, &chat->status);
        pthread_barrier_init(&chat->begin, NULL, (unsigned)chat->threads + 1);
        pthread_barrier_init(&chat->end, NULL, (unsigned)chat->threads + 1);
        for (int i = 0; i < chat->threads; i++) pthread_create(&chat->thread[i], NULL, log_beside, own);
    }
    if (chat->threads == 0) {
        log_messages(own, chat);
    } else {
        pthread_barrier_wait(&chat->begin);
        pthread_barrier_wait(&chat->end);
    }
}

static void end_chat(Controller *own)
{
    if (!own->chat) return;
    own->chat->over = 1;
    pthread_barrier_wait(&own->chat->begin);
    for (int i = 0; i < own->chat->threads; i++) pthread_join(own->chat->thread[i], NULL);
    free(own->chat);
}

static void *crash_beside(void *unused)
{
    usleep(20000);
    abort();
    return unused;
}

static void look_away(int signal) { (void)signal; }

static int recurse(volatile int depth)
{
    volatile char block[4096];
    block[depth % 4096] = (char)depth;
    return recurse(depth + 1) + block[depth % 4096];
}

/* A process that stays behind; its number goes into the FMU's own folder. */
static void leave_daemon(Controller *own, int new_session)
{
    const pid_t child = fork();
    if (child == 0) {
        if (new_session) {
            setsid();
            if (fork() != 0) _exit(0);
        }
        char name[4200];
        snprintf(name, sizeof name, "%s/daemon.pid", own->resources);
        FILE *file = fopen(name, "w");
        if (file) {
            fprintf(file, "%d", (int)getpid());
            fclose(file);
        }
        for (;;) sleep(1);
    }
    usleep(300000);
}

static void write_everywhere(const char *bytes, size_t size)
{
    for (int file = 3; file < 64; file++) {
        struct stat about;
        if (fstat(file, &about) == 0 && (S_ISFIFO(about.st_mode) || S_ISSOCK(about.st_mode))) {
            fcntl(file, F_SETFL, O_NONBLOCK);
            if (write(file, bytes, size) < 0) continue;
        }
    }
}

static int equal(const char *a, const char *b) { return strcmp(a, b) == 0; }

/* What the call returns if nothing worse happens. */
static fmi2Status strike(Controller *own)
{
    const char *what = own->what;
    if (strncmp(what, "status:", 7) == 0) {
        say(own, fmi2Warning, "as you wish");
        is_broken = atoi(what + 7) == fmi2Fatal;
        return (fmi2Status)atoi(what + 7);
    }
    if (strncmp(what, "value:", 6) == 0) {
        own->values[U_M + 1] = strtod(what + 6, NULL);
        return fmi2OK;
    }
    if (strncmp(what, "exit:", 5) == 0) exit(atoi(what + 5));
    if (strncmp(what, "_exit:", 6) == 0) _exit(atoi(what + 6));
    if (strncmp(what, "kill:", 5) == 0) kill(getpid(), atoi(what + 5));
    if (equal(what, "segfault")) {
        say(own, fmi2Warning, "about to follow a bad pointer");
        *(volatile int *)16 = 1;
    }
    if (equal(what, "abort")) abort();
    if (equal(what, "overflow")) recurse(0);
    if (equal(what, "trap")) feenableexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW);
    if (equal(what, "round")) fesetround(FE_UPWARD);
    if (equal(what, "spin")) spin();
    if (strncmp(what, "compute:", 8) == 0) {
        const double begin = processor_time();
        while (processor_time() < begin + strtod(what + 8, NULL)) continue;
        own->what[0] = 0;
    }
    if (equal(what, "sleep"))
        for (;;) sleep(1);
    if (equal(what, "lock")) {
        pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
        pthread_mutex_lock(&mutex);
        pthread_mutex_lock(&mutex);
    }
    if (equal(what, "socket")) {
        int pair[2];
        char byte;
        if (socketpair(AF_UNIX, SOCK_STREAM, 0, pair) == 0 && read(pair[0], &byte, 1) < 0) return fmi2Error;
    }
    if (equal(what, "fork")) { /* computes in a child, and waits for it */
        const pid_t child = fork();
        if (child == 0) spin();
        waitpid(child, NULL, 0);
    }
    if (equal(what, "forks")) { /* computes in children that nobody waits for */
        signal(SIGCHLD, SIG_IGN);
        for (;;) {
            const pid_t child = fork();
            const double begin = processor_time();
            while (child == 0)
                if (processor_time() > begin + 0.5) _exit(0);
            waitpid(child, NULL, 0);
        }
    }
    if (equal(what, "block-signals")) {
        sigset_t all;
        sigfillset(&all);
        sigprocmask(SIG_BLOCK, &all, NULL);
        spin();
    }
    if (equal(what, "stop")) raise(SIGSTOP);
    if (equal(what, "handlers")) {
        for (int number = 1; number < 32; number++) signal(number, look_away);
        *(volatile int *)16 = 1; /* the handler returns, the instruction is tried again, for ever */
    }
    if (equal(what, "thread")) {
        pthread_t thread;
        pthread_create(&thread, NULL, spin_beside, NULL);
        own->what[0] = 0;
    }
    if (strncmp(what, "chat:", 5) == 0) chat(own, what + 5);
    if (equal(what, "thread-crash")) {
        pthread_t thread;
        pthread_create(&thread, NULL, crash_beside, NULL);
        spin();
    }
    if (equal(what, "grow"))
        for (;;) {
            const size_t size = 16 << 20;
            char *volatile block = malloc(size); /* which a compiler may not leave out */
            if (block) memset(block, 1, size);
            usleep(20000);
        }
    if (strncmp(what, "log:", 4) == 0)
        for (;;) say(own, (fmi2Status)atoi(what + 4), "still here, and talking");
    if (equal(what, "print"))
        for (;;) puts("no news, but plenty of it");
    if (equal(what, "utf8")) say(own, fmi2Error, "caf\xe9 \xff\xfe \xc0\x80");
    if (equal(what, "percent")) say(own, fmi2Error, "100 %s of %n and %d%%");
    if (equal(what, "format")) { /* a word that is no text, as from a format with too few arguments */
        own->logger(own->environment, "hostile", fmi2Error, "log", "100 %s of %s", (const char *)8, (const char *)8);
    }
    if (equal(what, "null-message")) own->logger(own->environment, NULL, fmi2Error, NULL, NULL);
    if (equal(what, "huge-message")) {
        char *text = malloc(HUGE_MESSAGE);
        memset(text, 'x', HUGE_MESSAGE - 1);
        text[HUGE_MESSAGE - 1] = 0;
        say(own, fmi2Error, text);
    }
    if (equal(what, "chdir") && chdir("/") != 0) return fmi2Error;
    if (equal(what, "umask")) umask(0777);
    if (equal(what, "close-output")) {
        close(1);
        close(2);
    }
    if (equal(what, "close-all")) {
        for (int file = 0; file < 256; file++) close(file);
        spin();
    }
    if (equal(what, "daemon")) leave_daemon(own, 0);
    if (equal(what, "daemon-session")) leave_daemon(own, 1);
    if (equal(what, "daemon-crash")) {
        leave_daemon(own, 1);
        abort();
    }
    if (equal(what, "garbage")) {
        write_everywhere("\x7f\x00\x00\x00garbage", 11);
        spin();
    }
    if (equal(what, "kill-parent")) {
        kill(getppid(), SIGKILL);
        spin();
    }
    if (equal(what, "spoil")) { /* its own description of faults */
        char name[4200];
        snprintf(name, sizeof name, "%s/fault.txt", own->resources);
        FILE *file = fopen(name, "w");
        if (file) {
            fputs("abort step 0 0\n", file);
            fclose(file);
        }
    }
    if (equal(what, "utf8") || equal(what, "percent") || equal(what, "format") || equal(what, "null-message")
        || equal(what, "huge-message"))
        return fmi2Error;
    return fmi2OK;
}

static fmi2Status maybe(Controller *own, const char *where)
{
    if (own->what[0] == 0 || !equal(own->where, where)) return fmi2OK;
    if (own->time < own->from - 1e-9) return fmi2OK;
    if (own->which > 0.0 && own->number != (int)own->which) return fmi2OK;
    if (own->which < 0.0 && fabs(own->stop_time * 1e3 + own->which) > 0.01) return fmi2OK;
    return strike(own);
}

static void read_fault(Controller *own, const char *resources)
{
    const char *path = strncmp(resources, "file://", 7) == 0 ? resources + 7 : resources;
    snprintf(own->resources, sizeof own->resources, "%s", path);
    char name[4200];
    snprintf(name, sizeof name, "%s/fault.txt", path);
    FILE *file = fopen(name, "r");
    if (!file) return;
    if (fscanf(file, "%63s %63s %lf %lf", own->what, own->where, &own->from, &own->which) != 4) own->what[0] = 0;
    fclose(file);
}

/* ---- FMI 2.0 ---- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)visible, (void)logging;
    if (is_broken) abort();
    Controller *own = calloc(1, sizeof(Controller));
    own->number = ++instances;
    own->logger = host->logger;
    own->environment = host->componentEnvironment;
    read_fault(own, resources);
    if (maybe(own, "instantiate") > fmi2Warning) return NULL;
    return own;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (is_broken) abort();
    maybe(c, "free");
    end_chat(c);
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stops, fmi2Real stop)
{
    (void)tolerant, (void)tolerance, (void)start, (void)stops;
    ((Controller *)c)->stop_time = stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return maybe(c, "initialize"); }

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Controller *own = c;
    for (int i = 0; i < AXES; i++) own->values[U_M + i] = own->values[U_M0 + i];
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) { return maybe(c, "terminate"); }
fmi2Status fmi2Reset(fmi2Component c) { return maybe(c, "reset"); }

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Controller *own = c;
    for (size_t i = 0; i < n; i++) own->values[vr[i]] = value[i];
    return maybe(own, "set");
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Controller *own = c;
    const fmi2Status status = maybe(own, "get");
    for (size_t i = 0; i < n; i++) value[i] = own->values[vr[i]];
    return status;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_state)
{
    (void)h, (void)no_state;
    Controller *own = c;
    own->time = t;
    for (int i = 0; i < AXES; i++)
        own->values[U_M + i] = own->values[U_M0 + i] + own->values[Q_M_REF + i] - own->values[Q_M + i];
    return maybe(own, "step");
}

/* What nobody calls, but everybody looks for. */
#define UNUSED(name) \
    fmi2Status fmi2##name(void) { return fmi2Error; }
UNUSED(SetDebugLogging) UNUSED(GetInteger) UNUSED(GetBoolean) UNUSED(GetString) UNUSED(SetInteger) UNUSED(SetBoolean)
UNUSED(SetString) UNUSED(GetFMUstate) UNUSED(SetFMUstate) UNUSED(FreeFMUstate) UNUSED(SerializedFMUstateSize)
UNUSED(SerializeFMUstate) UNUSED(DeSerializeFMUstate) UNUSED(GetDirectionalDerivative) UNUSED(SetRealInputDerivatives)
UNUSED(GetRealOutputDerivatives) UNUSED(CancelStep) UNUSED(GetStatus) UNUSED(GetRealStatus) UNUSED(GetIntegerStatus)
UNUSED(GetBooleanStatus) UNUSED(GetStringStatus)
