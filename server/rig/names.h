/* Names that can be looked up: none empty, none twice, none too long.
 *
 * Stage: rig session. Thread: a worker.
 */
#ifndef SKD_RIG_NAMES_H
#define SKD_RIG_NAMES_H

#include "base/error.h"

#include <stddef.h>

/* Replaces names[0..count-1], heap strings or NULL, in place: missing ones become "<fallback><i>",
 * long ones are cut to SKD_NAME_BYTES_MAX at a character, and one that stands before it already
 * gets "_<i>" (or the next free number). Errors: SKD_NO_MEMORY; names stay the caller's to free. */
SKD_MUST_CHECK enum skd_status skd_names_make_unique(char **names, size_t count,
                                                     const char *fallback, struct skd_error *error);

#endif
