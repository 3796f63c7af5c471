/* Messages to bytes and back, in both modes; errors; limits; every allocation made to fail. */
#include "protocol_helpers.h"

#include "base/utf8.h"
#include "protocol/encode.h"
#include "protocol/errors.h"

#include <float.h>
#include <math.h>
#include <stdio.h>

static const enum skd_wire_mode modes[] = {SKD_WIRE_FRAMES, SKD_WIRE_LINES};

/* All the bytes of an encoded message in one piece. */
static struct bytes join(const struct skd_encoded *encoded)
{
    struct bytes bytes = {NULL, encoded->head_bytes};
    for (int i = 0; i < encoded->piece_count; i++)
        bytes.count += encoded->pieces[i].bytes + encoded->pieces[i].padding;
    bytes.data = malloc(bytes.count);
    assert_non_null(bytes.data);
    memcpy(bytes.data, encoded->head, encoded->head_bytes);
    size_t used = encoded->head_bytes;
    for (int i = 0; i < encoded->piece_count; i++) {
        const struct skd_piece *piece = &encoded->pieces[i];
        memcpy(bytes.data + used, piece->data, piece->bytes);
        memcpy(bytes.data + used + piece->bytes, skd_zeros, piece->padding);
        used += piece->bytes + piece->padding;
    }
    return bytes;
}

/* Sends an encoded message through a reader and parses it. */
static void receive(struct skd_encoded *encoded, struct skd_message *message)
{
    struct skd_frame_reader reader;
    struct skd_frame frame;
    struct skd_error error;
    struct bytes bytes = join(encoded);
    skd_reader_init(&reader);
    feed(&reader, bytes.data, bytes.count);
    assert_true(skd_reader_take(&reader, &frame));
    assert_int_equal(skd_message_parse(&frame, message, &error), SKD_OK);
    skd_reader_finish(&reader);
    free(bytes.data);
    skd_encoded_finish(encoded);
}

static void check_array(const struct skd_message *message, const cJSON *object,
                        const struct skd_array_out *sent)
{
    struct skd_array array;
    struct skd_error error;
    void *owned;
    size_t count = sent->rows * (sent->columns == 0 ? 1 : sent->columns);
    assert_int_equal(skd_message_array(message, object, sent->name, sent->dtype, sent->columns,
                                       &array, &owned, &error),
                     SKD_OK);
    assert_int_equal(array.rows, sent->rows);
    assert_int_equal(array.count, count);
    assert_non_null(array.data);
    if (count > 0)
        assert_memory_equal(array.data, sent->data, count * skd_dtype_bytes(sent->dtype));
    free(owned);
}

static uint64_t next_random(uint64_t *state)
{
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    return *state;
}

enum { NUMBERS = 3000 };

/* Numbers that are hard to write: random bits, the smallest, the largest, minus zero. */
static void fill_hard_numbers(float *f32, double *f64)
{
    uint64_t state = 88172645463325252u;
    for (size_t i = 0; i < NUMBERS; i++) {
        do {
            uint32_t bits = (uint32_t)next_random(&state);
            memcpy(&f32[i], &bits, sizeof bits);
        } while (!isfinite(f32[i]));
        do {
            uint64_t bits = next_random(&state);
            memcpy(&f64[i], &bits, sizeof bits);
        } while (!isfinite(f64[i]));
    }
    const float hard32[] = {0.0f, -0.0f, FLT_MAX, -FLT_MAX, FLT_MIN, FLT_TRUE_MIN, 0.1f};
    const double hard64[] = {0.0, -0.0, DBL_MAX, -DBL_MAX, DBL_MIN, DBL_TRUE_MIN, 0.1};
    memcpy(f32, hard32, sizeof hard32);
    memcpy(f64, hard64, sizeof hard64);
}

