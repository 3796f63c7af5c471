/* See changes.h. */
#include "requests/changes.h"

#include "requests/state.h"

#include <stdlib.h>

static size_t capacity_of(const struct skd_changes *changes)
{
    return changes->many != NULL ? changes->capacity : SKD_CHANGES_FEW;
}

static struct skd_change *entry(struct skd_changes *changes, size_t index)
{
    struct skd_change *items = changes->many != NULL ? changes->many : changes->few;
    return &items[(changes->first + index) & (capacity_of(changes) - 1)];
}

struct skd_change skd_change_copy(const struct skd_change *change)
{
    struct skd_change copy = *change;
    skd_step_hold(copy.step);
    if (copy.shape != NULL)
        skd_pose_hold(copy.shape);
    return copy;
}

void skd_change_release(struct skd_change *change)
{
    skd_step_release(change->step);
    skd_pose_release(change->shape);
    *change = (struct skd_change){0};
}

static void drop_first(struct skd_changes *changes)
{
    skd_change_release(entry(changes, 0));
    changes->first = (changes->first + 1) & (capacity_of(changes) - 1);
    changes->count--;
}

/* What the history lets go of, later strokes had undone or pushed out: only that costs extra. */
static void drop_surplus(struct skd_changes *changes)
{
    size_t bytes = 0, kept = 0;
    while (kept < changes->count) {
        const struct skd_step *step = entry(changes, changes->count - 1 - kept)->step;
        bytes += step->in_history ? 0 : skd_step_bytes(step);
        if (bytes > SKD_CHANGES_BYTES_MAX && kept > 0)
            break;
        kept++;
    }
    while (changes->count > kept)
        drop_first(changes);
}

static void make_room(struct skd_changes *changes)
{
    size_t capacity = capacity_of(changes);
    if (changes->count < capacity)
        return;
    struct skd_change *items =
        capacity < SKD_CHANGES_MAX ? calloc(2 * capacity, sizeof *items) : NULL;
    if (items == NULL) {
        drop_first(changes);
        return;
    }
    for (size_t i = 0; i < changes->count; i++)
        items[i] = *entry(changes, i);
    free(changes->many);
    changes->many = items;
    changes->capacity = 2 * capacity;
    changes->first = 0;
}

void skd_changes_add(struct skd_live *live, const struct skd_change *change)
{
    struct skd_changes *changes = &live->changes;
    make_room(changes);
    struct skd_change *added = entry(changes, changes->count++);
    *added = *change;
    added->shape = change->step->shape != NULL ? change->step->shape->sheet->pose : NULL;
    *added = skd_change_copy(added);
    drop_surplus(changes);
}

const struct skd_change *skd_changes_find(struct skd_changes *changes, uint64_t revision)
{
    if (changes->count == 0)
        return NULL;
    uint64_t oldest = entry(changes, 0)->revision;
    if (revision < oldest || revision - oldest >= changes->count)
        return NULL;
    return entry(changes, (size_t)(revision - oldest));
}

const struct skd_change *skd_changes_nearest(struct skd_changes *changes, uint64_t revision)
{
    const struct skd_change *change = skd_changes_find(changes, revision);
    SKD_ASSERT(changes->count > 0);
    return change != NULL ? change : entry(changes, 0);
}

void skd_changes_finish(struct skd_changes *changes)
{
    while (changes->count > 0)
        drop_first(changes);
    free(changes->many);
    changes->many = NULL;
}
