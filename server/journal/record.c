/* See record.h and journal.h. */
#include "journal/record.h"

#include <stdlib.h>
#include <string.h>

static struct skd_record *create(enum skd_record_kind kind)
{
    struct skd_record *record = calloc(1, sizeof *record);
    if (record != NULL) {
        record->kind = kind;
        record->bytes = sizeof *record;
    }
    return record;
}

void skd_record_destroy(struct skd_record *record)
{
    if (record == NULL)
        return;
    for (size_t i = 0; i < record->pose_count; i++)
        skd_pose_release(record->poses[i]);
    free(record->poses);
    skd_step_release(record->step);
    skd_guard_row_finish(&record->guard);
    free(record->client_id);
    free(record->answer);
    free(record);
}

/* Holds the poses of a step's sheets: the sheets themselves may go before the step is written. */
static bool hold_poses(struct skd_record *record, const struct skd_step *step)
{
    size_t count = step->shape != NULL ? 1 : 0;
    for (const struct skd_sheet_change *pins = step->pins; pins != NULL; pins = pins->next)
        count++;
    record->poses = malloc(count * sizeof(struct skd_pose *) + 1);
    if (record->poses == NULL)
        return false;
    for (const struct skd_sheet_change *pins = step->pins; pins != NULL; pins = pins->next)
        record->poses[record->pose_count++] = skd_pose_hold(pins->sheet->pose);
    if (step->shape != NULL)
        record->poses[record->pose_count++] = skd_pose_hold(step->shape->sheet->pose);
    return true;
}

struct skd_record *skd_record_create_step(struct skd_step *step, uint64_t revision, size_t dropped)
{
    struct skd_record *record = create(SKD_RECORD_STEP);
    if (record == NULL || !hold_poses(record, step)) {
        skd_record_destroy(record);
        return NULL;
    }
    record->step = skd_step_hold(step);
    record->revision = revision;
    record->dropped = dropped;
    record->bytes += skd_step_bytes(step);
    return record;
}

struct skd_record *skd_record_create_move(int direction, size_t index, uint64_t revision)
{
    struct skd_record *record = create(SKD_RECORD_MOVE);
    if (record != NULL) {
        record->direction = direction;
        record->index = index;
        record->revision = revision;
    }
    return record;
}

struct skd_record *skd_record_create_pose(struct skd_pose *pose)
{
    struct skd_record *record = create(SKD_RECORD_POSE);
    if (record == NULL || (record->poses = malloc(sizeof(struct skd_pose *))) == NULL) {
        skd_record_destroy(record);
        return NULL;
    }
    record->poses[record->pose_count++] = skd_pose_hold(pose);
    return record;
}

struct skd_record *skd_record_create_guard(const struct skd_guards *guards)
{
    struct skd_record *record = create(SKD_RECORD_GUARD);
    if (record == NULL || skd_guard_row_pack(guards, &record->guard, NULL) != SKD_OK) {
        skd_record_destroy(record);
        return NULL;
    }
    record->bytes += record->guard.bytes;
    return record;
}

struct skd_record *skd_record_create_exported(uint64_t revision)
{
    struct skd_record *record = create(SKD_RECORD_EXPORTED);
    if (record != NULL)
        record->revision = revision;
    return record;
}

struct skd_record *skd_record_create_answer(void)
{
    return create(SKD_RECORD_ANSWER);
}

struct skd_record *skd_record_create_settings(enum skd_durability durability,
                                              uint64_t history_bytes, size_t dropped)
{
    struct skd_record *record = create(SKD_RECORD_SETTINGS);
    if (record != NULL) {
        record->durability = durability;
        record->history_bytes = history_bytes;
        record->dropped = dropped;
    }
    return record;
}

bool skd_record_remember(struct skd_record *record, const char *client_id, uint64_t sequence,
                         const char *answer)
{
    record->sequence = sequence;
    record->client_id = strdup(client_id);
    record->answer = strdup(answer);
    if (record->client_id != NULL && record->answer != NULL)
        return true;
    free(record->client_id);
    free(record->answer);
    record->client_id = record->answer = NULL;
    return false;
}
