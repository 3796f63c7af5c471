/* Valid frames and lines, spoilt at random: nothing may crash, leak or be read beyond its end.
 *
 * The order of events is fixed by a seed, so a failure comes again. What can be seen without a
 * sanitizer: an error has its sentence, and arrays that were accepted lie within the tail.
 */
#include "protocol_helpers.h"

#include "protocol/errors.h"
#include "protocol/request.h"

enum { ROUNDS = 100000, STREAM_BYTES = 1024 };

static uint64_t random_state = 0x9E3779B97F4A7C15u;

static size_t below(size_t count)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return (size_t)(random_state % count);
}

#define HEAD "{\"jsonrpc\":\"2.0\",\"id\":3,\"method\":"
#define BUFFERS                                                                                    \
    ",\"buffers\":[{\"dtype\":\"u32\",\"shape\":[4],\"offset\":0},"                                \
    "{\"dtype\":\"f32\",\"shape\":[4,3],\"offset\":16},"                                           \
    "{\"dtype\":\"f64\",\"shape\":[1,4,4],\"offset\":64}]}"

static const char *const seeds[] = {
    HEAD "\"hello\",\"params\":{\"protocol\":{\"min\":1,\"max\":1},\"client\":{\"name\":\"a\"}}}",
    HEAD "\"stroke.apply\",\"params\":{\"session\":\"a\",\"pose\":\"p\",\"vertices\":{\"buffer\":0}"
         ",\"positions\":{\"buffer\":1},\"stiffness\":0.5,\"locked_bones\":[\"x\"]}" BUFFERS,
    HEAD "\"stroke.apply\",\"params\":{\"session\":\"a\",\"pose\":\"p\",\"vertices\":[1,2],"
         "\"positions\":[[1,2,3],[4e-3,5.5,-6]]}}",
    HEAD "\"pose.set\",\"params\":{\"session\":\"a\",\"pose\":\"p\",\"matrices\":{\"buffer\":2}"
         "}" BUFFERS,
    HEAD "\"session.create\",\"params\":{\"positions\":[0,0,0],\"triangles\":[],\"bones\":"
         "{\"names\":[\"\\u00e9\\ud83d\\ude00\"],\"parents\":[-1],\"binds\":[[1,0,0,0],[0,1,0,0],"
         "[0,0,1,0],[0,0,0,1]]},\"influence_offsets\":[0,1],\"influence_joints\":[0],"
         "\"influence_weights\":[1]}}",
    "{\"jsonrpc\":\"2.0\",\"method\":\"cancel\",\"params\":{\"id\":\"x\"}}",
    "{\"jsonrpc\":\"2.0\",\"id\":null,\"error\":{\"code\":-32700,\"message\":\"m\"}}",
};

struct stream {
    unsigned char data[STREAM_BYTES];
    size_t count;
};

/* A frame or two lines out of a random seed. */
static void fill(struct stream *stream)
{
    const char *json = seeds[below(sizeof seeds / sizeof seeds[0])];
    size_t bytes = strlen(json);
    if (below(4) == 0) {
        stream->count = 0;
        for (int i = 0; i < 2; i++) {
            memcpy(stream->data + stream->count, json, bytes);
            stream->data[stream->count + bytes] = '\n';
            stream->count += bytes + 1;
            json = seeds[0];
            bytes = strlen(json);
        }
        return;
    }
    static const unsigned char tail[192];
    struct bytes frame = make_frame(json, bytes, tail, sizeof tail);
    memcpy(stream->data, frame.data, frame.count);
    stream->count = frame.count;
    free(frame.data);
}

/* One small change; most of them in the JSON, few in the header, where a large number costs the
 * sanitizer much time. */
static void spoil(struct stream *stream)
{
    static const char tokens[] = "{}[]\",:0123456789.eE-+\\untrfals \n\r\x80\xC3\xED\xFF";
    size_t from = below(40) == 0 ? 0 : 16;
    size_t at = from + below(stream->count - from);
    switch (below(5)) {
    case 0:
        stream->data[at] ^= (unsigned char)(1u << below(8));
        break;
    case 1:
        stream->data[at] = (unsigned char)tokens[below(sizeof tokens)];
        break;
    case 2: { /* a run written over another place */
        size_t to = from + below(stream->count - from);
        size_t most = stream->count - (at > to ? at : to);
        memmove(stream->data + to, stream->data + at, most < 24 ? most : 24);
        break;
    }
    case 3: /* a byte taken out; the frame's length no longer fits */
        memmove(stream->data + at, stream->data + at + 1, stream->count - at - 1);
        stream->count--;
        break;
    default:
        stream->count = at + 1;
        break;
    }
}

static void check_inside(const struct skd_message *message, const struct skd_array *array)
{
    const unsigned char *data = array->data;
    const unsigned char *tail = message->frame.tail;
    size_t bytes = array->count * skd_dtype_bytes(array->dtype);
    if (tail != NULL && bytes > 0 && data >= tail && data < tail + message->frame.tail_bytes)
        assert_true(bytes <= (size_t)(tail + message->frame.tail_bytes - data));
}

/* Returns whether the request was accepted. */
static bool decode(struct skd_frame *frame)
{
    struct skd_request request;
    struct skd_error error = {0};
    enum skd_status status = skd_request_decode(frame, &request, &error);
    if (status != SKD_OK) {
        assert_int_equal(error.status, status);
        assert_true(error.text[0] != '\0');
        assert_int_not_equal(skd_error_entry(status)->status, SKD_INTERNAL);
    } else if (request.method == SKD_REQUEST_STROKE_APPLY) {
        const struct skd_stroke_params *stroke = &request.params.stroke;
        assert_int_equal(stroke->positions.count, 3 * stroke->vertices.count);
        check_inside(&request.message, &stroke->vertices);
        check_inside(&request.message, &stroke->positions);
    }
    skd_request_finish(&request);
    return status == SKD_OK;
}

/* Feeds a stream in random pieces; returns how many requests were accepted. */
static size_t read_all(const struct stream *stream)
{
    struct skd_frame_reader reader;
    struct skd_frame frame;
    struct skd_error error;
    enum skd_status status = SKD_OK;
    size_t accepted = 0;
    skd_reader_init(&reader);
    for (size_t at = 0; at < stream->count && status == SKD_OK;) {
        size_t piece = 1 + below(stream->count - at);
        at += feed_once(&reader, stream->data + at, piece, &status, &error);
        while (status == SKD_OK && skd_reader_take(&reader, &frame))
            accepted += decode(&frame);
    }
    skd_reader_finish(&reader);
    return accepted;
}

static void test_spoilt_messages(void **state)
{
    (void)state;
    size_t accepted = 0;
    for (int round = 0; round < ROUNDS; round++) {
        struct stream stream;
        fill(&stream);
        for (size_t changes = below(4); changes > 0 && stream.count > 20; changes--)
            spoil(&stream);
        accepted += read_all(&stream);
    }
    /* Both sides of the border were seen: a quarter is not spoilt at all. */
    assert_in_range(accepted, ROUNDS / 8, ROUNDS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_spoilt_messages)};
    return cmocka_run_group_tests_name("protocol_fuzz", tests, NULL, NULL);
}
