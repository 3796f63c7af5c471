/* Trees that lost a member for lack of memory do not become messages. */
#include "protocol_helpers.h"

#include "protocol/encode.h"
#include "protocol/json_memory.h"

/* The sanitizers' allocators end the program by default where malloc returns NULL. */
const char *__asan_default_options(void);
const char *__tsan_default_options(void);

const char *__asan_default_options(void)
{
    return "allocator_may_return_null=1";
}

const char *__tsan_default_options(void)
{
    return "allocator_may_return_null=1";
}

static const struct skd_request_id id = {.kind = SKD_ID_NUMBER, .number = 7};

/* What happens to a handler within a machine without memory. */
static void run_out(void)
{
    assert_null(cJSON_malloc(SIZE_MAX / 4));
}

static enum skd_status answer(void)
{
    struct skd_encoded encoded;
    struct skd_error error;
    cJSON *body = cJSON_CreateObject();
    assert_non_null(cJSON_AddNumberToObject(body, "revision", 3));
    enum skd_status status =
        skd_encode_answer(SKD_WIRE_LINES, &id, body, NULL, 0, &encoded, &error);
    if (status == SKD_OK)
        skd_encoded_finish(&encoded);
    else
        assert_true(error.text[0] != '\0');
    return status;
}

static void test_what_is_not_whole_is_refused_once(void **state)
{
    (void)state;
    assert_int_equal(answer(), SKD_OK);
    run_out();
    assert_int_equal(answer(), SKD_NO_MEMORY);
    assert_int_equal(answer(), SKD_OK);
}

static void test_the_error_for_it_can_be_told(void **state)
{
    struct skd_encoded encoded;
    struct skd_error failure, error;
    (void)state;
    (void)skd_fail_memory(&failure, "an answer");
    run_out();
    assert_int_equal(skd_encode_error(SKD_WIRE_LINES, &id, &failure, &encoded, &error), SKD_OK);
    assert_non_null(strstr((const char *)encoded.head, "\"no_memory\""));
    skd_encoded_finish(&encoded);
    assert_int_equal(answer(), SKD_OK);
}

static void test_it_is_forgotten_when_asked(void **state)
{
    (void)state;
    run_out();
    assert_true(skd_json_memory_ran_out());
    assert_false(skd_json_memory_ran_out());
    assert_int_equal(answer(), SKD_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_what_is_not_whole_is_refused_once),
        cmocka_unit_test(test_the_error_for_it_can_be_told),
        cmocka_unit_test(test_it_is_forgotten_when_asked),
    };
    skd_json_memory_watch();
    return cmocka_run_group_tests_name("json_memory", tests, NULL, NULL);
}