static void test_arrays_come_back_bit_by_bit(void **state)
{
    (void)state;
    static float f32[NUMBERS];
    static double f64[NUMBERS];
    const uint8_t u8[5] = {0, 1, 255, 7, 8};
    const uint16_t u16[6] = {0, 65535, 1, 2, 3, 4};
    const uint32_t u32[3] = {0, UINT32_MAX, 77};
    const int32_t i32[3] = {INT32_MIN, INT32_MAX, -1};
    fill_hard_numbers(f32, f64);
    const struct skd_array_out arrays[SKD_ARRAYS_MAX] = {
        {"u8", SKD_U8, 5, 0, u8},       {"u16", SKD_U16, 3, 2, u16},
        {"none", SKD_F32, 0, 3, NULL},  {"u32", SKD_U32, 3, 0, u32},
        {"i32", SKD_I32, 1, 3, i32},    {"f32", SKD_F32, NUMBERS / 3, 3, f32},
        {"flat", SKD_F32, 999, 0, f32}, {"f64", SKD_F64, NUMBERS / 16, 16, f64},
    };
    const struct skd_request_id id = {.kind = SKD_ID_TEXT, .text = "caf\xC3\xA9 \"1\""};
    for (size_t m = 0; m < 2; m++) {
        struct skd_encoded encoded;
        struct skd_message message;
        struct skd_error error;
        cJSON *body = cJSON_CreateObject();
        cJSON_AddStringToObject(body, "name", "a\n\"b\"");
        assert_int_equal(
            skd_encode_answer(modes[m], &id, body, arrays, SKD_ARRAYS_MAX, &encoded, &error),
            SKD_OK);
        assert_true(modes[m] == SKD_WIRE_FRAMES || encoded.piece_count == 0);
        receive(&encoded, &message);
        assert_int_equal(message.id.kind, SKD_ID_TEXT);
        assert_string_equal(message.id.text, id.text);
        assert_null(message.method);
        assert_non_null(message.result);
        for (int i = 0; i < SKD_ARRAYS_MAX; i++)
            check_array(&message, message.result, &arrays[i]);
        assert_string_equal(cJSON_GetObjectItemCaseSensitive(message.result, "name")->valuestring,
                            "a\n\"b\"");
        skd_message_finish(&message);
    }
}

static void test_frames_borrow_their_arrays(void **state)
{
    (void)state;
    const float weights[6] = {0.5f, 0.5f, 1.0f, 0.0f, 0.25f, 0.75f};
    const struct skd_array_out array = {"weights", SKD_F32, 3, 2, weights};
    const struct skd_request_id id = {.kind = SKD_ID_NUMBER, .number = -3};
    struct skd_encoded encoded;
    struct skd_error error;
    assert_int_equal(skd_encode_answer(SKD_WIRE_FRAMES, &id, NULL, &array, 1, &encoded, &error),
                     SKD_OK);
    assert_int_equal(encoded.piece_count, 1);
    assert_ptr_equal(encoded.pieces[0].data, weights);
    assert_int_equal(encoded.pieces[0].bytes, 24);
    assert_int_equal(encoded.pieces[0].padding, 0);
    static const char json[] =
        "{\"jsonrpc\":\"2.0\",\"id\":-3,\"result\":{\"weights\":{\"buffer\":0}},"
        "\"buffers\":[{\"dtype\":\"f32\",\"shape\":[3,2],\"offset\":0}]}";
    struct bytes expected = make_frame(json, sizeof json - 1, weights, sizeof weights);
    struct bytes written = join(&encoded);
    assert_int_equal(written.count, expected.count);
    assert_memory_equal(written.data, expected.data, expected.count);
    free(written.data);
    free(expected.data);
    skd_encoded_finish(&encoded);
}

static void test_lines_are_text(void **state)
{
    (void)state;
    const float numbers[4] = {0.1f, NAN, INFINITY, -2.0f};
    const struct skd_array_out arrays[] = {{"a", SKD_F32, 2, 2, numbers},
                                           {"b", SKD_F32, 4, 0, numbers},
                                           {"c", SKD_F32, 0, 0, numbers}};
    static const char expected[] =
        "{\"jsonrpc\":\"2.0\",\"method\":\"m\",\"params\":{\"a\":[[0.100000001,null],[null,-2]],"
        "\"b\":[0.100000001,null,null,-2],\"c\":[]}}\n";
    struct skd_encoded encoded;
    struct skd_error error;
    assert_int_equal(
        skd_encode_notification(SKD_WIRE_UNKNOWN, "m", NULL, arrays, 3, &encoded, &error), SKD_OK);
    assert_int_equal(encoded.head_bytes, sizeof expected - 1);
    assert_memory_equal(encoded.head, expected, sizeof expected - 1);
    skd_encoded_finish(&encoded);
}

static void test_requests_and_notifications(void **state)
{
    (void)state;
    for (size_t m = 0; m < 2; m++) {
        struct skd_encoded encoded;
        struct skd_message message;
        struct skd_error error;
        assert_int_equal(skd_encode_request(modes[m], INT64_C(9007199254740991), "ping", NULL, NULL,
                                            0, &encoded, &error),
                         SKD_OK);
        receive(&encoded, &message);
        assert_string_equal(message.method, "ping");
        assert_int_equal(message.id.kind, SKD_ID_NUMBER);
        assert_true(message.id.number == INT64_C(9007199254740991));
        assert_int_equal(message.buffer_count, 0);
        skd_message_finish(&message);
        assert_int_equal(skd_encode_notification(modes[m], "bye", NULL, NULL, 0, &encoded, &error),
                         SKD_OK);
        receive(&encoded, &message);
        assert_string_equal(message.method, "bye");
        assert_int_equal(message.id.kind, SKD_ID_NONE);
        assert_non_null(message.params);
        skd_message_finish(&message);
    }
}

