/* Cutting a byte stream into frames and lines; see frame.h.
 *
 * Every size that a peer announces is checked when the header is whole, before any memory is asked
 * for. The block of a frame is then one malloc that nobody touches: a header that announces
 * 512 MiB takes address space, and memory only as the bytes come.
 *
 * Line mode keeps a buffer that doubles up to the limit of a line:
 *
 *     block  +--------------+---------------------+-----------------+
 *            | taken        | lines, last partial | space           |
 *            +--------------+---------------------+-----------------+
 *            0              start                 used              wanted
 *
 * A line is copied into a block of its own when it is taken. What is left moves to the front once
 * before the next read, so the work stays linear in the bytes, however short the lines.
 */
#include "protocol/frame.h"

#include "protocol/limits.h"

#include <stdlib.h>
#include <string.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "arrays are sent as they lie in memory");

static const unsigned char MAGIC[4] = {'S', 'K', 'D', '1'};
static const size_t LINE_BYTES_FIRST = 4096;

void skd_reader_init(struct skd_frame_reader *reader)
{
    *reader = (struct skd_frame_reader){0};
}

void skd_reader_finish(struct skd_frame_reader *reader)
{
    free(reader->block);
    *reader = (struct skd_frame_reader){0};
}

void skd_reader_limit(struct skd_frame_reader *reader, size_t bytes)
{
    reader->bytes_max = bytes;
}

size_t skd_reader_announced(const struct skd_frame_reader *reader)
{
    return reader->mode == SKD_WIRE_FRAMES && reader->block != NULL ? reader->wanted : 0;
}

/* Bytes that a line may have, its newline included. */
static size_t line_bytes_max(const struct skd_frame_reader *reader)
{
    return reader->bytes_max > 0 && reader->bytes_max < SKD_LINE_BYTES_MAX ? reader->bytes_max
                                                                           : SKD_LINE_BYTES_MAX;
}

size_t skd_frame_tail_offset(uint32_t json_bytes)
{
    return (SKD_FRAME_HEADER_BYTES + (size_t)json_bytes + 7) & ~(size_t)7;
}

void skd_frame_header(unsigned char header[SKD_FRAME_HEADER_BYTES], uint32_t json_bytes,
                      uint64_t tail_bytes)
{
    memcpy(header, MAGIC, 4);
    memcpy(header + 4, &json_bytes, 4);
    memcpy(header + 8, &tail_bytes, 8);
}

/* Makes the line buffer as it has to be for the next read: the partial line at the front, and
 * room behind it. skd_reader_advance has refused a line that fills the largest buffer. */
static enum skd_status make_line_space(struct skd_frame_reader *reader, struct skd_error *error)
{
    if (reader->start > 0) {
        memmove(reader->block, reader->block + reader->start, reader->used - reader->start);
        reader->used -= reader->start;
        reader->scanned -= reader->start;
        reader->start = 0;
    }
    if (reader->used == 0 && reader->wanted > LINE_BYTES_FIRST) {
        /* A long line was taken; the next is probably short. */
        free(reader->block);
        reader->block = NULL;
        reader->wanted = 0;
    }
    if (reader->used < reader->wanted)
        return SKD_OK;
    size_t wanted = reader->wanted == 0 ? LINE_BYTES_FIRST : 2 * reader->wanted;
    if (wanted > line_bytes_max(reader))
        wanted = line_bytes_max(reader);
    unsigned char *block = realloc(reader->block, wanted);
    if (block == NULL)
        return skd_fail_memory(error, "a line");
    reader->block = block;
    reader->wanted = wanted;
    return SKD_OK;
}

enum skd_status skd_reader_space(struct skd_frame_reader *reader, unsigned char **space,
                                 size_t *space_bytes, struct skd_error *error)
{
    if (reader->mode == SKD_WIRE_LINES) {
        /* A newline that is known and still there: taking that line found no memory. */
        if (reader->scanned < reader->used)
            return skd_fail_memory(error, "a line");
        enum skd_status status = make_line_space(reader, error);
        if (status != SKD_OK)
            return status;
    }
    if (reader->block == NULL) {
        *space = reader->head + reader->used;
        *space_bytes = SKD_FRAME_HEADER_BYTES - reader->used;
    } else {
        *space = reader->block + reader->used;
        *space_bytes = reader->wanted - reader->used;
    }
    SKD_ASSERT(*space_bytes > 0); /* a whole frame waits and was not taken */
    return SKD_OK;
}

/* Finds the next newline from `scanned` on, and leaves `scanned` at it, or at the end. */
static bool find_newline(struct skd_frame_reader *reader)
{
    if (reader->scanned == reader->used)
        return false;
    const unsigned char *from = reader->block + reader->scanned;
    const unsigned char *newline = memchr(from, '\n', reader->used - reader->scanned);
    reader->scanned = newline == NULL ? reader->used : (size_t)(newline - reader->block);
    return newline != NULL;
}

static enum skd_status advance_line(struct skd_frame_reader *reader, struct skd_error *error)
{
    const size_t most = line_bytes_max(reader);
    if (!find_newline(reader) && reader->used - reader->start >= most)
        return skd_fail(error, SKD_TOO_LARGE, "a line has more than %zu bytes; %s", most,
                        most < SKD_LINE_BYTES_MAX ? "send hello first"
                                                  : "send frames for large messages");
    return SKD_OK;
}

