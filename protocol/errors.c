/* See errors.h. The table is errors.def, read as rows; it is small enough to be searched. */
#include "protocol/errors.h"

#include <stddef.h>

static const struct skd_error_entry entries[] = {
#define X(status, number, name, retryable, hint) {status, number, name, retryable, hint},
#include "protocol/errors.def"
#undef X
};

enum { ENTRY_COUNT = sizeof entries / sizeof entries[0] };

const struct skd_error_entry *skd_error_entry(enum skd_status status)
{
    const struct skd_error_entry *internal = NULL;
    for (size_t i = 0; i < ENTRY_COUNT; i++) {
        if (entries[i].status == status)
            return &entries[i];
        if (entries[i].status == SKD_INTERNAL)
            internal = &entries[i];
    }
    return internal;
}

const struct skd_error_entry *skd_error_entry_by_number(int number)
{
    for (size_t i = 0; i < ENTRY_COUNT; i++)
        if (entries[i].number == number)
            return &entries[i];
    return skd_error_entry(SKD_INTERNAL);
}
