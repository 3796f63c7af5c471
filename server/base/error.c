/* See error.h. Three functions, no state. */
#include "base/error.h"

#include "base/utf8.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

enum skd_status skd_fail(struct skd_error *error, enum skd_status status, const char *format, ...)
{
    SKD_ASSERT(status != SKD_OK);
    if (error == NULL)
        return status;
    error->status = status;
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(error->text, sizeof error->text, format, arguments);
    va_end(arguments);
    skd_utf8_mend(error->text);
    return status;
}

enum skd_status skd_fail_memory(struct skd_error *error, const char *what)
{
    return skd_fail(error, SKD_NO_MEMORY,
                    "there is no memory for %s; close other sessions or programs and try again",
                    what);
}

void skd_assert_failed(const char *condition, const char *file, int line)
{
    fprintf(stderr, "skind: bug: %s does not hold (%s:%d)\n", condition, file, line);
    abort();
}
