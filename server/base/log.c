/* See log.h. A line is formatted on the stack and written at once, so that lines of several
 * threads never mix and a crash loses none. */
#include "base/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

static enum skd_log_level threshold = SKD_LOG_INFO;

void skd_log_set_level(enum skd_log_level level)
{
    threshold = level;
}

void skd_log(enum skd_log_level level, const char *format, ...)
{
    static const char *const names[] = {"error", "warning", "info", "debug"};
    if (level > threshold)
        return;
    char line[1024];
    struct timespec now;
    struct tm parts;
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &parts);
    size_t used = strftime(line, sizeof line, "%FT%TZ ", &parts);
    used += (size_t)snprintf(line + used, sizeof line - used, "skind[%d] %s: ", (int)getpid(),
                             names[level]);
    va_list arguments;
    va_start(arguments, format);
    int written = vsnprintf(line + used, sizeof line - used - 1, format, arguments);
    va_end(arguments);
    if (written > 0)
        used += (size_t)written < sizeof line - used - 1 ? (size_t)written : sizeof line - used - 2;
    line[used++] = '\n';
    /* stderr may be closed; there is nobody left to tell. */
    ssize_t ignored = write(STDERR_FILENO, line, used);
    (void)ignored;
}
