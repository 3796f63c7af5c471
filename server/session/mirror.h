/* One side's weights for the other side: across a plane, with the bones' names paired.
 *
 *          read  |  written
 *            a --|-- a'         the vertex nearest to where a' reflects to, within the tolerance
 *                b              on the plane: the mean of its row and that row mirrored
 *
 * Stage: job -> result. Thread: a worker, while the session is lent to the job.
 * Sides are those of the rig's own rest positions (bind space), which no stroke moves.
 */
#ifndef SKD_SESSION_MIRROR_H
#define SKD_SESSION_MIRROR_H

#include "session/rows.h"

struct skd_mirror_input {
    struct skd_edit_scope scope; /* of the side written; what lies on the other is passed over */
    int axis;                    /* 0 x, 1 y, 2 z: the plane is across it */
    bool from_negative;          /* the side below the origin is read, else that above */
    double origin;               /* where the plane is, in bind space */
    double tolerance; /* of matching, as a share of the rest positions' bounding box's diagonal */
};

struct skd_mirror_report {
    size_t unmatched; /* vertices left as they are: nothing lies where they reflect to */
    uint8_t
        *unpaired; /* [bones] 1: weights of it were mirrored and stay on it, though it has a side
                      (by name, or by where it begins) and no partner; the caller's to free */
};

/* Makes the step that mirrors the weights. A written row has the source's weights on the partners
 * of its bones (bone_pairs.h); a partner without a slot takes that of a bone that is not wanted.
 * On the plane is what is nearer to its own reflection than to any vertex that is read, as all is
 * within a hundredth of the tolerance; such a row keeps a bone and its partner or neither. Only
 * vertices of the same skin match. Twins of named vertices go along.
 * Errors: those of skd_rows_list, SKD_CANCELLED. */
SKD_MUST_CHECK enum skd_status skd_mirror_prepare(struct skd_session *session,
                                                  const struct skd_mirror_input *input,
                                                  struct skd_step **step,
                                                  struct skd_mirror_report *report,
                                                  struct skd_error *error);

#endif
