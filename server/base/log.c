/* See log.h. A line is formatted on the stack and written at once, so that lines of several
 * threads never mix and a crash loses none. */
#include "base/log.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

enum { WARNINGS_AT_ONCE = 1000 };

static enum skd_log_level threshold = SKD_LOG_INFO;
static atomic_int_fast64_t full_ms;
static atomic_uint left_out;

void skd_log_set_level(enum skd_log_level level)
{
    threshold = level;
}

__attribute__((format(printf, 2, 0))) static void write_line(enum skd_log_level level,
                                                             const char *format, va_list arguments)
{
    static const char *const names[] = {"error", "warning", "info", "debug"};
    char line[1024];
    struct timespec now;
    struct tm parts;
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &parts);
    size_t used = strftime(line, sizeof line, "%FT%TZ ", &parts);
    used += (size_t)snprintf(line + used, sizeof line - used, "skind[%d] %s: ", (int)getpid(),
                             names[level]);
    int written = vsnprintf(line + used, sizeof line - used - 1, format, arguments);
    if (written > 0)
        used += (size_t)written < sizeof line - used - 1 ? (size_t)written : sizeof line - used - 2;
    line[used++] = '\n';
    /* stderr may be closed; there is nobody left to tell. */
    ssize_t ignored = write(STDERR_FILENO, line, used);
    (void)ignored;
}

__attribute__((format(printf, 2, 3))) static void write_now(enum skd_log_level level,
                                                            const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    write_line(level, format, arguments);
    va_end(arguments);
}

/* Whether there is room for one more warning: of each second for one, and of idle ones for so many
 * together. `full_ms` is when all that were written have got their second. */
static bool has_room(void)
{
    struct timespec clock;
    clock_gettime(CLOCK_MONOTONIC, &clock);
    const int64_t now_ms = (int64_t)clock.tv_sec * 1000 + clock.tv_nsec / 1000000;
    int_fast64_t full = atomic_load(&full_ms), begin;
    do {
        begin = full > now_ms ? full : now_ms;
        if (begin - now_ms >= WARNINGS_AT_ONCE * 1000)
            return false;
    } while (!atomic_compare_exchange_weak(&full_ms, &full, begin + 1000));
    return true;
}

void skd_log(enum skd_log_level level, const char *format, ...)
{
    if (level > threshold)
        return;
    if (level == SKD_LOG_WARNING && !has_room()) {
        atomic_fetch_add(&left_out, 1);
        return;
    }
    unsigned more = atomic_exchange(&left_out, 0);
    if (more > 0)
        write_now(SKD_LOG_WARNING, "%u warnings were left out here", more);
    va_list arguments;
    va_start(arguments, format);
    write_line(level, format, arguments);
    va_end(arguments);
}
