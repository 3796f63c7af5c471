/* Whether a stroke's poses tell bones apart.
 *
 * Stage: job, inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_POSE_SPREAD_H
#define SKD_SESSION_POSE_SPREAD_H

#include "session/stroke.h"

/* Counts the vertices whose bones hardly move against each other in any of the poses: there the
 * targets do not say which bones a vertex needs. 0 where these are too few to matter. */
size_t skd_pose_spread_count_still(const struct skd_stroke *stroke);

#endif
