/* What the last revisions of a session did, for those who are to hear of it later.
 *
 *     revisions   [ 812 | 813 | 814 | 815 | 816 ]     the ring: no gaps, the newest at the end
 *                          ^ a slow listener was told up to here
 *
 * Stage: commit -> reply. Thread: the loop; a worker reads the steps of entries that were copied
 * for it (skd_change_copy). An entry holds its step, so the ring reaches back beyond what can still
 * be undone; at most SKD_CHANGES_MAX revisions, and SKD_CHANGES_BYTES_MAX of steps that the history
 * does not hold anyway. Who is behind it fetches the weights again.
 */
#ifndef SKD_REQUESTS_CHANGES_H
#define SKD_REQUESTS_CHANGES_H

#include "session/history.h"

enum { SKD_CHANGES_MAX = 1024 };
#define SKD_CHANGES_BYTES_MAX ((size_t)64 << 20)

struct skd_live;

struct skd_change {
    uint64_t revision;
    const char *cause;        /* a static word: "stroke", "set", "undo", ... */
    struct skd_author author; /* who asked */
    struct skd_step *step;
    struct skd_pose *shape; /* whose corrective shape the step changes, or NULL */
    bool undo;              /* the step's `before` is what holds at this revision */
    uint64_t knower;        /* the connection whose own answer tells it, or 0 */
};

enum { SKD_CHANGES_FEW = 16 };

struct skd_changes {
    struct skd_change few[SKD_CHANGES_FEW]; /* room that needs no memory */
    struct skd_change *many;                /* [capacity] instead, once there were more; or NULL */
    size_t capacity;                        /* of `many`: a power of two, or 0 */
    size_t first;                           /* where the ring begins */
    size_t count;
};

/* Adds the newest revision: `change` without its shape, which is filled in here. The
 * step is held. Cannot fail: without memory the ring does not grow, and who is farther behind is
 * told to fetch the weights. */
void skd_changes_add(struct skd_live *live, const struct skd_change *change);

/* The change that made a revision, or NULL where the ring does not reach back to it. Borrowed until
 * the next skd_changes_add. */
const struct skd_change *skd_changes_find(struct skd_changes *changes, uint64_t revision);

/* The same, or the oldest change there is; after the first one that was added there always is one.
 */
const struct skd_change *skd_changes_nearest(struct skd_changes *changes, uint64_t revision);

/* A copy with references of its own, for as long as somebody needs it. */
struct skd_change skd_change_copy(const struct skd_change *change);
void skd_change_release(struct skd_change *change);

void skd_changes_finish(struct skd_changes *changes);

#endif
