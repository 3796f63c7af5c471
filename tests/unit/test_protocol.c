/* Frames, lines and messages: every split, every limit, and what must be refused. */
#include "protocol_helpers.h"

#include "base/utf8.h"
#include "protocol/errors.h"
#include "protocol/message.h"

#include <stdio.h>

/* ---- errors.def ---- */

static void test_every_status_has_one_row(void **state)
{
    (void)state;
    static const enum skd_status listed[] = {
#define X(status, number, name, retryable, hint) status,
#include "protocol/errors.def"
#undef X
    };
    static const int numbers[] = {
#define X(status, number, name, retryable, hint) number,
#include "protocol/errors.def"
#undef X
    };
    static const char *const names[] = {
#define X(status, number, name, retryable, hint) name,
#include "protocol/errors.def"
#undef X
    };
    size_t count = sizeof listed / sizeof listed[0];
    int rows[SKD_STATUS_COUNT] = {0};
    for (size_t i = 0; i < count; i++) {
        rows[listed[i]]++;
        for (size_t j = 0; j < i; j++) {
            assert_int_not_equal(numbers[i], numbers[j]);
            assert_string_not_equal(names[i], names[j]);
        }
        assert_int_equal(skd_error_entry(listed[i])->number, numbers[i]);
        assert_int_equal(skd_error_entry_by_number(numbers[i])->status, listed[i]);
    }
    assert_int_equal(rows[SKD_OK], 0);
    for (int status = SKD_OK + 1; status < SKD_STATUS_COUNT; status++)
        assert_int_equal(rows[status], 1);
    assert_int_equal(skd_error_entry(SKD_OK)->status, SKD_INTERNAL);
    assert_int_equal(skd_error_entry_by_number(12345)->status, SKD_INTERNAL);
}

/* ---- frames ---- */

