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

static void sheets_have_a_limit(void **state)
{
    (void)state;
    struct skd_error error;
    struct skd_sheets sheets;
    struct skd_sheet *sheet;
    skd_sheets_init(&sheets, SKD_PIN_NUMBERS, -1, 10, BONES);
    for (int i = 0; i <= SKD_TARGET_POSES_MAX; i++) {
        struct skd_pose *pose = make_pose("p", i);
        enum skd_status status = skd_sheets_need(&sheets, pose, &sheet, &error);
        assert_int_equal(status, i < SKD_TARGET_POSES_MAX ? SKD_OK : SKD_TOO_LARGE);
        sheet->used = 1;
        skd_pose_release(pose);
    }
    assert_int_equal(sheets.count, SKD_TARGET_POSES_MAX);
    skd_sheets_finish(&sheets);
}

static void idle_sheets_make_way(void **state)
{
    (void)state;
    struct skd_error error;
    struct skd_sheets sheets;
    struct skd_sheet *sheet;
    skd_sheets_init(&sheets, SKD_PIN_NUMBERS, -1, 10, BONES);
    for (int i = 0; i <= SKD_TARGET_POSES_MAX; i++) {
        struct skd_pose *pose = make_pose("p", i);
        assert_int_equal(skd_sheets_need(&sheets, pose, &sheet, &error), SKD_OK);
        skd_pose_release(pose);
    }
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_what_was_written),
        cmocka_unit_test(a_sheet_belongs_to_name_and_matrices),
        cmocka_unit_test(sheets_have_a_limit),
        cmocka_unit_test(idle_sheets_make_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
