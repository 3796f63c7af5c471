/* Sheets: rows that some vertices have in a pose, held against a plain array of them. */
#include "session/sheet.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { VERTICES = 3000, BONES = 2 };

static struct skd_pose *make_pose(const char *name, double turn)
{
    struct skd_pose *pose = skd_pose_create(name, BONES);
    assert_non_null(pose);
    pose->matrices[3] = turn;
    return pose;
}

static uint32_t next_random(uint32_t *seed)
{
    *seed = *seed * 1664525u + 1013904223u;
    return *seed >> 8;
}

/* Changes written and taken back in turn leave what the mirror has; `used` counts its rows. */
static void rows_are_what_was_written(void **state)
{
    (void)state;
    static float mirror[VERTICES][4], kept[VERTICES][4];
    struct skd_error error;
    struct skd_sheets sheets;
    struct skd_sheet *sheet;
    struct skd_pose *pose = make_pose("bent", 1);
    uint32_t seed = 7;
    skd_sheets_init(&sheets, SKD_PIN_NUMBERS, -1, VERTICES, BONES);
    assert_int_equal(skd_sheets_need(&sheets, pose, &sheet, &error), SKD_OK);
    for (size_t v = 0; v < VERTICES; v++)
        mirror[v][0] = mirror[v][1] = mirror[v][2] = mirror[v][3] = -1;
    for (int round = 0; round < 40; round++) {
        uint32_t vertices[50];
        for (uint32_t i = 0; i < 50; i++)
            vertices[i] = i * 60 + next_random(&seed) % 60;
        struct skd_sheet_change *change =
            skd_sheet_change_create(&sheets, sheet, vertices, 50, &error);
        assert_non_null(change);
        memcpy(kept, mirror, sizeof mirror);
        for (uint32_t i = 0; i < 50; i++) {
            assert_memory_equal(change->before + 4 * i, mirror[vertices[i]], 16);
            bool clears = next_random(&seed) % 3 == 0;
            for (int k = 0; k < 4; k++)
                change->after[4 * i + (uint32_t)k] = mirror[vertices[i]][k] =
                    clears ? -1.0f : (float)(next_random(&seed) % 100);
        }
        skd_sheet_change_write(change, false);
        if (round % 4 == 3) {
            skd_sheet_change_write(change, true);
            memcpy(mirror, kept, sizeof mirror);
        }
        skd_sheet_change_destroy(change);
    }
    uint32_t listed[VERTICES];
    size_t used = 0;
    skd_sheet_list(&sheets, sheet, listed);
    for (uint32_t v = 0; v < VERTICES; v++) {
        const float *row = skd_sheet_row(&sheets, sheet, v);
        assert_int_equal(row != NULL, mirror[v][3] >= 0);
        if (row == NULL)
            continue;
        assert_memory_equal(row, mirror[v], 16);
        assert_int_equal(listed[used++], v);
    }
    assert_int_equal(used, sheet->used);
    assert_true(used > 0);
    skd_sheets_finish(&sheets);
    skd_pose_release(pose);
}

static void a_sheet_belongs_to_name_and_matrices(void **state)
{
    (void)state;
    struct skd_error error;
    struct skd_sheets sheets;
    struct skd_sheet *first, *same, *other;
    struct skd_pose *poses[] = {make_pose("a", 1), make_pose("a", 1), make_pose("a", 2),
                                make_pose("b", 1)};
    skd_sheets_init(&sheets, SKD_SHAPE_NUMBERS, 0, VERTICES, BONES);
    assert_null(skd_sheets_find(&sheets, poses[0]));
    assert_int_equal(skd_sheets_need(&sheets, poses[0], &first, &error), SKD_OK);
    assert_int_equal(skd_sheets_need(&sheets, poses[1], &same, &error), SKD_OK);
    assert_ptr_equal(same, first);
    for (int i = 2; i < 4; i++) {
        assert_int_equal(skd_sheets_need(&sheets, poses[i], &other, &error), SKD_OK);
        assert_ptr_not_equal(other, first);
    }
    assert_int_equal(sheets.count, 3);
    skd_sheets_finish(&sheets);
    for (int i = 0; i < 4; i++)
        skd_pose_release(poses[i]);
}

/* Sheets in as many poses as there may be, and in one more: what comes of that is `last`. */
static void fill(struct skd_sheets *sheets, bool in_use, enum skd_status last)
{
    struct skd_error error;
    struct skd_sheet *sheet;
    skd_sheets_init(sheets, SKD_PIN_NUMBERS, -1, 10, BONES);
    for (int i = 0; i <= SKD_TARGET_POSES_MAX; i++) {
        struct skd_pose *pose = make_pose("p", i);
        assert_int_equal(skd_sheets_need(sheets, pose, &sheet, &error),
                         i < SKD_TARGET_POSES_MAX ? SKD_OK : last);
        if (in_use)
            sheet->used = 1;
        skd_pose_release(pose);
    }
}

static void sheets_have_a_limit(void **state)
{
    (void)state;
    struct skd_sheets sheets;
    fill(&sheets, true, SKD_TOO_LARGE);
    assert_int_equal(sheets.count, SKD_TARGET_POSES_MAX);
    skd_sheets_finish(&sheets);
}

static void idle_sheets_make_way(void **state)
{
    (void)state;
    struct skd_sheets sheets;
    fill(&sheets, false, SKD_OK);
    assert_int_equal(sheets.count, SKD_TARGET_POSES_MAX + 1);
    struct skd_sheet *used = sheets.items[3], *kept = sheets.items[5];
    used->used = 1;
    kept->is_kept = true;
    skd_sheets_drop_idle(&sheets);
    assert_int_equal(sheets.count, 2);
    assert_ptr_equal(sheets.items[0], used);
    assert_ptr_equal(sheets.items[1], kept);
    skd_sheets_drop_idle(&sheets);
    assert_int_equal(sheets.count, 1);
    skd_sheets_finish(&sheets);
}

/* The order in which sheets were made is nowhere to be seen: strokes add poses up in this one. */
static void sheets_stand_in_the_order_of_their_poses(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        double turn;
    } poses[] = {{"m", 2}, {"a", 5}, {"m", 1}, {"z", 0}, {"b", 3}};
    struct skd_sheets orders[2];
    for (size_t order = 0; order < 2; order++) {
        skd_sheets_init(&orders[order], SKD_PIN_NUMBERS, -1, VERTICES, BONES);
        for (size_t i = 0; i < 5; i++) {
            size_t at = order == 0 ? i : 4 - i;
            struct skd_sheet *sheet;
            struct skd_pose *pose = make_pose(poses[at].name, poses[at].turn);
            assert_int_equal(skd_sheets_need(&orders[order], pose, &sheet, NULL), SKD_OK);
            skd_pose_release(pose);
        }
    }
    const char *const names[] = {"a", "b", "m", "m", "z"};
    for (size_t i = 0; i < 5; i++) {
        const struct skd_pose *pose = orders[0].items[i]->pose;
        assert_string_equal(pose->name, names[i]);
        assert_memory_equal(pose->matrices, orders[1].items[i]->pose->matrices,
                            BONES * SKD_MATRIX_SIZE * sizeof(double));
    }
    skd_sheets_finish(&orders[0]);
    skd_sheets_finish(&orders[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_what_was_written),
        cmocka_unit_test(a_sheet_belongs_to_name_and_matrices),
        cmocka_unit_test(sheets_have_a_limit),
        cmocka_unit_test(idle_sheets_make_way),
        cmocka_unit_test(sheets_stand_in_the_order_of_their_poses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
