/* Answers to give again: what is known, what is new, what is too old to tell. */
#include "session/remembered.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static void add(struct skd_remembered *remembered, const char *client, uint64_t sequence)
{
    char answer[80];
    (void)snprintf(answer, sizeof answer, "{\"of\":\"%s %llu\"}", client,
                   (unsigned long long)sequence);
    assert_int_equal(
        skd_remembered_add(remembered, client, sequence, 1000 + sequence, answer, NULL), SKD_OK);
}

static enum skd_remembered_kind find(const struct skd_remembered *remembered, const char *client,
                                     uint64_t sequence)
{
    const char *text = NULL;
    char answer[80];
    enum skd_remembered_kind kind = skd_remembered_find(remembered, client, sequence, &text);
    (void)snprintf(answer, sizeof answer, "{\"of\":\"%s %llu\"}", client,
                   (unsigned long long)sequence);
    if (kind == SKD_SEQUENCE_REPEATED)
        assert_string_equal(text, answer);
    else
        assert_null(text);
    return kind;
}

static void each_client_has_numbers_of_its_own(void **state)
{
    (void)state;
    struct skd_remembered remembered = {0};
    assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_NEW);
    add(&remembered, "a", 1);
    add(&remembered, "b", 7);
    assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_REPEATED);
    assert_int_equal(find(&remembered, "b", 7), SKD_SEQUENCE_REPEATED);
    assert_int_equal(find(&remembered, "b", 1), SKD_SEQUENCE_NEW);
    assert_int_equal(find(&remembered, "a", 7), SKD_SEQUENCE_NEW);
    assert_int_equal(find(&remembered, "ab", 1), SKD_SEQUENCE_NEW);
    assert_int_equal(remembered.bytes,
                     2 * (sizeof(struct skd_remembered_client) + strlen("{\"of\":\"a 1\"}") + 1));
    skd_remembered_finish(&remembered);
    assert_true(remembered.clients == NULL && remembered.bytes == 0);
}

static void a_gap_is_not_stale_before_it_falls_out(void **state)
{
    (void)state;
    struct skd_remembered remembered = {0};
    /* 2, 4, 6, ...: the odd ones failed, and may come again. */
    for (uint64_t i = 1; i <= SKD_REMEMBERED_ANSWERS_MAX; i++) {
        assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_NEW);
        add(&remembered, "a", 2 * i);
        assert_int_equal(find(&remembered, "a", 2 * i + 1), SKD_SEQUENCE_NEW);
    }
    assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_STALE); /* full: nobody knows */
    assert_int_equal(find(&remembered, "a", 3), SKD_SEQUENCE_NEW);
    add(&remembered, "a", 3); /* done late: it stands in its place, and the oldest goes */
    assert_int_equal(find(&remembered, "a", 2), SKD_SEQUENCE_STALE);
    assert_int_equal(find(&remembered, "a", 3), SKD_SEQUENCE_REPEATED);
    assert_int_equal(find(&remembered, "a", 4), SKD_SEQUENCE_REPEATED);
    assert_int_equal(find(&remembered, "a", UINT64_C(1) << 53), SKD_SEQUENCE_NEW);
    skd_remembered_finish(&remembered);
}

/* One below, at and one above what a client may have remembered. */
static void the_oldest_answers_go(void **state)
{
    (void)state;
    struct skd_remembered remembered = {0};
    const uint64_t most = SKD_REMEMBERED_ANSWERS_MAX;
    for (uint64_t i = 1; i < most; i++)
        add(&remembered, "a", i);
    assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_REPEATED);
    add(&remembered, "a", most);
    assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_REPEATED);
    add(&remembered, "a", most + 1);
    assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_STALE);
    for (uint64_t i = 2; i <= most + 1; i++)
        assert_int_equal(find(&remembered, "a", i), SKD_SEQUENCE_REPEATED);
    skd_remembered_finish(&remembered);
}

static void the_most_silent_client_goes(void **state)
{
    (void)state;
    struct skd_remembered remembered = {0};
    char name[16];
    for (int i = 0; i < SKD_REMEMBERED_CLIENTS_MAX; i++) {
        (void)snprintf(name, sizeof name, "c%d", i);
        add(&remembered, name, 1);
    }
    add(&remembered, "c0", 2); /* c1 is the one that was silent longest now */
    add(&remembered, "new", 1);
    assert_int_equal(find(&remembered, "c0", 1), SKD_SEQUENCE_REPEATED);
    assert_int_equal(find(&remembered, "c1", 1), SKD_SEQUENCE_NEW);
    assert_int_equal(find(&remembered, "c2", 1), SKD_SEQUENCE_REPEATED);
    skd_remembered_finish(&remembered);
}

