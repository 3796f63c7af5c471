/* See options.h. */
#include "clients/cli/options.h"

#include <stdarg.h>
#include <stdio.h>

struct skd_cli_options skd_cli;

void skd_cli_say(const char *format, ...)
{
    va_list arguments;
    if (skd_cli.quiet)
        return;
    fflush(stdout); /* so that talk and data keep their order on a terminal */
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
}
