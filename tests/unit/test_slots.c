/* Slot filling by hand-made skeletons and meshes. Random ones are compared with brute force in
 * tests/oracle. Scratch is exactly what was asked for, so that a sanitizer sees one byte more.
 */
#include "solver/slots.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { EMPTY = SKD_SLOT_EMPTY, APART = SKD_HOPS_APART, SLOTS_MOST = 8, VERTICES_MOST = 8 };

/*  0 - 1 - 2 - 3      5 - 6   (its own root)
 *       \
 *        4                                        */
enum { BONES = 7 };
static const int32_t parents[BONES] = {-1, 0, 1, 2, 1, -1, 5};

static const float heads[BONES * 3] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0,
                                       0, 1, 1, 0, 9, 0, 0, 9, 1, 0};
static const uint16_t one_skin[BONES + 1];

struct filled {
    uint16_t joints[VERTICES_MOST * SLOTS_MOST];
    float weights[VERTICES_MOST * SLOTS_MOST];
    struct skd_slots_report report;
};

static struct filled fill(struct skd_slots_input *input)
{
    struct filled filled;
    uint8_t hops[BONES * BONES];
    skd_hops_build(BONES, parents, hops);
    input->bone_count = BONES;
    input->hops = hops;
    input->bone_heads = heads;
    if (!input->bone_skin)
        input->bone_skin = one_skin;
    if (!input->vertex_skin)
        input->vertex_skin = one_skin;
    const size_t bytes = skd_slots_scratch_bytes(input);
    void *scratch = bytes ? malloc(bytes) : NULL;
    assert_true(bytes == 0 || scratch != NULL);
    skd_slots_fill(input, scratch, filled.joints, filled.weights, &filled.report);
    free(scratch);
    return filled;
}

static void check_joints(const uint16_t *joints, int count, const uint16_t *expected)
{
    for (int i = 0; i < count; i++)
        assert_int_equal(joints[i], expected[i]);
}

static void hops_through_the_nearest_common_ancestor(void **state)
{
    (void)state;
    uint8_t hops[BONES * BONES];
    skd_hops_build(BONES, parents, hops);
    const uint8_t expected[BONES * BONES] = {
        0,     1,     2,     3,     2,     APART, APART, /* 0 */
        1,     0,     1,     2,     1,     APART, APART, /* 1 */
        2,     1,     0,     1,     2,     APART, APART, /* 2 */
        3,     2,     1,     0,     3,     APART, APART, /* 3 */
        2,     1,     2,     3,     0,     APART, APART, /* 4 */
        APART, APART, APART, APART, APART, 0,     1,     /* 5 */
        APART, APART, APART, APART, APART, 1,     0,     /* 6 */
    };
    assert_memory_equal(hops, expected, sizeof expected);
}

static void loose_vertex_is_filled_by_hops(void **state)
{
    (void)state;
    const uint32_t offsets[3] = {0, 2, 3}, no_neighbours[3] = {0};
    const uint16_t joints[3] = {2, 1, 5};
    const float weights[3] = {0.25F, 0.75F, 1.0F};
    const float rest[6] = {0};
    const enum skd_fill fills[] = {SKD_FILL_HOP, SKD_FILL_INFECT, SKD_FILL_NEIGHBOURS};
    for (int i = 0; i < 3; i++) {
        struct skd_slots_input input = {
            .vertex_count = 2,
            .slot_count = 4,
            .fill = fills[i],
            .rest = rest,
            .influence_offsets = offsets,
            .influence_joints = joints,
            .influence_weights = weights,
            .neighbour_offsets = no_neighbours,
            .neighbours = no_neighbours,
        };
        const struct filled filled = fill(&input);
        /* 0 and 4 are equally near; 6 is the only bone that 5 can reach. */
        check_joints(filled.joints, 8, (const uint16_t[]){1, 2, 0, 4, 5, 6, EMPTY, EMPTY});
        assert_true(filled.weights[0] == 0.75F && filled.weights[1] == 0.25F);
        assert_true(filled.weights[2] == 0.0F && filled.weights[4] == 1.0F);
        assert_int_equal(filled.report.filled_count, 3);
        assert_int_equal(filled.report.empty_count, 2);
        assert_int_equal(filled.report.reduced_count, 0);
    }
}

static void too_many_influences_keep_the_largest(void **state)
{
    (void)state;
    const uint32_t offsets[2] = {0, 5};
    const uint16_t joints[5] = {6, 3, 1, 0, 2};
    const float weights[5] = {0.1F, 0.3F, 0.2F, 0.2F, 0.2F};
    struct skd_slots_input input = {
        .vertex_count = 1,
        .slot_count = 3,
        .fill = SKD_FILL_NONE,
        .influence_offsets = offsets,
        .influence_joints = joints,
        .influence_weights = weights,
    };
    const struct filled filled = fill(&input);
    check_joints(filled.joints, 3, (const uint16_t[]){3, 0, 1});
    assert_true(fabsf(filled.weights[0] - 3.0F / 7.0F) < 1e-7F);
    assert_true(fabsf(filled.weights[2] - 2.0F / 7.0F) < 1e-7F);
    const double sum =
        (double)filled.weights[0] + (double)filled.weights[1] + (double)filled.weights[2];
    assert_true(fabs(sum - 1.0) <= 1e-7);
    assert_int_equal(filled.report.reduced_count, 1);
    assert_true(fabsf(filled.report.largest_cut - 0.3F) < 1e-6F);
}