static const char JSON[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\"}";
enum { JSON_BYTES = sizeof JSON - 1 };

static void check_taken(struct skd_frame_reader *reader, const char *json, size_t json_bytes,
                        const void *tail, size_t tail_bytes)
{
    struct skd_frame frame;
    assert_true(skd_reader_take(reader, &frame));
    assert_int_equal(frame.json_bytes, json_bytes);
    assert_memory_equal(frame.json, json, json_bytes);
    assert_int_equal(frame.tail_bytes, tail_bytes);
    if (tail_bytes == 0) {
        assert_null(frame.tail);
    } else {
        assert_int_equal((uintptr_t)frame.tail % 8, 0);
        assert_memory_equal(frame.tail, tail, tail_bytes);
    }
    free(frame.block);
}

static void test_frames_split_anywhere(void **state)
{
    (void)state;
    unsigned char tail[21];
    for (size_t i = 0; i < sizeof tail; i++)
        tail[i] = (unsigned char)(200 - i);
    struct bytes first = make_frame(JSON, JSON_BYTES, tail, sizeof tail);
    struct bytes second = make_frame(JSON, JSON_BYTES, NULL, 0);
    /* Two frames in one stream, cut in two at each byte; the second begins unaligned. */
    size_t total = first.count + second.count;
    unsigned char *stream = malloc(total);
    assert_non_null(stream);
    memcpy(stream, first.data, first.count);
    memcpy(stream + first.count, second.data, second.count);
    for (size_t cut = 0; cut <= total; cut++) {
        struct skd_frame_reader reader;
        size_t taken_frames = 0;
        skd_reader_init(&reader);
        for (size_t at = 0; at < total;) {
            struct skd_error error;
            enum skd_status status;
            size_t end = at < cut ? cut : total;
            at += feed_once(&reader, stream + at, end - at, &status, &error);
            assert_int_equal(status, SKD_OK);
            if (at == first.count || at == total) {
                check_taken(&reader, JSON, JSON_BYTES, tail, taken_frames == 0 ? sizeof tail : 0);
                taken_frames++;
            } else {
                struct skd_frame frame;
                assert_false(skd_reader_take(&reader, &frame));
            }
        }
        assert_int_equal(taken_frames, 2);
        assert_int_equal(reader.mode, SKD_WIRE_FRAMES);
        skd_reader_finish(&reader);
    }
    free(stream);
    free(first.data);
    free(second.data);
}

static void test_header_layout(void **state)
{
    (void)state;
    unsigned char header[16];
    const unsigned char expected[16] = {'S', 'K', 'D', '1', 4, 3, 2, 1, 0x88, 0x77, 0x66, 0x55};
    skd_frame_header(header, 0x01020304, 0x55667788);
    assert_memory_equal(header, expected, 16);
    assert_int_equal(skd_frame_tail_offset(0), 16);
    assert_int_equal(skd_frame_tail_offset(1), 24);
    assert_int_equal(skd_frame_tail_offset(8), 24);
    assert_int_equal(skd_frame_tail_offset(9), 32);
}

static enum skd_status feed_header(uint64_t json_bytes, uint64_t tail_bytes)
{
    struct skd_frame_reader reader;
    struct skd_error error;
    enum skd_status status;
    unsigned char header[16];
    skd_frame_header(header, (uint32_t)json_bytes, tail_bytes);
    skd_reader_init(&reader);
    size_t taken = feed_once(&reader, header, sizeof header, &status, &error);
    assert_int_equal(taken, 16);
    /* Nothing but the header is touched; a refused frame gets no memory at all. */
    if (status != SKD_OK)
        assert_null(reader.block);
    skd_reader_finish(&reader);
    return status;
}

static void test_frame_limits(void **state)
{
    (void)state;
    const uint64_t json_max = SKD_JSON_BYTES_MAX;
    const uint64_t tail_max = SKD_FRAME_BYTES_MAX - 16 - 8; /* with one byte of JSON */
    assert_int_equal(feed_header(json_max - 1, 0), SKD_OK);
    assert_int_equal(feed_header(json_max, 0), SKD_OK);
    assert_int_equal(feed_header(json_max + 1, 0), SKD_TOO_LARGE);
    assert_int_equal(feed_header(UINT32_MAX, 0), SKD_TOO_LARGE);
    assert_int_equal(feed_header(1, tail_max - 1), SKD_OK);
    assert_int_equal(feed_header(1, tail_max), SKD_OK);
    assert_int_equal(feed_header(1, tail_max + 1), SKD_TOO_LARGE);
    assert_int_equal(feed_header(json_max, SKD_FRAME_BYTES_MAX - 16 - json_max), SKD_OK);
    assert_int_equal(feed_header(json_max, SKD_FRAME_BYTES_MAX - 15 - json_max), SKD_TOO_LARGE);
    /* Sums that would wrap. */
    assert_int_equal(feed_header(1, UINT64_MAX), SKD_TOO_LARGE);
    assert_int_equal(feed_header(1, UINT64_MAX - 15), SKD_TOO_LARGE);
    assert_int_equal(feed_header(0, 0), SKD_OK);
}

static void test_magic_is_refused_at_its_first_byte(void **state)
{
    (void)state;
    static const char *const streams[] = {"GET ", "skd1", "SKD2", "S{", "\n{", " {", "[", ""};
    for (size_t i = 0; i < sizeof streams / sizeof streams[0]; i++) {
        struct skd_frame_reader reader;
        struct skd_error error;
        enum skd_status status;
        size_t bytes = streams[i][0] == '\0' ? 1 : strlen(streams[i]); /* "": a NUL */
        skd_reader_init(&reader);
        (void)feed_once(&reader, (const unsigned char *)streams[i], bytes, &status, &error);
        assert_int_equal(status, SKD_BAD_FRAME);
        skd_reader_finish(&reader);
    }
}

/* ---- lines ---- */

static void test_lines_split_anywhere(void **state)
{
    (void)state;
    static const char stream[] = "{\"a\":1}\n\r\n\n{\"b\":2}\r\n{\"c\":3}\n{\"d";
    static const char *const lines[] = {"{\"a\":1}", "{\"b\":2}", "{\"c\":3}"};
    size_t total = sizeof stream - 1;
    for (size_t first = 0; first <= total; first++) {
        for (size_t second = first; second <= total; second++) {
            struct skd_frame_reader reader;
            struct skd_frame frame;
            size_t count = 0;
            skd_reader_init(&reader);
            for (size_t at = 0; at < total;) {
                struct skd_error error;
                enum skd_status status;
                size_t end = at < first ? first : at < second ? second : total;
                at += feed_once(&reader, (const unsigned char *)stream + at, end - at, &status,
                                &error);
                assert_int_equal(status, SKD_OK);
                while (skd_reader_take(&reader, &frame)) {
                    assert_true(count < 3);
                    assert_int_equal(frame.json_bytes, strlen(lines[count]));
                    assert_memory_equal(frame.json, lines[count], frame.json_bytes);
                    assert_int_equal(frame.tail_bytes, 0);
                    count++;
                    free(frame.block);
                }
            }
            assert_int_equal(count, 3);
            assert_int_equal(reader.mode, SKD_WIRE_LINES);
            skd_reader_finish(&reader);
        }
    }
}

/* A line of `bytes` bytes, newline included. */
static enum skd_status feed_line(size_t bytes, bool *was_taken)
{
    struct skd_frame_reader reader;
    struct skd_frame frame = {0};
    struct skd_error error;
    enum skd_status status = SKD_OK;
    unsigned char *line = malloc(bytes);
    assert_non_null(line);
    memset(line, ' ', bytes);
    line[0] = '{';
    line[bytes - 2] = '}';
    line[bytes - 1] = '\n';
    skd_reader_init(&reader);
    for (size_t at = 0; at < bytes && status == SKD_OK;)
        at += feed_once(&reader, line + at, bytes - at, &status, &error);
    *was_taken = status == SKD_OK && skd_reader_take(&reader, &frame);
    if (*was_taken)
        assert_int_equal(frame.json_bytes, bytes - 1);
    free(frame.block);
    skd_reader_finish(&reader);
    free(line);
    return status;
}

static void test_line_limits(void **state)
{
    (void)state;
    bool was_taken;
    assert_int_equal(feed_line(SKD_LINE_BYTES_MAX - 1, &was_taken), SKD_OK);
    assert_true(was_taken);
    assert_int_equal(feed_line(SKD_LINE_BYTES_MAX, &was_taken), SKD_OK);
    assert_true(was_taken);
    assert_int_equal(feed_line(SKD_LINE_BYTES_MAX + 1, &was_taken), SKD_TOO_LARGE);
    assert_false(was_taken);
}

static void test_many_short_lines_cost_linear_time(void **state)
{
    (void)state;
    struct skd_frame_reader reader;
    struct skd_frame frame;
    size_t bytes = 3 * (SKD_LINE_BYTES_MAX / 3);
    size_t count = 0;
    unsigned char *lines = malloc(bytes);
    assert_non_null(lines);
    for (size_t i = 0; i < bytes; i += 3)
        memcpy(lines + i, "{}\n", 3);
    skd_reader_init(&reader);
    /* A long line first, so that the buffer is at its largest; moving what is left after each
     * line would be 10^11 bytes. */
    unsigned char *longest = malloc(SKD_LINE_BYTES_MAX);
    assert_non_null(longest);
    memset(longest, '{', SKD_LINE_BYTES_MAX);
    feed(&reader, longest, SKD_LINE_BYTES_MAX - 1);
    free(longest);
    feed(&reader, (const unsigned char *)"\n", 1);
    assert_true(skd_reader_take(&reader, &frame));
    free(frame.block);
    for (size_t at = 0; at < bytes;) {
        struct skd_error error;
        enum skd_status status;
        at += feed_once(&reader, lines + at, bytes - at, &status, &error);
        assert_int_equal(status, SKD_OK);
        while (skd_reader_take(&reader, &frame)) {
            count++;
            free(frame.block);
        }
    }
    assert_int_equal(count, bytes / 3);
    /* What a long line needed was given back. */
    assert_true(reader.wanted <= 4096);
    skd_reader_finish(&reader);
    free(lines);
}

/* ---- JSON ---- */

static enum skd_status parse_bytes(const char *json, size_t bytes, struct skd_message *message,
                                   struct skd_error *error)
{
    struct skd_frame frame = frame_of(json, bytes, NULL, 0);
    enum skd_status status = skd_message_parse(&frame, message, error);
    assert_null(frame.block);
    return status;
}

static enum skd_status parse_status(const char *json)
{
    struct skd_message message;
    struct skd_error error;
    enum skd_status status = parse_bytes(json, strlen(json), &message, &error);
    if (status != SKD_OK)
        assert_true(error.status == status && error.text[0] != '\0');
    skd_message_finish(&message);
    return status;
}

/* A good request with `params` in it. */
static enum skd_status parse_params(const char *params)
{
    char json[4096];
    int written = snprintf(json, sizeof json,
                           "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"m\",\"params\":%s}", params);
    assert_true(written > 0 && (size_t)written < sizeof json);
    return parse_status(json);
}

static void test_json_that_is_refused(void **state)
{
    (void)state;
    static const char *const broken[] = {
        "",
        " ",
        "{",
        "}",
        "[",
        "{]",
        "[}",
        "{}{}",
        "{} x",
        "{\"a\"}",
        "{\"a\":}",
        "{\"a\":1,}",
        "{,}",
        "{a:1}",
        "{'a':1}",
        "[1,]",
        "[,1]",
        "[1 2]",
        "\xEF\xBB\xBF{}",
        "{}\f",
        "/**/{}",
        "[01]",
        "[-]",
        "[+1]",
        "[.5]",
        "[1.]",
        "[1e]",
        "[1e+]",
        "[0x1]",
        "[NaN]",
        "[Infinity]",
        "[1-2]",
        "[tru]",
        "[True]",
        "[nul]",
        "\"a",
        "\"\\x\"",
        "\"\\u12\"",
        "\"\\u12g4\"",
        "\"\t\"",
        "\"\n\"",
        "\"\\u0000\"",
        "\"\\ud800\"",
        "\"\\ud800x\"",
        "\"\\ud800\\u0041\"",
        "\"\\udc00\"",
        "[\"\\",
        "[\"\\\"]",
        "[1.0000000000000000000000000000000000000000000000000000000000000000001]",
    };
    for (size_t i = 0; i < sizeof broken / sizeof broken[0]; i++)
        if (parse_status(broken[i]) != SKD_BAD_JSON)
            fail_msg("not refused as JSON: %s", broken[i]);
}

static void test_json_that_is_taken(void **state)
{
    (void)state;
    static const char *const good[] = {
        "{}",
        " { } ",
        "{\"a\":[]}",
        "{\"a\":[[],{}]}",
        "{\"a\":[0,-0,1.5,-2e9,1E+3,0.0e-2]}",
        "{\"a\":\"\\\"\\\\\\/\\b\\f\\n\\r\\t\\u00e9\\ud83d\\ude00\"}",
        "{\"a\":\"\xC3\xA9\"}",
        "{\"a\" :\t1 ,\r\n\"b\": null, \"c\":true,\"d\":false}",
        "{\"a\":1e999}",
        "{\"\":1}",
        "{\"a\":1,\"a\":2}",
    };
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++)
        if (parse_params(good[i]) != SKD_OK)
            fail_msg("refused: %s", good[i]);
}

