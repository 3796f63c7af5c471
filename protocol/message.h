/* Messages as values: what a frame says, checked in form, not yet against a session.
 *
 * Stage: frame -> request. Thread: any; large JSON is parsed by a worker.
 * JSON-RPC 2.0; an array is plain JSON (flat or rows) or {"buffer": i} into the message's tail.
 */
#ifndef SKD_PROTOCOL_MESSAGE_H
#define SKD_PROTOCOL_MESSAGE_H

#include "protocol/frame.h"
#include "protocol/limits.h"

#include <cjson/cJSON.h>

enum skd_dtype { SKD_U8, SKD_U16, SKD_U32, SKD_I32, SKD_F32, SKD_F64, SKD_DTYPE_COUNT };

size_t skd_dtype_bytes(enum skd_dtype dtype);
const char *skd_dtype_name(enum skd_dtype dtype); /* "u8", "u16", "u32", "i32", "f32", "f64" */

/* An array parameter. data is NULL and count 0 when the parameter was not given; an array that was
 * given has data, also when it is empty. */
struct skd_array {
    enum skd_dtype dtype;
    size_t rows;  /* first dimension */
    size_t count; /* elements in all */
    const void *data;
};

/* A request's id: absent for a notification. */
struct skd_request_id {
    enum { SKD_ID_NONE, SKD_ID_NUMBER, SKD_ID_TEXT } kind;
    int64_t number; /* within +-2^53 */
    char text[SKD_ID_BYTES_MAX + 1];
};

/* A parsed message of either direction. Owns the frame's block and the JSON. */
struct skd_message {
    struct skd_frame frame;
    cJSON *json;
    struct skd_request_id id;
    const char *method;  /* borrowed from json; NULL in an answer */
    const cJSON *params; /* an object, or NULL */
    const cJSON *result; /* in an answer */
    const cJSON *error;  /* in an answer that failed */
    int buffer_count;
    struct skd_buffer {
        enum skd_dtype dtype;
        int dimensions;
        uint64_t shape[4];
        size_t count;
        const void *data;
    } buffers[SKD_BUFFERS_MAX];
};

/* Parses a frame into *message and takes the frame's block, also when it fails (message->id is
 * then filled as far as it could be read, so that the error finds its request).
 * Call skd_message_finish in any case. Errors: SKD_BAD_JSON, SKD_BAD_REQUEST, SKD_TOO_LARGE,
 * SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_message_parse(struct skd_frame *frame, struct skd_message *message, struct skd_error *error);
void skd_message_finish(struct skd_message *message);

/* Reads a value as an id: a whole number or a short string. */
bool skd_message_read_id(const cJSON *item, struct skd_request_id *id);

/* Reads an array out of an object of the message: {"buffer": i}, which must have this dtype, or
 * plain JSON, which is converted into *owned (free it; NULL when nothing was made). row_width 0
 * takes a flat list; w > 0 takes rows of w, or a flat list of a multiple of w. A JSON element must
 * fit the dtype (whole, in range; f32 and f64 finite). A missing name gives an empty array. */
SKD_MUST_CHECK enum skd_status skd_message_array(const struct skd_message *message,
                                                 const cJSON *object, const char *name,
                                                 enum skd_dtype dtype, size_t row_width,
                                                 struct skd_array *array, void **owned,
                                                 struct skd_error *error);

#endif
