/* What the tests of the wire share: frames made by hand, and bytes fed to a reader in pieces.
 * Header only; each test program includes it once. */
#ifndef SKD_TESTS_PROTOCOL_HELPERS_H
#define SKD_TESTS_PROTOCOL_HELPERS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "protocol/frame.h"

/* Bytes on the wire. */
struct bytes {
    unsigned char *data;
    size_t count;
};

/* A frame from its JSON and tail, laid out by PROTOCOL.md and not by our own encoder. */
static inline struct bytes make_frame(const char *json, size_t json_bytes, const void *tail,
                                      size_t tail_bytes)
{
    size_t tail_offset = 16 + (json_bytes + 7) / 8 * 8;
    struct bytes frame = {calloc(1, tail_offset + tail_bytes), tail_offset + tail_bytes};
    assert_non_null(frame.data);
    memcpy(frame.data, "SKD1", 4);
    for (size_t i = 0; i < 4; i++)
        frame.data[4 + i] = (unsigned char)(json_bytes >> (8 * i));
    for (size_t i = 0; i < 8; i++)
        frame.data[8 + i] = (unsigned char)((uint64_t)tail_bytes >> (8 * i));
    memcpy(frame.data + 16, json, json_bytes);
    if (tail_bytes > 0)
        memcpy(frame.data + tail_offset, tail, tail_bytes);
    return frame;
}

/* Feeds as much as the reader takes of data[0..count) in one go; returns how much that was. */
static inline size_t feed_once(struct skd_frame_reader *reader, const unsigned char *data,
                               size_t count, enum skd_status *status, struct skd_error *error)
{
    unsigned char *space;
    size_t space_bytes;
    *status = skd_reader_space(reader, &space, &space_bytes, error);
    if (*status != SKD_OK)
        return 0;
    size_t taken = count < space_bytes ? count : space_bytes;
    memcpy(space, data, taken);
    *status = skd_reader_advance(reader, taken, error);
    return taken;
}

/* Feeds all of it; the reader must accept, and hand out no message. */
static inline void feed(struct skd_frame_reader *reader, const unsigned char *data, size_t count)
{
    struct skd_error error;
    enum skd_status status = SKD_OK;
    while (count > 0) {
        size_t taken = feed_once(reader, data, count, &status, &error);
        assert_int_equal(status, SKD_OK);
        data += taken;
        count -= taken;
    }
}

/* A message as skd_message_parse takes it: a frame in memory of its own. */
static inline struct skd_frame frame_of(const char *json, size_t json_bytes, const void *tail,
                                        size_t tail_bytes)
{
    struct skd_frame_reader reader;
    struct skd_frame frame;
    struct bytes bytes = make_frame(json, json_bytes, tail, tail_bytes);
    skd_reader_init(&reader);
    feed(&reader, bytes.data, bytes.count);
    assert_true(skd_reader_take(&reader, &frame));
    skd_reader_finish(&reader);
    free(bytes.data);
    return frame;
}

#endif