static void test_nul_bytes_are_refused(void **state)
{
    (void)state;
    static const char inside[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"a\0b\"}";
    static const char behind[] = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"a\"}\0";
    struct skd_message message;
    struct skd_error error;
    assert_int_equal(parse_bytes(inside, sizeof inside - 1, &message, &error), SKD_BAD_JSON);
    skd_message_finish(&message);
    assert_int_equal(parse_bytes(behind, sizeof behind - 1, &message, &error), SKD_BAD_JSON);
    skd_message_finish(&message);
}

static void test_utf8(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        size_t valid;
    } cases[] = {
        {"", 0},
        {"abc", 3},
        {"\xC2\x80\xDF\xBF", 4},
        {"\xE0\xA0\x80\xED\x9F\xBF\xEE\x80\x80\xEF\xBF\xBF", 12},
        {"\xF0\x90\x80\x80\xF4\x8F\xBF\xBF", 8},
        {"a\x80", 1},     /* a tail without a head */
        {"a\xC0\xAF", 1}, /* overlong '/' */
        {"a\xC1\xBF", 1},
        {"a\xE0\x9F\xBF", 1},
        {"a\xF0\x8F\xBF\xBF", 1},
        {"a\xED\xA0\x80", 1},     /* a surrogate */
        {"a\xF4\x90\x80\x80", 1}, /* above U+10FFFF */
        {"a\xF5\x80\x80\x80", 1},
        {"a\xFF", 1},
        {"a\xE2\x82", 1}, /* cut */
        {"a\xE2\x82z", 1},
        {"a\xF0\x9F\x98", 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        size_t bytes = strlen(cases[i].text);
        assert_int_equal(skd_utf8_valid_bytes(cases[i].text, bytes), cases[i].valid);
        char params[64];
        (void)snprintf(params, sizeof params, "{\"a\":\"%s\"}", cases[i].text);
        assert_int_equal(parse_params(params), cases[i].valid == bytes ? SKD_OK : SKD_BAD_JSON);
    }
    assert_int_equal(skd_utf8_quote("\xE2\x82\xAC\xE2\x82\xAC", 5), 3);
}

/* A request nested to `depth`: the envelope and params are two of them. */
static enum skd_status parse_nested(int depth, char open, char close)
{
    char params[256] = "{\"a\":";
    size_t used = strlen(params);
    for (int i = 2; i < depth; i++) {
        params[used++] = open;
        if (open == '{') {
            memcpy(params + used, "\"a\":", 4);
            used += 4;
        }
    }
    params[used++] = '1';
    for (int i = 2; i < depth; i++)
        params[used++] = close;
    params[used++] = '}';
    params[used] = '\0';
    return parse_params(params);
}

static void test_nesting(void **state)
{
    (void)state;
    assert_int_equal(parse_nested(31, '[', ']'), SKD_OK);
    assert_int_equal(parse_nested(32, '[', ']'), SKD_OK);
    assert_int_equal(parse_nested(33, '[', ']'), SKD_BAD_JSON);
    assert_int_equal(parse_nested(31, '{', '}'), SKD_OK);
    assert_int_equal(parse_nested(32, '{', '}'), SKD_OK);
    assert_int_equal(parse_nested(33, '{', '}'), SKD_BAD_JSON);
    /* Brackets in strings do not nest, and a million levels cost nothing. */
    assert_int_equal(parse_params("{\"a\":\"[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[{{{{\\\"[\"}"),
                     SKD_OK);
    char *deep = malloc(1000000);
    assert_non_null(deep);
    memset(deep, '[', 1000000);
    struct skd_message message;
    struct skd_error error;
    assert_int_equal(parse_bytes(deep, 1000000, &message, &error), SKD_BAD_JSON);
    skd_message_finish(&message);
    free(deep);
}

/* ---- messages ---- */

static void test_messages_that_are_no_messages(void **state)
{
    (void)state;
    static const char *const bad[] = {
        "[]",
        "1",
        "{}",
        "[{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\"}]",
        "{\"id\":1,\"method\":\"ping\"}",
        "{\"jsonrpc\":\"1.0\",\"id\":1,\"method\":\"ping\"}",
        "{\"jsonrpc\":2.0,\"id\":1,\"method\":\"ping\"}",
        "{\"JSONRPC\":\"2.0\",\"id\":1,\"method\":\"ping\"}",
        "{\"jsonrpc\":\"2.0\",\"id\":1}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":7}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\",\"params\":[]}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\",\"result\":{}}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"result\":{},\"error\":{}}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"result\":5}",
        "{\"jsonrpc\":\"2.0\",\"result\":{}}",
        "{\"jsonrpc\":\"2.0\",\"id\":null,\"result\":{}}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\",\"buffers\":{}}",
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (parse_status(bad[i]) != SKD_BAD_REQUEST)
            fail_msg("not refused as a message: %s", bad[i]);
    assert_int_equal(parse_status("{\"jsonrpc\":\"2.0\",\"id\":null,\"error\":{}}"), SKD_OK);
    assert_int_equal(parse_status("{\"jsonrpc\":\"2.0\",\"id\":1,\"result\":{},\"x\":[1]}"),
                     SKD_OK);
    assert_int_equal(parse_status("{\"jsonrpc\":\"2.0\",\"method\":\"cancel\"}"), SKD_OK);
}

static enum skd_status parse_id(const char *id, struct skd_request_id *parsed)
{
    char json[256];
    struct skd_message message;
    struct skd_error error;
    (void)snprintf(json, sizeof json, "{\"jsonrpc\":\"2.0\",\"id\":%s,\"method\":\"m\"}", id);
    enum skd_status status = parse_bytes(json, strlen(json), &message, &error);
    *parsed = message.id;
    skd_message_finish(&message);
    return status;
}

static void test_ids(void **state)
{
    (void)state;
    static const char *const bad[] = {
        "1.5", "1e400", "9007199254740994", "-9007199254740994", "null", "true", "[]", "{}"};
    struct skd_request_id id;
    char text[80];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(parse_id(bad[i], &id), SKD_BAD_REQUEST);
        assert_int_equal(id.kind, SKD_ID_NONE);
    }
    assert_int_equal(parse_id("9007199254740992", &id), SKD_OK);
    assert_true(id.kind == SKD_ID_NUMBER && id.number == INT64_C(9007199254740992));
    assert_int_equal(parse_id("-9007199254740992", &id), SKD_OK);
    assert_true(id.number == -INT64_C(9007199254740992));
    assert_int_equal(parse_id("0", &id), SKD_OK);
    assert_true(id.kind == SKD_ID_NUMBER && id.number == 0);
    for (size_t bytes = SKD_ID_BYTES_MAX - 1; bytes <= SKD_ID_BYTES_MAX + 1; bytes++) {
        memset(text, 'x', sizeof text);
        text[0] = text[bytes + 1] = '"';
        text[bytes + 2] = '\0';
        assert_int_equal(parse_id(text, &id), bytes <= SKD_ID_BYTES_MAX ? SKD_OK : SKD_BAD_REQUEST);
        if (bytes <= SKD_ID_BYTES_MAX)
            assert_true(id.kind == SKD_ID_TEXT && strlen(id.text) == bytes);
    }
    /* The id is told also when the rest is bad. */
    struct skd_message message;
    struct skd_error error;
    static const char json[] = "{\"id\":\"me\",\"method\":7}";
    assert_int_equal(parse_bytes(json, sizeof json - 1, &message, &error), SKD_BAD_REQUEST);
    assert_string_equal(message.id.text, "me");
    skd_message_finish(&message);
}

