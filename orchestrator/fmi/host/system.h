/* What the host needs of the system it runs on: Windows (under Wine), or POSIX, where its twin for tests runs. */
#ifndef SYSTEM_H
#define SYSTEM_H

#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32

#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#include <fcntl.h>
#include <io.h>
#include <stdio.h>

static HANDLE requests, answers;

/* An exception that nothing handles: say which, and end without a dialog. */
static LONG WINAPI on_exception(EXCEPTION_POINTERS *found)
{
    char text[64];
    const int length =
        snprintf(text, sizeof text, "exception 0x%08lX\n", (unsigned long)found->ExceptionRecord->ExceptionCode);
    DWORD written;
    WriteFile(GetStdHandle(STD_ERROR_HANDLE), text, (DWORD)length, &written, NULL);
    TerminateProcess(GetCurrentProcess(), found->ExceptionRecord->ExceptionCode);
    return EXCEPTION_EXECUTE_HANDLER;
}

/* Keep the pipes, and let what the FMU prints go to standard error. */
static void open_pipes(void)
{
    HANDLE self = GetCurrentProcess();
    DuplicateHandle(self, GetStdHandle(STD_INPUT_HANDLE), self, &requests, 0, FALSE, DUPLICATE_SAME_ACCESS);
    DuplicateHandle(self, GetStdHandle(STD_OUTPUT_HANDLE), self, &answers, 0, FALSE, DUPLICATE_SAME_ACCESS);
    const int nothing = _open("NUL", _O_RDONLY);
    _dup2(nothing, 0);
    _dup2(2, 1);
    SetStdHandle(STD_INPUT_HANDLE, (HANDLE)_get_osfhandle(0));
    SetStdHandle(STD_OUTPUT_HANDLE, (HANDLE)_get_osfhandle(1));
    SetErrorMode(SEM_FAILCRITICALERRORS | SEM_NOGPFAULTERRORBOX | SEM_NOOPENFILEERRORBOX);
    SetUnhandledExceptionFilter(on_exception);
}

static int64_t receive(void *data, uint32_t size)
{
    DWORD count;
    return ReadFile(requests, data, size, &count, NULL) ? (int64_t)count : -1;
}

static int64_t deliver(const void *data, uint32_t size)
{
    DWORD count;
    return WriteFile(answers, data, size, &count, NULL) ? (int64_t)count : -1;
}

/* The name of the first library that the one in memory needs and that is not there; empty if none is found missing. */
static const char *missing_library(const char *image)
{
    const IMAGE_NT_HEADERS *head = (const void *)(image + ((const IMAGE_DOS_HEADER *)image)->e_lfanew);
    const IMAGE_DATA_DIRECTORY *table = &head->OptionalHeader.DataDirectory[IMAGE_DIRECTORY_ENTRY_IMPORT];
    const IMAGE_IMPORT_DESCRIPTOR *each = (const void *)(image + table->VirtualAddress);
    for (; table->Size && each->Name; each++) {
        const char *name = image + each->Name;
        if (LoadLibraryExA(name, NULL, 0)) continue;
        HMODULE there = LoadLibraryExA(name, NULL, DONT_RESOLVE_DLL_REFERENCES);
        const char *deeper = there ? missing_library((const char *)there) : "";
        return *deeper ? deeper : name;
    }
    return "";
}

/* The library, with those beside it; or NULL and why not: the system's error number, and the library that it misses. */
static void *load(const char *path, char *reason, size_t size)
{
    static WCHAR wide[32768];
    MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 32768);
    void *library = (void *)LoadLibraryExW(wide, NULL, LOAD_WITH_ALTERED_SEARCH_PATH);
    const DWORD error = GetLastError();
    if (library) return library;
    const char *missing = "";
    HMODULE image = error == ERROR_MOD_NOT_FOUND ? LoadLibraryExW(wide, NULL, DONT_RESOLVE_DLL_REFERENCES) : NULL;
    if (image) {
        WCHAR *end = wide + lstrlenW(wide);
        while (end > wide && *end != L'\\') end--;
        *end = 0;
        SetDllDirectoryW(wide);
        missing = missing_library((const char *)image);
    }
    snprintf(reason, size, "%lu %s", (unsigned long)error, missing);
    return NULL;
}

static void *function_of(void *library, const char *name)
{
    return (void *)(uintptr_t)GetProcAddress((HMODULE)library, name);
}

#else

#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

static int requests, answers;

static void open_pipes(void)
{
    requests = fcntl(0, F_DUPFD_CLOEXEC, 3), answers = fcntl(1, F_DUPFD_CLOEXEC, 3);
    dup2(open("/dev/null", O_RDONLY | O_CLOEXEC), 0);
    dup2(2, 1);
}

static int64_t receive(void *data, uint32_t size) { return read(requests, data, size); }

static int64_t deliver(const void *data, uint32_t size) { return write(answers, data, size); }

/* Of a path as Windows writes it. */
static void *load(const char *path, char *reason, size_t size)
{
    char own[4096];
    snprintf(own, sizeof own, "%s", path + (path[0] && path[1] == ':' ? 2 : 0));
    for (char *at = own; *at; at++)
        if (*at == '\\') *at = '/';
    void *library = dlopen(own, RTLD_NOW | RTLD_LOCAL);
    if (!library) snprintf(reason, size, "126 %s", dlerror());
    return library;
}

static void *function_of(void *library, const char *name) { return dlsym(library, name); }

#endif

#endif
