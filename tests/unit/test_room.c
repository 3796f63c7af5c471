/* Room for large messages (net/room.h): first come, first served, and nobody is forgotten. */
#include "net/room.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>

#include <cmocka.h>

static const size_t HALF = SKD_ROOM_BYTES / 2;

static void count(void *user)
{
    (*(int *)user)++;
}

static void test_all_of_it_and_not_a_byte_more(void **state)
{
    struct skd_room room = {0};
    int granted = 0;
    struct skd_room_share all = {0}, one = {.granted = count, .user = &granted};
    (void)state;
    assert_true(skd_room_take(&room, &all, SKD_ROOM_BYTES, 0));
    assert_false(skd_room_take(&room, &one, 1, 0));
    skd_room_give(&room, &all, 0);
    assert_int_equal(granted, 1);
    assert_int_equal(room.used, 1);
    skd_room_give(&room, &one, 0);
    skd_room_give(&room, &one, 0); /* twice is once */
    assert_int_equal(room.used, 0);
}

static void test_a_small_one_does_not_pass_a_large_one(void **state)
{
    struct skd_room room = {0};
    int granted = 0;
    struct skd_room_share first = {0}, second = {0};
    struct skd_room_share large = {.granted = count, .user = &granted};
    struct skd_room_share small = large;
    (void)state;
    assert_true(skd_room_take(&room, &first, HALF, 0));
    assert_true(skd_room_take(&room, &second, HALF / 2, 0));
    assert_false(skd_room_take(&room, &large, HALF, 0));
    assert_false(skd_room_take(&room, &small, 1, 0));
    skd_room_give(&room, &second, 0);
    assert_int_equal(granted, 1);
    skd_room_give(&room, &large, 0);
    assert_int_equal(granted, 2);
    assert_int_equal(room.used, HALF + 1);
}

static void test_who_gives_up_waiting_lets_the_next_one_in(void **state)
{
    struct skd_room room = {0};
    int granted = 0;
    struct skd_room_share first = {0};
    struct skd_room_share large = {.granted = count, .user = &granted};
    struct skd_room_share small = large;
    (void)state;
    assert_true(skd_room_take(&room, &first, HALF, 0));
    assert_false(skd_room_take(&room, &large, HALF + 1, 0));
    assert_false(skd_room_take(&room, &small, HALF, 0));
    skd_room_give(&room, &large, 0);
    assert_int_equal(granted, 1);
    assert_int_equal(room.used, SKD_ROOM_BYTES);
    assert_null(room.waiting);
}

static void test_who_stands_still_is_found_when_others_wait(void **state)
{
    struct skd_room room = {0};
    int granted = 0;
    struct skd_room_share first = {0}, second = {0};
    struct skd_room_share third = {.granted = count, .user = &granted};
    (void)state;
    assert_true(skd_room_take(&room, &first, HALF, 1000));
    assert_true(skd_room_take(&room, &second, HALF, 1000));
    assert_null(skd_room_stuck(&room, 9000, 1000));
    assert_false(skd_room_take(&room, &third, HALF, 1000));
    first.fed_ms = 1500;
    assert_null(skd_room_stuck(&room, 1999, 1000));
    assert_ptr_equal(skd_room_stuck(&room, 2000, 1000), &second);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_all_of_it_and_not_a_byte_more),
        cmocka_unit_test(test_a_small_one_does_not_pass_a_large_one),
        cmocka_unit_test(test_who_gives_up_waiting_lets_the_next_one_in),
        cmocka_unit_test(test_who_stands_still_is_found_when_others_wait),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
