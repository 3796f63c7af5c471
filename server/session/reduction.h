/* Fewer influences a vertex: which to keep, and how far that moves the vertex.
 *
 *     by size    the largest weights stay
 *     by poses   those stay that move it least over poses (solver/reduce.h)
 *
 * Stage: rig session (the cut at its start), job -> result (weights.reduce). Thread: a worker.
 */
#ifndef SKD_SESSION_REDUCTION_H
#define SKD_SESSION_REDUCTION_H

#include "session/rows.h"

/* Compares the vertices that had more influences than slots, skinned with all of them and with
 * what was kept, in at most 16 poses: spread over the clips, or joint rotations of 25 degrees when
 * the rig has none. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_reduction_measure(const struct skd_session *session,
                                                     const struct skd_influences *influences,
                                                     struct skd_reduction *reduction,
                                                     struct skd_error *error);

/* Influences of which no vertex has more than the session has slots, chosen by poses of the rig's
 * own: frames of the clips (at most 24) and 24 that bend every joint by 25 degrees. The session's
 * rows, which an earlier cut by size may have left, tell the frames apart. `cut` is the caller's to
 * finish, *largest_cut the most weight that one vertex lost.
 * Errors: SKD_UNSUPPORTED (too many bones to compare), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_reduction_cut(const struct skd_session *session,
                                                 const struct skd_influences *influences,
                                                 struct skd_influences *cut, float *largest_cut,
                                                 struct skd_error *error);

/* What weights.reduce asks for. Borrowed. */
struct skd_reduction_input {
    struct skd_edit_scope scope;
    int keep; /* influences, 1..8 */
    bool by_size;
    struct skd_pose *const *poses; /* none: the session's guard, else as skd_reduction_cut */
    size_t pose_count;
};

/* Makes the step that leaves each vertex at most `keep` weights, scaled to sum to one within 1e-7
 * as stored; slots keep their bones. A row that has no more keeps its bits; one that has loses
 * weights below 0 first, which strokes with "affine" leave. Twins of named vertices go along.
 * `moved` tells how far the reduced vertices moved in those poses (the least alike 64 of more).
 * Errors: those of skd_rows_list, SKD_UNSUPPORTED, SKD_CANCELLED. */
SKD_MUST_CHECK enum skd_status
skd_reduction_prepare(struct skd_session *session, const struct skd_reduction_input *input,
                      struct skd_step **step, struct skd_reduction *moved, struct skd_error *error);

#endif
