/* See merging.h. */
#include "requests/merging.h"

#include <stdlib.h>
#include <string.h>

static size_t row_bytes(const struct skd_step *step)
{
    size_t slots = (size_t)step->slot_count;
    return sizeof(uint32_t) + slots * sizeof(float) +
           (step->joints_after != NULL ? slots * sizeof(uint16_t) : 0) +
           (step->rest_after != NULL ? 3 * sizeof(float) : 0) +
           (step->shape != NULL ? SKD_SHAPE_NUMBERS * sizeof(float) : 0);
}

static bool tell_the_same(const struct skd_change *a, const struct skd_change *b)
{
    return (a->step->joints_after != NULL) == (b->step->joints_after != NULL) &&
           (a->step->rest_after != NULL) == (b->step->rest_after != NULL) && a->shape == b->shape;
}

struct skd_run skd_run_take(struct skd_live *live, uint64_t after, size_t bytes_max,
                            size_t rows_max)
{
    const size_t vertices = live->session->rig->mesh.vertex_count;
    struct skd_run run = {.last = after};
    while (run.last < live->durable_revision) {
        const struct skd_change *change = skd_changes_find(&live->changes, run.last + 1);
        SKD_ASSERT(change != NULL);
        if (change->step->count > 0) {
            size_t rows = run.rows + change->step->count;
            rows = rows < vertices ? rows : vertices;
            size_t bytes = row_bytes(change->step);
            if (run.source != NULL &&
                (!tell_the_same(run.source, change) || rows > rows_max || rows * bytes > bytes_max))
                break;
            run.rows = rows;
            run.row_bytes = bytes;
            run.source = change;
            run.sources++;
        }
        run.last++;
    }
    return run;
}

void skd_merged_destroy(struct skd_merged *merged)
{
    if (merged == NULL)
        return;
    free(merged->vertices);
    free(merged->weights);
    free(merged->joints);
    free(merged->rest);
    free(merged->offsets);
    free(merged);
}

/* Room for `rows` as the step tells them. NULL: no memory. */
static struct skd_merged *create_like(const struct skd_step *step, size_t rows)
{
    struct skd_merged *merged = calloc(1, sizeof *merged);
    if (merged == NULL)
        return NULL;
    size_t slots = (size_t)step->slot_count;
    bool joints = step->joints_after != NULL, rest = step->rest_after != NULL;
    bool shape = step->shape != NULL;
    merged->slot_count = step->slot_count;
    merged->vertices = malloc(rows * sizeof *merged->vertices);
    merged->weights = malloc(rows * slots * sizeof *merged->weights);
    merged->joints = joints ? malloc(rows * slots * sizeof *merged->joints) : NULL;
    merged->rest = rest ? malloc(rows * 3 * sizeof *merged->rest) : NULL;
    merged->offsets = shape ? malloc(rows * SKD_SHAPE_NUMBERS * sizeof *merged->offsets) : NULL;
    if (merged->vertices != NULL && merged->weights != NULL && joints == (merged->joints != NULL) &&
        rest == (merged->rest != NULL) && shape == (merged->offsets != NULL))
        return merged;
    skd_merged_destroy(merged);
    return NULL;
}

/* Copies row `from` of an array behind the last one of another; both NULL: nothing. */
static void copy_row(void *target, size_t to, const void *source, size_t from, size_t bytes)
{
    if (target != NULL)
        memcpy((char *)target + to * bytes, (const char *)source + from * bytes, bytes);
}

/* Adds the rows of vertices that no newer change has told. */
static void add_unseen(struct skd_merged *merged, const struct skd_change *change, uint8_t *seen)
{
    const struct skd_step *step = change->step;
    const size_t slots = (size_t)step->slot_count;
    const bool undo = change->undo;
    const float *offsets = NULL;
    if (step->shape != NULL)
        offsets = undo ? step->shape->before : step->shape->after;
    for (size_t i = 0; i < step->count; i++) {
        uint32_t vertex = step->vertices[i];
        uint8_t bit = (uint8_t)(1U << (vertex & 7));
        if ((seen[vertex >> 3] & bit) != 0)
            continue;
        seen[vertex >> 3] |= bit;
        size_t to = merged->count++;
        merged->vertices[to] = vertex;
        copy_row(merged->weights, to, undo ? step->before : step->after, i, slots * sizeof(float));
        copy_row(merged->joints, to, undo ? step->joints_before : step->joints_after, i,
                 slots * sizeof(uint16_t));
        copy_row(merged->rest, to, undo ? step->rest_before : step->rest_after, i,
                 3 * sizeof(float));
        copy_row(merged->offsets, to, offsets, i, SKD_SHAPE_NUMBERS * sizeof(float));
    }
}

static const struct skd_step *find_telling(const struct skd_change *changes, size_t count)
{
    while (count > 0 && changes[count - 1].step->count == 0)
        count--;
    SKD_ASSERT(count > 0);
    return changes[count - 1].step;
}

enum skd_status skd_merge(const struct skd_change *changes, size_t count, size_t vertex_count,
                          size_t rows, struct skd_merged **merged, struct skd_error *error)
{
    struct skd_merged *made = create_like(find_telling(changes, count), rows);
    uint8_t *seen = calloc(vertex_count / 8 + 1, 1);
    if (made == NULL || seen == NULL) {
        skd_merged_destroy(made);
        free(seen);
        return skd_fail_memory(error, "an update");
    }
    for (size_t i = count; i-- > 0;)
        add_unseen(made, &changes[i], seen);
    free(seen);
    *merged = made;
    return SKD_OK;
}