/* ---- buffers ---- */

static enum skd_status parse_buffers(const char *buffers, size_t tail_bytes)
{
    char json[2048];
    unsigned char tail[256] = {0};
    struct skd_message message;
    struct skd_error error;
    (void)snprintf(json, sizeof json,
                   "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"m\",\"buffers\":[%s]}", buffers);
    struct skd_frame frame = frame_of(json, strlen(json), tail, tail_bytes);
    enum skd_status status = skd_message_parse(&frame, &message, &error);
    for (int i = 0; status == SKD_OK && i < message.buffer_count; i++)
        assert_non_null(message.buffers[i].data);
    skd_message_finish(&message);
    return status;
}

static void test_buffers_within_the_tail(void **state)
{
    (void)state;
    static const char six[] = "{\"dtype\":\"f32\",\"shape\":[2,3],\"offset\":8}";
    assert_int_equal(parse_buffers(six, 31), SKD_BAD_REQUEST);
    assert_int_equal(parse_buffers(six, 32), SKD_OK);
    assert_int_equal(parse_buffers(six, 33), SKD_OK);
    /* Overlap is the sender's business. */
    char twice[128];
    (void)snprintf(twice, sizeof twice, "%s,%s", six, six);
    assert_int_equal(parse_buffers(twice, 32), SKD_OK);
    /* Nothing, in a tail that is not there. */
    assert_int_equal(parse_buffers("{\"dtype\":\"f64\",\"shape\":[0,16],\"offset\":0}", 0), SKD_OK);
    assert_int_equal(parse_buffers("{\"dtype\":\"f64\",\"shape\":[0],\"offset\":8}", 0),
                     SKD_BAD_REQUEST);
}