/* The first bytes say how the peer speaks. */
static enum skd_status choose_mode(struct skd_frame_reader *reader, struct skd_error *error)
{
    if (reader->head[0] != '{') {
        reader->mode = SKD_WIRE_FRAMES;
        return SKD_OK;
    }
    size_t used = reader->used;
    reader->mode = SKD_WIRE_LINES;
    reader->used = 0;
    enum skd_status status = make_line_space(reader, error);
    if (status != SKD_OK)
        return status;
    memcpy(reader->block, reader->head, used);
    reader->used = used;
    return SKD_OK;
}

/* The header is whole: checks what it announces and gets the block. */
static enum skd_status begin_frame(struct skd_frame_reader *reader, struct skd_error *error)
{
    memcpy(&reader->json_bytes, reader->head + 4, 4);
    memcpy(&reader->tail_bytes, reader->head + 8, 8);
    if (reader->json_bytes > SKD_JSON_BYTES_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "a frame announces %u bytes of JSON, and the limit is %u; send arrays as "
                        "buffers",
                        reader->json_bytes, SKD_JSON_BYTES_MAX);
    size_t tail_offset = skd_frame_tail_offset(reader->json_bytes);
    if (reader->tail_bytes > SKD_FRAME_BYTES_MAX - tail_offset)
        return skd_fail(error, SKD_TOO_LARGE,
                        "a frame announces a tail of %llu bytes, and a whole frame may have %llu; "
                        "send it in parts",
                        (unsigned long long)reader->tail_bytes,
                        (unsigned long long)SKD_FRAME_BYTES_MAX);
    size_t wanted = tail_offset + (size_t)reader->tail_bytes;
    if (reader->bytes_max > 0 && wanted > reader->bytes_max)
        return skd_fail(error, SKD_TOO_LARGE,
                        "a frame announces %zu bytes, and before hello the limit is %zu", wanted,
                        reader->bytes_max);
    unsigned char *block = malloc(wanted);
    if (block == NULL)
        return skd_fail_memory(error, "a frame");
    memcpy(block, reader->head, SKD_FRAME_HEADER_BYTES);
    reader->block = block;
    reader->wanted = wanted;
    return SKD_OK;
}

static enum skd_status advance_header(struct skd_frame_reader *reader, struct skd_error *error)
{
    size_t magic_bytes = reader->used < sizeof MAGIC ? reader->used : sizeof MAGIC;
    if (memcmp(reader->head, MAGIC, magic_bytes) != 0)
        return skd_fail(error, SKD_BAD_FRAME,
                        "these bytes are no frame: it begins with SKD1, and a line with {");
    if (reader->used < SKD_FRAME_HEADER_BYTES)
        return SKD_OK;
    return begin_frame(reader, error);
}

enum skd_status skd_reader_advance(struct skd_frame_reader *reader, size_t bytes,
                                   struct skd_error *error)
{
    if (bytes == 0)
        return SKD_OK;
    reader->used += bytes;
    if (reader->mode == SKD_WIRE_UNKNOWN) {
        enum skd_status status = choose_mode(reader, error);
        if (status != SKD_OK)
            return status;
    }
    if (reader->mode == SKD_WIRE_LINES)
        return advance_line(reader, error);
    return reader->block == NULL ? advance_header(reader, error) : SKD_OK;
}

/* Takes the line that ends at `scanned`; an empty one gives no frame. False: no memory. */
static bool take_line(struct skd_frame_reader *reader, struct skd_frame *frame)
{
    const unsigned char *line = reader->block + reader->start;
    size_t bytes = reader->scanned - reader->start;
    if (bytes > 0 && line[bytes - 1] == '\r')
        bytes--;
    *frame = (struct skd_frame){0};
    if (bytes > 0) {
        frame->block = malloc(bytes);
        if (frame->block == NULL)
            return false;
        memcpy(frame->block, line, bytes);
        frame->json = (const char *)frame->block;
        frame->json_bytes = bytes;
    }
    reader->scanned++;
    reader->start = reader->scanned;
    return true;
}

bool skd_reader_take(struct skd_frame_reader *reader, struct skd_frame *frame)
{
    if (reader->mode == SKD_WIRE_LINES) {
        while (find_newline(reader)) {
            if (!take_line(reader, frame))
                return false;
            if (frame->block != NULL)
                return true;
        }
        return false;
    }
    if (reader->block == NULL || reader->used < reader->wanted)
        return false;
    *frame = (struct skd_frame){
        .block = reader->block,
        .json = (const char *)reader->block + SKD_FRAME_HEADER_BYTES,
        .json_bytes = reader->json_bytes,
        .tail = reader->tail_bytes == 0 ? NULL
                                        : reader->block + skd_frame_tail_offset(reader->json_bytes),
        .tail_bytes = (size_t)reader->tail_bytes,
    };
    *reader = (struct skd_frame_reader){.mode = SKD_WIRE_FRAMES, .bytes_max = reader->bytes_max};
    return true;
}