static void test_errors_carry_the_registry(void **state)
{
    (void)state;
    const struct skd_request_id ids[] = {
        {.kind = SKD_ID_NONE}, {.kind = SKD_ID_NUMBER, .number = 4}, {.kind = SKD_ID_TEXT}};
    for (int status = SKD_OK + 1; status < SKD_STATUS_COUNT; status++) {
        const struct skd_error_entry *entry = skd_error_entry((enum skd_status)status);
        const struct skd_request_id *id = &ids[status % 3];
        struct skd_error failure;
        struct skd_encoded encoded;
        struct skd_message message;
        struct skd_error error;
        (void)skd_fail(&failure, (enum skd_status)status, "sentence %d", status);
        assert_int_equal(skd_encode_error(modes[status % 2], id, &failure, &encoded, &error),
                         SKD_OK);
        receive(&encoded, &message);
        assert_int_equal(message.id.kind, id->kind);
        const cJSON *data = cJSON_GetObjectItemCaseSensitive(message.error, "data");
        assert_true(cJSON_GetObjectItemCaseSensitive(message.error, "code")->valuedouble ==
                    entry->number);
        assert_string_equal(cJSON_GetObjectItemCaseSensitive(message.error, "message")->valuestring,
                            failure.text);
        assert_string_equal(cJSON_GetObjectItemCaseSensitive(data, "name")->valuestring,
                            entry->name);
        assert_string_equal(cJSON_GetObjectItemCaseSensitive(data, "hint")->valuestring,
                            entry->hint);
        assert_int_equal(cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(data, "retryable")),
                         entry->retryable);
        skd_message_finish(&message);
    }
}

static void test_errors_are_utf8(void **state)
{
    (void)state;
    struct skd_error failure;
    char long_text[600];
    for (size_t i = 0; i + 3 < sizeof long_text; i += 3)
        memcpy(long_text + i, "\xE2\x82\xAC", 3);
    long_text[597] = '\0';
    const char *const texts[] = {"cut \xE2\x82", "\xFF\xFE", long_text};
    const char *const starts[] = {"cut ??", "??", "\xE2\x82\xAC"};
    for (size_t i = 0; i < 3; i++) {
        struct skd_encoded encoded;
        struct skd_message message;
        struct skd_error error;
        const struct skd_request_id id = {.kind = SKD_ID_NUMBER};
        (void)skd_fail(&failure, SKD_BAD_PARAMS, "%s", texts[i]);
        assert_int_equal(skd_encode_error(SKD_WIRE_LINES, &id, &failure, &encoded, &error), SKD_OK);
        receive(&encoded, &message); /* which checks the UTF-8 */
        const char *text = cJSON_GetObjectItemCaseSensitive(message.error, "message")->valuestring;
        assert_memory_equal(text, starts[i], strlen(starts[i]));
        skd_message_finish(&message);
    }
}

/* An answer with an array of bytes that nobody reads. */
static enum skd_status encode_bytes(enum skd_wire_mode mode, size_t rows, size_t *head_bytes)
{
    static const unsigned char one;
    const struct skd_array_out array = {"a", SKD_U8, rows, 0, &one};
    const struct skd_request_id id = {.kind = SKD_ID_NUMBER};
    struct skd_encoded encoded;
    struct skd_error error;
    enum skd_status status = skd_encode_answer(mode, &id, NULL, &array, 1, &encoded, &error);
    *head_bytes = encoded.head_bytes;
    skd_encoded_finish(&encoded);
    return status;
}

static void test_sizes_have_limits(void **state)
{
    (void)state;
    size_t head_bytes;
    size_t ignored;
    assert_int_equal(encode_bytes(SKD_WIRE_FRAMES, SKD_FRAME_BYTES_MAX - 1000, &head_bytes),
                     SKD_OK);
    size_t most = SKD_FRAME_BYTES_MAX - head_bytes;
    assert_int_equal(encode_bytes(SKD_WIRE_FRAMES, most - 1, &ignored), SKD_OK);
    assert_int_equal(encode_bytes(SKD_WIRE_FRAMES, most, &ignored), SKD_OK);
    assert_int_equal(encode_bytes(SKD_WIRE_FRAMES, most + 1, &ignored), SKD_TOO_LARGE);
    assert_int_equal(encode_bytes(SKD_WIRE_FRAMES, SIZE_MAX, &ignored), SKD_TOO_LARGE);
    assert_int_equal(encode_bytes(SKD_WIRE_LINES, SKD_FRAME_BYTES_MAX, &ignored), SKD_TOO_LARGE);
    assert_int_equal(encode_bytes(SKD_WIRE_LINES, SIZE_MAX, &ignored), SKD_TOO_LARGE);
    /* The JSON part of a frame: {"jsonrpc":"2.0","id":0,"result":{"a":"..."}} */
    size_t frame = strlen("{\"jsonrpc\":\"2.0\",\"id\":0,\"result\":{\"a\":\"\"}}");
    for (size_t bytes = SKD_JSON_BYTES_MAX - 1; bytes <= SKD_JSON_BYTES_MAX + 1; bytes++) {
        const struct skd_request_id id = {.kind = SKD_ID_NUMBER};
        struct skd_encoded encoded;
        struct skd_error error;
        char *text = malloc(bytes - frame + 1);
        assert_non_null(text);
        memset(text, 'x', bytes - frame);
        text[bytes - frame] = '\0';
        for (size_t m = 0; m < 2; m++) {
            cJSON *body = cJSON_CreateObject();
            cJSON_AddStringToObject(body, "a", text);
            bool fits = modes[m] == SKD_WIRE_LINES || bytes <= SKD_JSON_BYTES_MAX;
            assert_int_equal(skd_encode_answer(modes[m], &id, body, NULL, 0, &encoded, &error),
                             fits ? SKD_OK : SKD_TOO_LARGE);
            skd_encoded_finish(&encoded);
        }
        free(text);
    }
}

