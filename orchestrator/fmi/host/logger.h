/* Callbacks of FMI 1, 2 and 3. What an FMU says with a status above OK is printed at once, so that it outlives a crash,
 * and the last messages are kept for the next answer. */
#ifndef LOGGER_H
#define LOGGER_H

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MESSAGES = 20, LONGEST = 600 };

static char kept[MESSAGES][LONGEST];
static unsigned said;

static void keep(const char *instance, int status, const char *text)
{
    if (status <= 0) return;
    char *line = kept[said++ % MESSAGES];
    snprintf(line, LONGEST, "%s: %s", instance ? instance : "", text ? text : "");
    for (char *at = line; *at; at++)
        if (*at == '\n' || *at == '\r') *at = ';';
    fprintf(stderr, "%s\n", line);
    fflush(stderr);
}

/* FMI 1 and 2. */
static void on_message(void *owner, const char *instance, int status, const char *category, const char *format, ...)
{
    (void)owner, (void)category;
    char text[LONGEST];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format ? format : "", arguments);
    va_end(arguments);
    keep(instance, status, text);
}

static const char *own_name = "";

/* FMI 3. */
static void on_message_3(void *owner, int status, const char *category, const char *text)
{
    (void)owner, (void)category;
    keep(own_name, status, text);
}

/* As in fmi1CallbackFunctions; fmi2CallbackFunctions has a fifth entry, the environment. */
typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, int);
} Callbacks1;

typedef struct {
    Callbacks1 common;
    void *environment;
} Callbacks2;

static Callbacks2 callbacks = {{on_message, calloc, free, NULL}, NULL};

#endif
