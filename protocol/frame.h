/* Bytes on a stream socket, cut into frames or lines.
 *
 * Stage: bytes in -> frame. Thread: the connection's. No sockets here: the caller reads.
 *
 *      0        4             8                16
 *      +--------+-------------+----------------+----------+---------+------------------+
 *      | "SKD1" | u32 json    | u64 tail bytes | JSON     | 0..7 x  | tail: the arrays |
 *      |        |     bytes   |                |          | padding | of `buffers`     |
 *      +--------+-------------+----------------+----------+---------+------------------+
 *      little-endian; the tail begins at a multiple of 8 from the start of the frame
 *
 * A connection whose first byte is '{' speaks lines instead: one JSON message, then '\n'. The
 * limit on a line is for what a daemon reads; answers in lines may be longer, so a client that
 * reads with this speaks frames.
 */
#ifndef SKD_PROTOCOL_FRAME_H
#define SKD_PROTOCOL_FRAME_H

#include "base/error.h"

#include <stddef.h>
#include <stdint.h>

enum { SKD_FRAME_HEADER_BYTES = 16 };

enum skd_wire_mode { SKD_WIRE_UNKNOWN, SKD_WIRE_FRAMES, SKD_WIRE_LINES };

/* One received message, still bytes. The memory is one block; free `block` with free(). */
struct skd_frame {
    unsigned char *block;
    const char *json;
    size_t json_bytes;
    const unsigned char *tail; /* 8-aligned; NULL when empty */
    size_t tail_bytes;
};

/* Collects bytes into frames. Reading goes straight into the frame's own block: ask for space
 * with skd_reader_space, read into it, then tell how much came with skd_reader_advance. */
struct skd_frame_reader {
    enum skd_wire_mode mode;
    unsigned char head[SKD_FRAME_HEADER_BYTES]; /* the header until it is whole */
    unsigned char *block;                       /* the frame, or the line so far */
    size_t used;                                /* bytes of head, or of block, that are there */
    size_t wanted;                              /* bytes of the whole frame; line mode: allocated */
    size_t start;                               /* line mode: bytes of lines that were taken */
    size_t scanned;                             /* line mode: bytes known to hold no newline */
    size_t bytes_max;                           /* of a message; 0: what the protocol allows */
    uint32_t json_bytes;
    uint64_t tail_bytes;
};

void skd_reader_init(struct skd_frame_reader *reader);
void skd_reader_finish(struct skd_frame_reader *reader);

/* Refuses messages of more than `bytes` from the next one on, header or newline included; 0: what
 * the protocol allows. */
void skd_reader_limit(struct skd_frame_reader *reader, size_t bytes);

/* Bytes of the frame that is coming in, once its header is whole; 0 before that, and for lines. */
size_t skd_reader_announced(const struct skd_frame_reader *reader);

/* Where the next bytes go, at least one. Errors: SKD_NO_MEMORY, also when a line that came could
 * not be taken for lack of it; the stream cannot be followed after an error. */
SKD_MUST_CHECK enum skd_status skd_reader_space(struct skd_frame_reader *reader,
                                                unsigned char **space, size_t *space_bytes,
                                                struct skd_error *error);

/* `bytes` of the space now hold data. Errors: SKD_BAD_FRAME (magic), SKD_TOO_LARGE (as soon as the
 * header is whole, before memory is asked for), SKD_NO_MEMORY; the same holds after them. */
SKD_MUST_CHECK enum skd_status skd_reader_advance(struct skd_frame_reader *reader, size_t bytes,
                                                  struct skd_error *error);

/* Takes the next whole message out; false when more bytes are needed. Call until false after each
 * advance (a line-mode read may hold several lines). The caller owns frame->block. */
bool skd_reader_take(struct skd_frame_reader *reader, struct skd_frame *frame);

/* Writes a header for a JSON part and a tail of these sizes. */
void skd_frame_header(unsigned char header[SKD_FRAME_HEADER_BYTES], uint32_t json_bytes,
                      uint64_t tail_bytes);

/* Bytes from the start of a frame to its tail. */
size_t skd_frame_tail_offset(uint32_t json_bytes);

#endif