/* ---- memory that fails ---- */

static int allocations_left;
static int live_allocations;

static void *failing_malloc(size_t bytes)
{
    if (allocations_left == 0)
        return NULL;
    allocations_left--;
    live_allocations++;
    return malloc(bytes);
}

static void counting_free(void *memory)
{
    live_allocations -= memory != NULL;
    free(memory);
}

static enum skd_status encode_something(enum skd_wire_mode mode, bool is_error)
{
    static const uint32_t numbers[1000] = {1, 2, 3};
    const struct skd_array_out arrays[] = {{"a", SKD_U32, 1000, 0, numbers},
                                           {"b", SKD_U32, 1, 3, numbers}};
    const struct skd_request_id id = {.kind = SKD_ID_TEXT, .text = "x"};
    struct skd_encoded encoded;
    struct skd_error error = {0};
    struct skd_error failure;
    (void)skd_fail(&failure, SKD_BUSY, "busy");
    enum skd_status status = is_error
                                 ? skd_encode_error(mode, &id, &failure, &encoded, &error)
                                 : skd_encode_answer(mode, &id, NULL, arrays, 2, &encoded, &error);
    assert_int_equal(error.status, status);
    skd_encoded_finish(&encoded);
    return status;
}

static void test_every_allocation_may_fail(void **state)
{
    (void)state;
    cJSON_Hooks hooks = {failing_malloc, counting_free};
    for (int kind = 0; kind < 4; kind++) {
        enum skd_status status = SKD_NO_MEMORY;
        int most = 0;
        cJSON_InitHooks(&hooks);
        for (; status != SKD_OK; most++) {
            assert_true(most < 1000);
            allocations_left = most;
            live_allocations = 0;
            status = encode_something(modes[kind % 2], kind >= 2);
            assert_true(status == SKD_OK || status == SKD_NO_MEMORY);
            assert_int_equal(live_allocations, 0);
        }
        cJSON_InitHooks(NULL);
        assert_true(most > 10); /* they were counted at all */
    }
}

static void test_every_allocation_of_a_parse_may_fail(void **state)
{
    (void)state;
    static const char json[] = "{\"jsonrpc\":\"2.0\",\"id\":\"x\",\"method\":\"m\",\"params\":"
                               "{\"a\":[1,\"two\",[true,null,{}]]}}";
    cJSON_Hooks hooks = {failing_malloc, counting_free};
    enum skd_status status = SKD_NO_MEMORY;
    for (int most = 0; status != SKD_OK; most++) {
        struct skd_frame frame = frame_of(json, sizeof json - 1, NULL, 0);
        struct skd_message message;
        struct skd_error error;
        assert_true(most < 1000);
        cJSON_InitHooks(&hooks);
        allocations_left = most;
        live_allocations = 0;
        status = skd_message_parse(&frame, &message, &error);
        skd_message_finish(&message);
        cJSON_InitHooks(NULL);
        assert_true(status == SKD_OK || status == SKD_NO_MEMORY);
        assert_int_equal(live_allocations, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_arrays_come_back_bit_by_bit),
        cmocka_unit_test(test_frames_borrow_their_arrays),
        cmocka_unit_test(test_lines_are_text),
        cmocka_unit_test(test_requests_and_notifications),
        cmocka_unit_test(test_errors_carry_the_registry),
        cmocka_unit_test(test_errors_are_utf8),
        cmocka_unit_test(test_sizes_have_limits),
        cmocka_unit_test(test_every_allocation_may_fail),
        cmocka_unit_test(test_every_allocation_of_a_parse_may_fail),
    };
    return cmocka_run_group_tests_name("protocol_encode", tests, NULL, NULL);
}