static void test_buffers_that_are_refused(void **state)
{
    (void)state;
    static const char *const bad[] = {
        "1",
        "{}",
        "{\"dtype\":\"f16\",\"shape\":[1],\"offset\":0}",
        "{\"dtype\":\"F32\",\"shape\":[1],\"offset\":0}",
        "{\"dtype\":5,\"shape\":[1],\"offset\":0}",
        "{\"dtype\":\"u8\",\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[],\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[1,1,1,1,1],\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":1,\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[-1],\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[1.5],\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[\"1\"],\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[1e300],\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[1]}",
        "{\"dtype\":\"u8\",\"shape\":[1],\"offset\":4}",
        "{\"dtype\":\"u8\",\"shape\":[1],\"offset\":-8}",
        "{\"dtype\":\"u8\",\"shape\":[1],\"offset\":64}",
        "{\"dtype\":\"u8\",\"shape\":[1],\"offset\":9007199254740992}",
        /* products that wrap to something small */
        "{\"dtype\":\"u8\",\"shape\":[4294967296,4294967296],\"offset\":0}",
        "{\"dtype\":\"f64\",\"shape\":[2305843009213693952],\"offset\":0}",
        "{\"dtype\":\"u8\",\"shape\":[9007199254740992,9007199254740992,0],\"offset\":0}",
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (parse_buffers(bad[i], 64) != SKD_BAD_REQUEST)
            fail_msg("not refused as a buffer: %s", bad[i]);
}

static void test_number_of_buffers(void **state)
{
    (void)state;
    static const char one[] = "{\"dtype\":\"u8\",\"shape\":[1],\"offset\":0}";
    for (int count = SKD_BUFFERS_MAX - 1; count <= SKD_BUFFERS_MAX + 1; count++) {
        char list[1024] = "";
        for (int i = 0; i < count; i++) {
            strcat(list, i == 0 ? "" : ",");
            strcat(list, one);
        }
        assert_int_equal(parse_buffers(list, 8), count <= SKD_BUFFERS_MAX ? SKD_OK : SKD_TOO_LARGE);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_status_has_one_row),
        cmocka_unit_test(test_frames_split_anywhere),
        cmocka_unit_test(test_header_layout),
        cmocka_unit_test(test_frame_limits),
        cmocka_unit_test(test_magic_is_refused_at_its_first_byte),
        cmocka_unit_test(test_lines_split_anywhere),
        cmocka_unit_test(test_line_limits),
        cmocka_unit_test(test_many_short_lines_cost_linear_time),
        cmocka_unit_test(test_json_that_is_refused),
        cmocka_unit_test(test_json_that_is_taken),
        cmocka_unit_test(test_nul_bytes_are_refused),
        cmocka_unit_test(test_utf8),
        cmocka_unit_test(test_nesting),
        cmocka_unit_test(test_messages_that_are_no_messages),
        cmocka_unit_test(test_ids),
        cmocka_unit_test(test_buffers_within_the_tail),
        cmocka_unit_test(test_buffers_that_are_refused),
        cmocka_unit_test(test_number_of_buffers),
    };
    return cmocka_run_group_tests_name("protocol", tests, NULL, NULL);
}