/* Four vertices in a row, at x = 0, 1, 2, 3, one bone each. */
static const uint32_t row_offsets[5] = {0, 1, 2, 3, 4};
static const uint16_t row_joints[4] = {0, 1, 2, 3};
static const float row_weights[4] = {1, 1, 1, 1};
static const float row_rest[12] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0};
static const uint32_t row_neighbour_offsets[5] = {0, 1, 3, 5, 6};
static const uint32_t row_neighbours[6] = {1, 0, 2, 3, 1, 2};

static struct skd_slots_input row_input(int slots, enum skd_fill rule)
{
    return (struct skd_slots_input){
        .vertex_count = 4,
        .slot_count = slots,
        .fill = rule,
        .rest = row_rest,
        .influence_offsets = row_offsets,
        .influence_joints = row_joints,
        .influence_weights = row_weights,
        .neighbour_offsets = row_neighbour_offsets,
        .neighbours = row_neighbours,
    };
}

static void infection_spreads_along_edges(void **state)
{
    (void)state;
    struct skd_slots_input input = row_input(3, SKD_FILL_INFECT);
    struct filled filled = fill(&input);
    check_joints(filled.joints, 12, (const uint16_t[]){0, 1, 2, 1, 0, 2, 2, 1, 3, 3, 2, 1});
    assert_int_equal(filled.report.filled_count, 8);
    /* Four bones reach everyone; the fifth slot is left to hops. */
    input = row_input(5, SKD_FILL_INFECT);
    filled = fill(&input);
    check_joints(filled.joints, 5, (const uint16_t[]){0, 1, 2, 3, 4});
    check_joints(filled.joints + 15, 5, (const uint16_t[]){3, 2, 1, 0, 4});
}

static void neighbours_come_ring_after_ring(void **state)
{
    (void)state;
    struct skd_slots_input input = row_input(4, SKD_FILL_NEIGHBOURS);
    const struct filled filled = fill(&input);
    check_joints(filled.joints, 8, (const uint16_t[]){0, 1, 2, 3, 1, 0, 2, 3});
    check_joints(filled.joints + 8, 8, (const uint16_t[]){2, 1, 3, 0, 3, 2, 1, 0});
}

static void only_bones_of_the_own_skin_are_taken(void **state)
{
    (void)state;
    const uint16_t bone_skin[BONES] = {0, 1, 0, 1, 0, 0, 0}, vertex_skin[4] = {0, 1, 0, 1};
    const enum skd_fill fills[] = {SKD_FILL_HOP, SKD_FILL_INFECT, SKD_FILL_NEIGHBOURS};
    for (int i = 0; i < 3; i++) {
        struct skd_slots_input input = row_input(4, fills[i]);
        input.bone_skin = bone_skin;
        input.vertex_skin = vertex_skin;
        const struct filled filled = fill(&input);
        for (int v = 0; v < 4; v++) {
            for (int slot = 0; slot < 4; slot++) {
                const uint16_t bone = filled.joints[4 * v + slot];
                assert_true(bone == EMPTY || bone_skin[bone] == vertex_skin[v]);
            }
        }
        check_joints(filled.joints + 4, 4, (const uint16_t[]){1, 3, EMPTY, EMPTY});
    }
}

static double sum_of(const float *weights, int count)
{
    double sum = 0;
    for (int i = 0; i < count; i++)
        sum += (double)weights[i];
    return sum;
}

/* Random rows that sum to nearly one: scaled they sum to one, keep their proportions, and come out
 * the same when they are scaled again; good ones are not touched. */
static void rows_are_normalised_once(void **state)
{
    (void)state;
    const uint16_t joints[8] = {3, 1, EMPTY, 0, 2, EMPTY, 4, 5};
    srand(5);
    for (int round = 0; round < 20000; round++) {
        const int n = round % 2 != 0 ? 8 : 4;
        float row[8] = {0}, before[8], once[8];
        for (int i = 0; i < n; i++)
            row[i] = joints[i] == EMPTY || rand() % 4 == 0 ? 0.0F : (float)rand() / (float)RAND_MAX;
        row[0] += 0.01F;
        const double wanted = 1 + 1e-3 * ((double)rand() / RAND_MAX * 2 - 1);
        const double sum = sum_of(row, n);
        for (int i = 0; i < n; i++)
            row[i] = (float)((double)row[i] / sum * wanted);
        memcpy(before, row, sizeof row);
        skd_slots_normalise(n, joints, row);
        assert_true(fabs(sum_of(row, n) - 1) <= 1e-7);
        for (int i = 0; i < n; i++) {
            assert_true(row[i] >= 0 && (joints[i] != EMPTY || row[i] == 0));
            const double exact = (double)before[i] / sum_of(before, n);
            assert_true(fabs((double)row[i] - exact) <= 2e-7);
        }
        memcpy(once, row, sizeof row);
        skd_slots_normalise(n, joints, row);
        assert_memory_equal(row, once, sizeof row);
    }
    float good[4] = {0.3F, 0.7F - 0x1p-25F, 0, 5e-10F}, kept[4];
    memcpy(kept, good, sizeof good);
    skd_slots_normalise(4, joints, good);
    assert_memory_equal(good, kept, sizeof good);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hops_through_the_nearest_common_ancestor),
        cmocka_unit_test(loose_vertex_is_filled_by_hops),
        cmocka_unit_test(too_many_influences_keep_the_largest),
        cmocka_unit_test(infection_spreads_along_edges),
        cmocka_unit_test(neighbours_come_ring_after_ring),
        cmocka_unit_test(only_bones_of_the_own_skin_are_taken),
        cmocka_unit_test(rows_are_normalised_once),
    };
    return cmocka_run_group_tests_name("slots", tests, NULL, NULL);
}
