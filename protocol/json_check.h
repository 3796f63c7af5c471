/* The grammar of JSON, checked before the JSON library builds anything of it.
 *
 * Stage: frame -> request. Thread: any. Allocates nothing.
 * The library is lenient (it nests a thousand deep, takes control characters for white space and
 * ends a string at a NUL), and it cannot tell a mistake from a lack of memory. After this check
 * the text is RFC 8259 to the letter, and only memory can fail.
 */
#ifndef SKD_PROTOCOL_JSON_CHECK_H
#define SKD_PROTOCOL_JSON_CHECK_H

#include "base/error.h"

#include <stddef.h>

/* One JSON value and white space around it, in UTF-8, nested at most SKD_JSON_NESTING_MAX deep.
 * Stricter than the RFC in three things: no NUL in a string (not as \u0000 either), no half of a
 * surrogate pair, no number of more than 63 characters. Errors: SKD_BAD_JSON with the byte. */
SKD_MUST_CHECK enum skd_status skd_json_check(const char *text, size_t bytes,
                                              struct skd_error *error);

#endif
