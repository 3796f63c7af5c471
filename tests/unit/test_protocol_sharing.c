/* Requests as values, what tools share: who a client is, sessions' files, claims, numbered changes.
 * What is solved and edited is in test_protocol_request.c. */
#include "request_helpers.h"

#define STROKE "\"session\":\"a\",\"pose\":\"p\",\"vertices\":[1],\"positions\":[[1,2,3]]"
#define SET "\"session\":\"a\",\"vertices\":[1],\"weights\":[[1,0,0,0]]"
#define HELLO(member) "{\"protocol\":{\"min\":1,\"max\":1},\"client\":{" member "}}"

static const struct refusal refused[] = {
    {"hello", HELLO("\"id\":\"\""), SKD_BAD_PARAMS, "id has 0 bytes"},
    {"hello", HELLO("\"id\":\"a b\""), SKD_BAD_PARAMS, "id is \"a b\""},
    {"hello", HELLO("\"id\":7"), SKD_BAD_PARAMS, "id is not a string"},
    {"hello", "{\"protocol\":{\"min\":1,\"max\":1},\"token\":\"0123\"}", SKD_BAD_PARAMS,
     "token has 4 bytes"},
    {"session.create", "{\"file\":\"/a\",\"durability\":\"some\"}", SKD_BAD_PARAMS,
     "durability is not one of full, second, off"},
    {"session.attach", "{\"session\":\"a\",\"instance\":3}", SKD_BAD_PARAMS,
     "instance is not a string"},
    {"session.set", "{\"durability\":\"off\"}", SKD_BAD_PARAMS, "session is missing"},
    {"session.save", "{\"session\":\"a\",\"path\":\"b.skind\"}", SKD_BAD_PARAMS,
     "begin it with '/'"},
    {"session.save", "{\"session\":\"a\",\"path\":\"/b.glb\"}", SKD_BAD_PARAMS,
     "must end in .skind"},
    {"session.save", "{\"session\":\"a\",\"path\":\"skind\"}", SKD_BAD_PARAMS, "begin it with"},
    {"session.open", "{}", SKD_BAD_PARAMS, "give either path or closed"},
    {"session.open", "{\"path\":\"/a.skind\",\"closed\":\"a\"}", SKD_BAD_PARAMS,
     "give either path or closed"},
    {"session.open", "{\"closed\":\"../a\"}", SKD_BAD_PARAMS, "closed is \"../a\""},
    {"session.fork", "{\"session\":\"a\"}", SKD_BAD_PARAMS, "name is missing"},
    {"session.verify", "{}", SKD_BAD_PARAMS, "give either session or path"},
    {"session.verify", "{\"session\":\"a\",\"path\":\"/b\"}", SKD_BAD_PARAMS,
     "give either session or path"},
    {"session.claim", "{\"session\":\"a\",\"bones\":\"hip\"}", SKD_BAD_PARAMS, "list of strings"},
    {"session.claim", "{\"session\":\"a\",\"vertices\":[-1]}", SKD_BAD_PARAMS, "vertices"},
    {"history.undo", "{\"session\":\"a\",\"own\":1}", SKD_BAD_PARAMS, "neither true nor false"},
    {"history.undo", "{\"session\":\"a\",\"sequence\":0}", SKD_BAD_PARAMS,
     "sequence must be a whole number from 1 to 2^53"},
    {"stroke.apply", "{" STROKE ",\"sequence\":1.5}", SKD_BAD_PARAMS, "sequence"},
    {"weights.set", "{" SET ",\"sequence\":\"1\"}", SKD_BAD_PARAMS, "sequence"},
    {"pins.clear", "{\"session\":\"a\",\"sequence\":9007199254740993e1}", SKD_BAD_PARAMS,
     "sequence"},
};

static void test_what_is_refused(void **state)
{
    (void)state;
    check_refused(refused, sizeof refused / sizeof *refused);
}

static void test_who_a_client_is(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "hello", HELLO("\"id\":\"blender-7.a\",\"user\":\"Ann B\"")),
                     SKD_OK);
    assert_string_equal(request.params.hello.client_id, "blender-7.a");
    assert_string_equal(request.params.hello.client_user, "Ann B");
    skd_request_finish(&request);
    for (int digits = SKD_TOKEN_DIGITS - 1; digits <= SKD_TOKEN_DIGITS + 1; digits++) {
        char params[160];
        (void)snprintf(params, sizeof params,
                       "{\"protocol\":{\"min\":1,\"max\":1},\"token\":\"%0*d\"}", digits, 7);
        assert_int_equal(decode(&request, "hello", params),
                         digits == SKD_TOKEN_DIGITS ? SKD_OK : SKD_BAD_PARAMS);
        skd_request_finish(&request);
    }
}

static void test_what_an_attaching_tool_has(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "session.attach",
                            "{\"session\":\"a\",\"revision\":12,\"instance\":\"0123\"}"),
                     SKD_OK);
    assert_string_equal(request.params.session.instance, "0123");
    skd_request_finish(&request);
}

static void test_lengths_of_strings(void **state)
{
    (void)state;
    check_text_limit("hello", "\"protocol\":{\"min\":1,\"max\":1},\"client\":{\"id\":", 'a', "}",
                     SKD_CLIENT_ID_BYTES_MAX);
    check_text_limit("hello", "\"protocol\":{\"min\":1,\"max\":1},\"client\":{\"user\":", 'a', "}",
                     SKD_USER_BYTES_MAX);
    check_text_limit("session.fork", "\"session\":\"a\",\"name\":", 'a', "",
                     SKD_SESSION_NAME_BYTES_MAX);
    check_text_limit("session.open", "\"path\":", '/', "", SKD_PATH_BYTES_MAX);
}

