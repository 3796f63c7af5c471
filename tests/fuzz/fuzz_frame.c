/* Fuzz target: bytes of a peer to typed requests (protocol/frame.h, message.h, request.h).
 *
 * Input: one byte that says into how large pieces the stream is cut, then the stream. Each piece
 * lies in memory of its own size, as the reader asks for it.
 */
#include "fuzz.h"

#include "protocol/encode.h"
#include "protocol/errors.h"
#include "protocol/request.h"

#include <stdlib.h>
#include <string.h>

/* What was accepted lies within the message, and can be read to its last byte. */
static void walk(const struct skd_message *message)
{
    static volatile unsigned char sink;
    for (int i = 0; i < message->buffer_count; i++) {
        const unsigned char *data = message->buffers[i].data;
        size_t bytes = message->buffers[i].count * skd_dtype_bytes(message->buffers[i].dtype);
        if (bytes > 0)
            sink = (unsigned char)(data[0] ^ data[bytes - 1]);
    }
    (void)sink;
}

/* An error is told in a sentence, which must fit into an answer. */
static void tell(const struct skd_request_id *id, const struct skd_error *error)
{
    struct skd_encoded encoded;
    struct skd_error trouble;
    SKD_ASSERT(error->text[0] != '\0');
    SKD_ASSERT(skd_error_entry(error->status)->status == error->status);
    if (skd_encode_error(SKD_WIRE_LINES, id, error, &encoded, &trouble) == SKD_OK)
        skd_encoded_finish(&encoded);
}

static void decode(struct skd_frame *frame)
{
    struct skd_request request = {0};
    struct skd_error error = {0};
    enum skd_status status = skd_request_decode(frame, &request, &error);
    if (status == SKD_OK)
        walk(&request.message);
    else
        tell(&request.message.id, &error);
    skd_request_finish(&request);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct skd_frame_reader reader;
    struct skd_frame frame;
    struct skd_error error = {0};
    enum skd_status status = SKD_OK;
    if (size == 0)
        return 0;
    size_t piece = data[0] == 0 ? size : data[0];
    skd_reader_init(&reader);
    for (size_t at = 1; at < size && status == SKD_OK;) {
        unsigned char *space;
        size_t bytes;
        status = skd_reader_space(&reader, &space, &bytes, &error);
        if (status != SKD_OK)
            break;
        bytes = bytes < piece ? bytes : piece;
        bytes = bytes < size - at ? bytes : size - at;
        memcpy(space, data + at, bytes);
        at += bytes;
        status = skd_reader_advance(&reader, bytes, &error);
        while (status == SKD_OK && skd_reader_take(&reader, &frame))
            decode(&frame);
    }
    if (status != SKD_OK)
        tell(&(struct skd_request_id){.kind = SKD_ID_NONE}, &error);
    skd_reader_finish(&reader);
    return 0;
}
