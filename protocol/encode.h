/* Messages to bytes, either as a frame whose tail is borrowed memory, or as a line of text.
 *
 * Stage: result -> reply -> bytes out. Thread: any. A frame costs its small JSON and no copy of
 * the arrays; a line spells every number out, so large ones are made by a worker.
 */
#ifndef SKD_PROTOCOL_ENCODE_H
#define SKD_PROTOCOL_ENCODE_H

#include "protocol/message.h"

enum { SKD_ARRAYS_MAX = 8 };

/* An array to send; data is borrowed until the bytes are written. columns 0: a flat list. */
struct skd_array_out {
    const char *name; /* its member in result or params */
    enum skd_dtype dtype;
    size_t rows;
    size_t columns;
    const void *data;
};

/* A message ready to be written: the head (header, JSON, padding; or a whole line), then each
 * piece followed by `padding` zero bytes. */
struct skd_encoded {
    unsigned char *head; /* owned, free with skd_encoded_finish */
    size_t head_bytes;
    int piece_count;
    struct skd_piece {
        const void *data;
        size_t bytes;
        size_t padding; /* 0..7, from skd_zeros */
    } pieces[SKD_ARRAYS_MAX];
};

extern const unsigned char skd_zeros[8];

void skd_encoded_finish(struct skd_encoded *encoded);

/* The three shapes of a message. `body` (result or params, an object, may be NULL for {}) is taken
 * over, also on failure; arrays are added to it under their names. SKD_WIRE_UNKNOWN counts as
 * lines. Errors: SKD_NO_MEMORY, also when the body was built in this thread and lacks a member for
 * lack of it (json_memory.h); SKD_TOO_LARGE when a frame or its JSON part would pass its limit,
 * or a line that of a frame (SKD_LINE_BYTES_MAX holds for what the daemon reads, not for answers).
 */
SKD_MUST_CHECK enum skd_status skd_encode_answer(enum skd_wire_mode mode,
                                                 const struct skd_request_id *id, cJSON *body,
                                                 const struct skd_array_out *arrays,
                                                 int array_count, struct skd_encoded *encoded,
                                                 struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_encode_notification(enum skd_wire_mode mode, const char *method,
                                                       cJSON *body,
                                                       const struct skd_array_out *arrays,
                                                       int array_count, struct skd_encoded *encoded,
                                                       struct skd_error *error);
/* The client's side: a request with a number for its id. */
SKD_MUST_CHECK enum skd_status skd_encode_request(enum skd_wire_mode mode, int64_t id,
                                                  const char *method, cJSON *body,
                                                  const struct skd_array_out *arrays,
                                                  int array_count, struct skd_encoded *encoded,
                                                  struct skd_error *error);
/* {code, message, data: {name, retryable, hint}} from the registry. id NONE is sent as null. */
SKD_MUST_CHECK enum skd_status skd_encode_error(enum skd_wire_mode mode,
                                                const struct skd_request_id *id,
                                                const struct skd_error *failure,
                                                struct skd_encoded *encoded,
                                                struct skd_error *error);

/* Writes the id into an object as `name` (number, string, or null). */
bool skd_add_id(cJSON *object, const char *name, const struct skd_request_id *id);

#endif
