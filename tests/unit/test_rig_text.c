/* The parts of the rig room that handle text: JSON where it stands, and URIs. */
#include "rig/json_edit.h"
#include "rig/json_text.h"
#include "rig/uri.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))

static bool is_json(const char *text)
{
    struct skd_json root;
    const char *problem = NULL;
    return skd_json_whole(text, strlen(text), &root, &problem);
}

static void test_json_grammar(void **state)
{
    (void)state;
    static const char *const good[] = {
        "{}",
        "[]",
        " [ ] ",
        "\"\"",
        "\"a\\\"b\\\\\"",
        "0",
        "-0",
        "12.5e+3",
        "1E9",
        "true",
        "false",
        "null",
        "[1,2,[3,{\"a\":[]}]]",
        "{\"a\":1,\"b\":{\"c\":\"}\"}}",
        "\xEF\xBB\xBF{}",
        "{}\n\t ",
    };
    static const char *const bad[] = {
        "",        " ",        "{",          "}",         "[",     "[1,", "[1,]",   "[,1]",
        "{\"a\"}", "{\"a\":}", "{\"a\":1,}", "{a:1}",     "{1:2}", "\"",  "\"\\\"", "\"a\nb\"",
        "01",      "-",        "1.",         ".5",        "1e",    "1e+", "+1",     "tru",
        "nul",     "{} {}",    "[1 2]",      "{\"a\" 1}", "[}",    "{]",  "NaN",    "'a'",
    };
    for (size_t i = 0; i < COUNT(good); i++)
        if (!is_json(good[i]))
            fail_msg("refused: %s", good[i]);
    for (size_t i = 0; i < COUNT(bad); i++)
        if (is_json(bad[i]))
            fail_msg("taken: %s", bad[i]);
}

static void test_json_depth(void **state)
{
    (void)state;
    char text[2 * SKD_JSON_DEPTH_MAX + 8];
    for (size_t depth = SKD_JSON_DEPTH_MAX - 1; depth <= SKD_JSON_DEPTH_MAX + 1; depth++) {
        memset(text, '[', depth);
        memset(text + depth, ']', depth);
        text[2 * depth] = '\0';
        /* The innermost brackets are empty and hold no level of their own. */
        assert_int_equal(is_json(text), depth <= SKD_JSON_DEPTH_MAX + 1);
    }
    memset(text, '[', 2 * SKD_JSON_DEPTH_MAX);
    text[2 * SKD_JSON_DEPTH_MAX] = '\0';
    assert_false(is_json(text));
}

/* Every prefix of a document is refused and read no further than it goes (under ASan). */
static void test_json_truncated(void **state)
{
    (void)state;
    static const char whole[] = "{\"a\":[1,-2.5e3,true,null],\"b\":{\"c\":\"x\\\"y\",\"d\":[]}}";
    for (size_t length = 0; length < sizeof whole - 1; length++) {
        char *text = malloc(length + 1);
        struct skd_json root;
        const char *problem = NULL;
        memcpy(text, whole, length);
        assert_false(skd_json_whole(text, length, &root, &problem));
        assert_in_range((size_t)(problem - text), 0, length);
        free(text);
    }
}

static struct skd_json parse(const char *text)
{
    struct skd_json root;
    const char *problem = NULL;
    assert_true(skd_json_whole(text, strlen(text), &root, &problem));
    return root;
}

static void assert_json(struct skd_json value, const char *expected)
{
    assert_int_equal(value.end - value.start, strlen(expected));
    assert_memory_equal(value.start, expected, strlen(expected));
}

static void test_json_find(void **state)
{
    (void)state;
    const struct skd_json root =
        parse("{ \"aa\" : 1 , \"a\":[ 10, {\"a\":2} ,\"x,y\" ], \"e\":[] }");
    struct skd_json value, key;
    assert_true(skd_json_member(root, "a", &value));
    assert_int_equal(skd_json_count(value), 3);
    size_t count = 0;
    struct skd_json *elements = skd_json_elements(value, &count);
    assert_int_equal(count, 3);
    assert_json(elements[0], "10");
    assert_json(elements[1], "{\"a\":2}");
    assert_json(elements[2], "\"x,y\"");
    free(elements);
    assert_false(skd_json_member(root, "b", &value));
    assert_false(skd_json_member(parse("[1]"), "a", &value));
    assert_false(skd_json_member(parse("7"), "a", &value));
    assert_true(skd_json_member(root, "e", &value));
    assert_int_equal(skd_json_count(value), 0);
    struct skd_json at = root;
    assert_true(skd_json_next(&at, &key, &value));
    assert_json(key, "\"aa\"");
    assert_json(value, "1");
}