static void test_keeping(void **state)
{
    (void)state;
    struct skd_request request;
    const struct skd_session_keep_params *keep = &request.params.session_keep;
    assert_int_equal(decode(&request, "session.set", "{\"session\":\"a\"}"), SKD_OK);
    assert_string_equal(keep->session, "a");
    assert_true(keep->durability == -1 && keep->history_bytes == 0);
    skd_request_finish(&request);
    assert_int_equal(
        decode(&request, "session.set",
               "{\"session\":\"a\",\"durability\":\"second\",\"history_bytes\":1048576}"),
        SKD_OK);
    assert_string_equal(skd_durability_words[keep->durability], "second");
    assert_int_equal(keep->history_bytes, 1 << 20);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "session.save", "{\"session\":\"a\",\"path\":\"/b.skind\"}"),
                     SKD_OK);
    assert_string_equal(keep->path, "/b.skind");
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "session.open", "{\"closed\":\"a\",\"name\":\"b\"}"), SKD_OK);
    assert_true(keep->path == NULL && keep->session == NULL);
    assert_string_equal(keep->closed, "a");
    assert_string_equal(keep->name, "b");
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "session.create", "{\"file\":\"/a\",\"durability\":\"off\"}"),
                     SKD_OK);
    assert_string_equal(skd_durability_words[request.params.session_create.durability], "off");
    assert_int_equal(request.params.session_create.history_bytes, 0);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "session.create", "{\"file\":\"/a\"}"), SKD_OK);
    assert_string_equal(skd_durability_words[request.params.session_create.durability], "full");
    skd_request_finish(&request);
}

static void test_history_bytes_has_limits(void **state)
{
    (void)state;
    static const struct {
        const char *number;
        enum skd_status status;
    } cases[] = {
        {"1048575", SKD_BAD_PARAMS},   {"1048576", SKD_OK},     {"1048577", SKD_OK},
        {"17179869183", SKD_OK},       {"17179869184", SKD_OK}, {"17179869185", SKD_BAD_PARAMS},
        {"2097152.5", SKD_BAD_PARAMS},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct skd_request request;
        struct skd_error error;
        char params[80];
        (void)snprintf(params, sizeof params, "{\"session\":\"a\",\"history_bytes\":%s}",
                       cases[i].number);
        assert_int_equal(decode_with(&request, &error, "session.set", params, "", NULL, 0),
                         cases[i].status);
        skd_request_finish(&request);
    }
}

static void test_claims(void **state)
{
    (void)state;
    struct skd_request request;
    const struct skd_session_claim_params *claim = &request.params.session_claim;
    assert_int_equal(decode(&request, "session.claim", "{\"session\":\"a\"}"), SKD_OK);
    assert_true(claim->bone_count == 0 && claim->vertices.count == 0);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "session.claim",
                            "{\"session\":\"a\",\"bones\":[\"hip\",\"knee\"],\"vertices\":[7,1]}"),
                     SKD_OK);
    assert_int_equal(claim->bone_count, 2);
    assert_string_equal(claim->bones[1], "knee");
    assert_int_equal(((const uint32_t *)claim->vertices.data)[0], 7);
    skd_request_finish(&request);
}

/* Methods that make a step take one; others have no such member, and pass it over. */
static void test_sequences(void **state)
{
    (void)state;
    static const struct {
        const char *method, *params;
    } takers[] = {
        {"stroke.apply", STROKE},
        {"pins.solve", "\"session\":\"a\",\"pose\":\"p\""},
        {"session.refit", "\"session\":\"a\",\"poses\":[\"p\"],\"positions\":[]"},
        {"weights.set", SET},
        {"weights.mirror", "\"session\":\"a\""},
        {"weights.prune", "\"session\":\"a\""},
        {"weights.reduce", "\"session\":\"a\",\"influences\":4"},
        {"pins.weigh", "\"session\":\"a\",\"pose\":\"p\",\"weight\":1"},
        {"pins.clear", "\"session\":\"a\""},
        {"history.undo", "\"session\":\"a\",\"own\":true"},
        {"history.redo", "\"session\":\"a\",\"own\":true"},
    };
    struct skd_request request;
    char params[200];
    for (size_t i = 0; i < sizeof takers / sizeof takers[0]; i++) {
        (void)snprintf(params, sizeof params, "{%s}", takers[i].params);
        assert_int_equal(decode(&request, takers[i].method, params), SKD_OK);
        assert_int_equal(request.sequence, 0);
        skd_request_finish(&request);
        (void)snprintf(params, sizeof params, "{%s,\"sequence\":9007199254740992}",
                       takers[i].params);
        assert_int_equal(decode(&request, takers[i].method, params), SKD_OK);
        assert_true(request.sequence == UINT64_C(1) << 53);
        skd_request_finish(&request);
    }
    assert_int_equal(decode(&request, "weights.get", "{\"session\":\"a\",\"sequence\":-1}"),
                     SKD_OK);
    assert_int_equal(request.sequence, 0);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "history.redo", "{\"session\":\"a\"}"), SKD_OK);
    assert_false(request.params.session.own);
    skd_request_finish(&request);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_what_is_refused),
        cmocka_unit_test(test_who_a_client_is),
        cmocka_unit_test(test_what_an_attaching_tool_has),
        cmocka_unit_test(test_lengths_of_strings),
        cmocka_unit_test(test_keeping),
        cmocka_unit_test(test_history_bytes_has_limits),
        cmocka_unit_test(test_claims),
        cmocka_unit_test(test_sequences),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
