/* URIs as glTF uses them: data URIs and paths beside the file.
 *
 * Stage: rig session and export. Thread: a worker.
 */
#ifndef SKD_RIG_URI_H
#define SKD_RIG_URI_H

#include "base/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

bool skd_uri_is_data(const char *uri);
/* True for "http://...", "blob:..." and the like: nothing that lies beside a file. */
bool skd_uri_has_scheme(const char *uri);

/* Decodes a base64 data URI; *bytes is the caller's to free.
 * Errors: SKD_NOT_GLTF, SKD_UNSUPPORTED (not base64), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_uri_decode_data(const char *uri, uint8_t **bytes, size_t *count,
                                                   struct skd_error *error);

/* Base64 as text. NULL: no memory. */
char *skd_uri_encode_base64(const uint8_t *bytes, size_t count);

/* The path that a relative URI means, percent-decoded: the caller's to free.
 * Errors: SKD_UNSUPPORTED (a scheme, or a way out of the file's folder), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_uri_to_path(const char *uri, char **path,
                                               struct skd_error *error);

/* A file name as a relative URI. NULL: no memory. */
char *skd_uri_from_name(const char *name);

#endif