/* What is reserved when a change begins is there when it has its answer. */
static void reserving_makes_room_and_nothing_else(void **state)
{
    (void)state;
    struct skd_remembered remembered = {0};
    add(&remembered, "a", 1);
    add(&remembered, "b", 1);
    assert_int_equal(skd_remembered_reserve(&remembered, "a", NULL), SKD_OK);
    assert_int_equal(find(&remembered, "a", 1), SKD_SEQUENCE_REPEATED);
    assert_int_equal(find(&remembered, "a", 2), SKD_SEQUENCE_NEW);
    skd_remembered_put(&remembered, "a", 2, 7, strdup("{\"of\":\"a 2\"}"));
    assert_int_equal(find(&remembered, "a", 2), SKD_SEQUENCE_REPEATED);
    assert_int_equal(skd_remembered_reserve(&remembered, "c", NULL), SKD_OK);
    assert_int_equal(find(&remembered, "c", 1), SKD_SEQUENCE_NEW);
    skd_remembered_put(&remembered, "c", 1, 8, strdup("{\"of\":\"c 1\"}"));
    assert_int_equal(find(&remembered, "c", 1), SKD_SEQUENCE_REPEATED);
    skd_remembered_finish(&remembered);
}

/* Answers as long as a client can make them. */
static void long_answers_push_others_out(void **state)
{
    (void)state;
    struct skd_remembered remembered = {0};
    const size_t length =
        SKD_REMEMBERED_BYTES_MAX / 10; /* nine, and what little the clients take */
    char *answer = malloc(length), name[16];
    const char *text;
    memset(answer, ' ', length - 1);
    answer[length - 1] = '\0';
    for (uint64_t i = 1; i <= 12; i++) {
        (void)snprintf(name, sizeof name, "c%u", (unsigned)(i % 2));
        assert_int_equal(skd_remembered_add(&remembered, name, i, i, answer, NULL), SKD_OK);
        assert_true(remembered.bytes <= SKD_REMEMBERED_BYTES_MAX);
    }
    static const enum skd_remembered_kind odd[] = {SKD_SEQUENCE_STALE, SKD_SEQUENCE_STALE,
                                                   SKD_SEQUENCE_REPEATED};
    for (size_t i = 0; i < 3; i++)
        assert_int_equal(skd_remembered_find(&remembered, "c1", 2 * i + 1, &text), odd[i]);
    assert_int_equal(skd_remembered_find(&remembered, "c0", 12, &text), SKD_SEQUENCE_REPEATED);
    /* One that is longer than all may be pushes out all, and stays. */
    char *huge = malloc(SKD_REMEMBERED_BYTES_MAX + 1);
    memset(huge, ' ', SKD_REMEMBERED_BYTES_MAX);
    huge[SKD_REMEMBERED_BYTES_MAX] = '\0';
    assert_int_equal(skd_remembered_add(&remembered, "c0", 14, 14, huge, NULL), SKD_OK);
    assert_int_equal(HASH_COUNT(remembered.clients), 1);
    assert_int_equal(skd_remembered_find(&remembered, "c0", 12, &text), SKD_SEQUENCE_STALE);
    assert_int_equal(skd_remembered_find(&remembered, "c0", 14, &text), SKD_SEQUENCE_REPEATED);
    skd_remembered_finish(&remembered);
    free(answer);
    free(huge);
}

static bool add_again(void *user, const char *client_id, uint64_t sequence, uint64_t revision,
                      const char *answer)
{
    assert_int_equal(revision, 1000 + sequence);
    assert_int_equal(skd_remembered_add(user, client_id, sequence, revision, answer, NULL), SKD_OK);
    return true;
}

static bool stop_at_three(void *user, const char *client_id, uint64_t sequence, uint64_t revision,
                          const char *answer)
{
    (void)client_id, (void)sequence, (void)revision, (void)answer;
    return ++*(int *)user < 3;
}

/* Added in the order in which they are visited, the same go first. */
static void a_copy_forgets_in_the_same_order(void **state)
{
    (void)state;
    struct skd_remembered one = {0}, other = {0};
    char name[16];
    uint64_t random = 1;
    for (uint64_t i = 1; i < 9000; i++) {
        random = random * UINT64_C(6364136223846793005) + 1442695040888963407U;
        (void)snprintf(name, sizeof name, "c%u", (unsigned)(random >> 60));
        add(&one, name, i);
    }
    skd_remembered_each(&one, add_again, &other);
    for (uint64_t i = 0; i < 60; i++) {
        (void)snprintf(name, sizeof name, "n%u", (unsigned)i);
        add(&one, name, 1);
        add(&other, name, 1);
    }
    assert_int_equal(one.bytes, other.bytes);
    for (uint64_t i = 1; i < 9000; i++) {
        for (unsigned client = 0; client < 16; client++) {
            (void)snprintf(name, sizeof name, "c%u", client);
            assert_int_equal(find(&one, name, i), find(&other, name, i));
        }
    }
    int visited = 0;
    skd_remembered_each(&one, stop_at_three, &visited);
    assert_int_equal(visited, 3);
    skd_remembered_finish(&one);
    skd_remembered_finish(&other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_client_has_numbers_of_its_own),
        cmocka_unit_test(a_gap_is_not_stale_before_it_falls_out),
        cmocka_unit_test(the_oldest_answers_go),
        cmocka_unit_test(the_most_silent_client_goes),
        cmocka_unit_test(reserving_makes_room_and_nothing_else),
        cmocka_unit_test(long_answers_push_others_out),
        cmocka_unit_test(a_copy_forgets_in_the_same_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
