/* The base room: sentences of errors, and where the socket is. */
#include "base/paths.h"
#include "base/utf8.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static void a_sentence_is_utf8_on_one_line(void **state)
{
    (void)state;
    static const struct {
        const char *quoted, *expected;
    } cases[] = {
        {"K\xc3\xb6nig \xe2\x82\xac \xf0\x9f\xa6\xb4",
         "K\xc3\xb6nig \xe2\x82\xac \xf0\x9f\xa6\xb4"},
        {"a\nb\tc\x7f", "a?b?c?"},
        {"\xff\xc3", "??"},
        {"\xc0\xaf", "??"},           /* overlong */
        {"\xed\xa0\x80", "???"},      /* half of a surrogate pair */
        {"\xf4\x90\x80\x80", "????"}, /* above U+10FFFF */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct skd_error error;
        assert_int_equal(skd_fail(&error, SKD_BAD_RIG, "%s", cases[i].quoted), SKD_BAD_RIG);
        assert_string_equal(error.text, cases[i].expected);
    }
}

static void a_long_sentence_is_cut_between_characters(void **state)
{
    (void)state;
    char text[2 * SKD_ERROR_TEXT_BYTES] = "";
    struct skd_error error;
    while (strlen(text) + 3 < sizeof text)
        strcat(text, "\xc3\xa4");
    assert_int_equal(skd_fail(&error, SKD_BAD_RIG, "%s", text), SKD_BAD_RIG);
    assert_int_equal(strlen(error.text), SKD_ERROR_TEXT_BYTES - 1);
    assert_int_equal(skd_utf8_valid_bytes(error.text, strlen(error.text)), strlen(error.text));
    assert_int_equal(skd_fail(NULL, SKD_BAD_RIG, "%s", text), SKD_BAD_RIG);
}

static void the_socket_is_where_the_rule_says(void **state)
{
    (void)state;
    char path[SKD_SOCKET_PATH_BYTES], expected[SKD_SOCKET_PATH_BYTES];
    struct skd_error error;
    setenv("XDG_RUNTIME_DIR", "/run/user/7", 1);
    setenv("SKIND_SOCKET", "/a/b.sock", 1);
    assert_int_equal(skd_socket_path("/c/d.sock", path, &error), SKD_OK);
    assert_string_equal(path, "/c/d.sock");
    assert_int_equal(skd_socket_path(NULL, path, &error), SKD_OK);
    assert_string_equal(path, "/a/b.sock");
    unsetenv("SKIND_SOCKET");
    assert_int_equal(skd_socket_path(NULL, path, &error), SKD_OK);
    assert_string_equal(path, "/run/user/7/skind/skind.sock");
    unsetenv("XDG_RUNTIME_DIR");
    assert_int_equal(skd_socket_path(NULL, path, &error), SKD_OK);
    assert_int_equal(strncmp(path, "/tmp/skind-", 11), 0);
    assert_int_equal(skd_socket_path("relative", path, &error), SKD_BAD_PARAMS);
    memset(expected, 'x', sizeof expected);
    expected[0] = '/';
    expected[SKD_SOCKET_PATH_BYTES - 1] = '\0';
    assert_int_equal(skd_socket_path(expected, path, &error), SKD_OK);
    char longer[SKD_SOCKET_PATH_BYTES + 1] = "/";
    memcpy(longer + 1, expected, sizeof expected);
    assert_int_equal(skd_socket_path(longer, path, &error), SKD_BAD_PARAMS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sentence_is_utf8_on_one_line),
        cmocka_unit_test(a_long_sentence_is_cut_between_characters),
        cmocka_unit_test(the_socket_is_where_the_rule_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
