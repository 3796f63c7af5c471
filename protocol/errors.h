/* The registry of errors as a table; errors.def is its source. Thread: any. */
#ifndef SKD_PROTOCOL_ERRORS_H
#define SKD_PROTOCOL_ERRORS_H

#include "base/error.h"

struct skd_error_entry {
    enum skd_status status;
    int number;
    const char *name;
    bool retryable;
    const char *hint;
};

/* Never NULL: what has no row of its own is SKD_INTERNAL. */
const struct skd_error_entry *skd_error_entry(enum skd_status status);
const struct skd_error_entry *skd_error_entry_by_number(int number);

#endif
