/* Several changes as one: the newest value of each vertex.
 *
 *     pending   [stroke] [stroke] [undo] | [stroke + slots] [stroke + slots] | [stroke] ...
 *               one message              | another                           |
 *
 * Stage: reply. Thread: the loop picks a run of changes, a worker merges it. An array in a message
 * has a row for each of its vertices, so only changes that tell the same arrays can be merged: what
 * a stroke did not touch (a vertex's bones, its rest position) nobody can say here without the
 * session. A change of nothing but pins tells no vertices and goes with any.
 */
#ifndef SKD_REQUESTS_MERGING_H
#define SKD_REQUESTS_MERGING_H

#include "requests/state.h"

/* A run of changes that one message can tell. */
struct skd_run {
    uint64_t last;                   /* its last revision */
    size_t rows;                     /* no more vertices than this */
    size_t row_bytes;                /* that each of them takes in a message */
    size_t sources;                  /* changes that tell any vertex */
    const struct skd_change *source; /* the last of these, or NULL; borrowed of the ring */
};

/* The run after a revision (which the ring reaches back to), up to the newest durable one. Only its
 * first change may be larger than that many bytes or rows, and then it is alone. */
struct skd_run skd_run_take(struct skd_live *live, uint64_t after, size_t bytes_max,
                            size_t rows_max);

/* What a run comes to. */
struct skd_merged {
    size_t count;
    int slot_count;
    uint32_t *vertices; /* [count], each once; owned, as are all */
    float *weights;     /* [count][slots] */
    uint16_t *joints;   /* NULL where the run does not tell it, as the next ones */
    float *rest;        /* [count][3] */
    float *offsets;     /* [count][3] */
};

/* Merges changes (oldest first) of a session with so many vertices; at least one tells vertices and
 * none more than `rows` together. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_merge(const struct skd_change *changes, size_t count,
                                         size_t vertex_count, size_t rows,
                                         struct skd_merged **merged, struct skd_error *error);
void skd_merged_destroy(struct skd_merged *merged); /* NULL is fine */

#endif
