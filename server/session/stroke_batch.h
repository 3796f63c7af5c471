/* What a stroke hands to the solver.
 *
 * Stage: job -> [pure solve], inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_BATCH_H
#define SKD_SESSION_STROKE_BATCH_H

#include "session/stroke.h"

/* What all vertices of a stroke are solved with; items, poses and outputs are the caller's. */
struct skd_solve_batch skd_stroke_batch(const struct skd_stroke *stroke);

/* Solves a batch with slots chosen from lists of candidates [count][SKD_CANDIDATES_MAX]; joints
 * [count][N] takes the slots. */
void skd_stroke_solve_evidence(const struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                               const uint16_t *candidates, uint16_t *joints);

/* The poses' targets from item `first` on; `poses` has room for stroke->pose_count. */
void skd_stroke_point_poses(const struct skd_stroke *stroke, size_t first,
                            struct skd_solve_pose *poses);

#endif
