/* Poses in a file: each name with its matrices stands there once, whoever refers to it.
 *
 * Stage: journal. Thread: that of the store. Poses are read (name, matrices), never counted.
 */
#ifndef SKD_JOURNAL_POSE_ROWS_H
#define SKD_JOURNAL_POSE_ROWS_H

#include "journal/store.h"
#include "session/session.h"

struct skd_pose_row {
    uint64_t id;
    uint64_t digest[2]; /* of name and matrices: the same digest, the same pose */
    bool is_in_sheets;  /* of the base or of a step, now or once */
    /* Reading: one reference held; NULL where the row is damaged. */
    struct skd_pose *pose;
};

/* A name and the pose that it was given last. */
struct skd_named_row {
    uint64_t place;
    size_t row; /* in skd_pose_rows.items */
    char name[SKD_POSE_NAME_BYTES_MAX + 1];
};

struct skd_pose_rows {
    size_t bone_count;
    size_t count, capacity;
    struct skd_pose_row *items; /* by id, rising */
    uint64_t next_id;
    size_t named_count, named_capacity;
    struct skd_named_row *named; /* by place, rising */
    uint64_t next_place;
};

void skd_pose_rows_finish(struct skd_pose_rows *poses);

/* Finds the pose's row, or writes it. *sum: what stands for it in the checksums of others. */
SKD_MUST_CHECK enum skd_status skd_pose_rows_need(struct skd_store *store,
                                                  struct skd_pose_rows *poses,
                                                  const struct skd_pose *pose, bool for_sheet,
                                                  uint64_t *id, uint64_t *sum,
                                                  struct skd_error *error);

/* Puts a pose under its name, as the last one put; what had the name before goes where no sheet
 * needs it. */
SKD_MUST_CHECK enum skd_status skd_pose_rows_put(struct skd_store *store,
                                                 struct skd_pose_rows *poses,
                                                 const struct skd_pose *pose,
                                                 struct skd_error *error);

/* Reads all rows into empty tables of `bone_count`. *damaged: rows that were not whole; they are
 * left out. `make`: the poses themselves too. */
SKD_MUST_CHECK enum skd_status skd_pose_rows_read(struct skd_store *store,
                                                  struct skd_pose_rows *poses, bool make,
                                                  size_t *damaged, struct skd_error *error);

/* The pose with that id and its sum, borrowed, or NULL. */
struct skd_pose *skd_pose_rows_find(const struct skd_pose_rows *poses, uint64_t id, uint64_t *sum);

#endif
