/* One record on its way from the loop to the writer and back.
 *
 * Stage: journal. Thread: made and destroyed by the loop; in between the writer reads it. The
 * arrays of the step and of the poses never change; their references are counted on the loop only.
 */
#ifndef SKD_JOURNAL_RECORD_H
#define SKD_JOURNAL_RECORD_H

#include "journal/guard_rows.h"
#include "journal/journal.h"

enum skd_record_kind {
    SKD_RECORD_STEP,
    SKD_RECORD_MOVE,
    SKD_RECORD_POSE,
    SKD_RECORD_GUARD,
    SKD_RECORD_EXPORTED,
    SKD_RECORD_SETTINGS,
    SKD_RECORD_ANSWER,
    /* what the journal itself puts into a queue (writer.c) */
    SKD_RECORD_SUSPENDED,
    SKD_RECORD_END,
};

struct skd_record {
    enum skd_record_kind kind;
    uint64_t revision;              /* STEP, MOVE, EXPORTED */
    struct skd_step *step;          /* STEP: held */
    size_t dropped;                 /* STEP, SETTINGS */
    int direction;                  /* MOVE */
    size_t index;                   /* MOVE */
    size_t pose_count;              /* POSE: 1; STEP: those of its sheets, its pins' first */
    struct skd_pose **poses;        /* [pose_count] owned, each held */
    struct skd_guard_row guard;     /* GUARD */
    enum skd_durability durability; /* SETTINGS */
    uint64_t history_bytes;         /* SETTINGS */
    char *client_id, *answer;       /* owned; NULL: nothing to remember */
    uint64_t sequence;
    /* the journal's own (writer.c) */
    struct skd_journal_file *file;
    struct skd_record *next;
    size_t bytes; /* that wait with it */
    bool is_told; /* done was called, or is not wanted */
    void (*done)(void *user);
    void *user;
};

#endif