static void test_json_edits(void **state)
{
    (void)state;
    const char text[] = "{\"n\": [1, 2], \"o\":{\"k\":5}, \"e\":[ ] }\n";
    const struct skd_json root = parse(text);
    struct skd_json n, o, k, e;
    struct skd_json_edits edits = {0};
    assert_true(skd_json_member(root, "n", &n) && skd_json_member(root, "o", &o) &&
                skd_json_member(o, "k", &k) && skd_json_member(root, "e", &e));
    skd_json_append(&edits, e, "7,8");
    skd_json_add(&edits, o, "first", "true");
    skd_json_add(&edits, o, "second", "false");
    skd_json_replace(&edits, k, "%d", 66);
    skd_json_append(&edits, n, "3");
    size_t bytes = 0;
    char *edited = skd_json_apply(&edits, (struct skd_json){text, text + sizeof text - 1}, &bytes);
    const char expected[] = "{\"n\": [1, 2,3], \"o\":{\"first\":true,\"second\":false,\"k\":66}, "
                            "\"e\":[ 7,8] }\n";
    assert_int_equal(bytes, sizeof expected - 1);
    assert_memory_equal(edited, expected, bytes);
    free(edited);
    skd_json_edits_finish(&edits);
}

static void test_base64(void **state)
{
    (void)state;
    static const struct {
        const char *plain, *text;
    } cases[] = {{"", ""},
                 {"f", "Zg=="},
                 {"fo", "Zm8="},
                 {"foo", "Zm9v"},
                 {"foob", "Zm9vYg=="},
                 {"fooba", "Zm9vYmE="},
                 {"foobar", "Zm9vYmFy"}}; /* RFC 4648 */
    for (size_t c = 0; c < COUNT(cases); c++) {
        char uri[64];
        uint8_t *bytes = NULL;
        size_t count = 0;
        char *text = skd_uri_encode_base64((const uint8_t *)cases[c].plain, strlen(cases[c].plain));
        assert_string_equal(text, cases[c].text);
        (void)snprintf(uri, sizeof uri, "data:;base64,%s", text);
        assert_int_equal(skd_uri_decode_data(uri, &bytes, &count, NULL), SKD_OK);
        assert_int_equal(count, strlen(cases[c].plain));
        assert_memory_equal(bytes, cases[c].plain, count);
        free(bytes);
        free(text);
    }
    static const char *const bad[] = {"data:;base64,A", "data:;base64,AAA*", "data:;base64,AB C",
                                      "data:,abc", "data:base64"};
    for (size_t i = 0; i < COUNT(bad); i++) {
        uint8_t *bytes = NULL;
        size_t count = 0;
        assert_int_not_equal(skd_uri_decode_data(bad[i], &bytes, &count, NULL), SKD_OK);
        assert_null(bytes);
    }
}

static void test_paths(void **state)
{
    (void)state;
    static const struct {
        const char *uri, *path;
    } cases[] = {
        {"a.bin", "a.bin"},
        {"a%20b/c%2Ebin", "a b/c.bin"},
        {"./a/..b/c..", "./a/..b/c.."},
        {"100%", "100%"},
        {"%zz", "%zz"},
        {"", NULL},
        {"/a", NULL},
        {"%2Fa", NULL},
        {"..", NULL},
        {"a/../b", NULL},
        {"a/%2e./b", NULL},
        {"a%00b", NULL},
        {"http://a", NULL},
        {"C:\\a", NULL},
        {"file:a", NULL},
    };
    for (size_t c = 0; c < COUNT(cases); c++) {
        char *path = NULL;
        const enum skd_status status = skd_uri_to_path(cases[c].uri, &path, NULL);
        assert_int_equal(status, cases[c].path != NULL ? SKD_OK : SKD_UNSUPPORTED);
        if (cases[c].path != NULL)
            assert_string_equal(path, cases[c].path);
        else
            assert_null(path);
        free(path);
    }
    char *uri = skd_uri_from_name("my r\xC3\xB6hre.bin");
    assert_string_equal(uri, "my%20r%C3%B6hre.bin");
    free(uri);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_json_grammar),   cmocka_unit_test(test_json_depth),
        cmocka_unit_test(test_json_truncated), cmocka_unit_test(test_json_find),
        cmocka_unit_test(test_json_edits),     cmocka_unit_test(test_base64),
        cmocka_unit_test(test_paths),
    };
    return cmocka_run_group_tests_name("rig text", tests, NULL, NULL);
}
