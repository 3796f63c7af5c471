/* From gathered targets to weights: what a stroke hands to the solver, chunk by chunk.
 *
 * Stage: job -> [pure solve], inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_SOLVE_H
#define SKD_SESSION_STROKE_SOLVE_H

#include "session/stroke.h"

/* What all vertices of a stroke are solved with; items, poses and outputs are the caller's. */
struct skd_solve_batch skd_stroke_batch(const struct skd_stroke *stroke);

/* Solves a batch with slots chosen from lists of candidates [count][SKD_CANDIDATES_MAX]; joints
 * [count][N] takes the slots. */
void skd_stroke_solve_evidence(const struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                               const uint16_t *candidates, uint16_t *joints);

/* Sets the stroke's stiffness from a sample of its targets. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_choose_stiffness(struct skd_stroke *stroke,
                                                           struct skd_error *error);

/* Lists the bones that each vertex may use, near to what it has now: at the session's start in the
 * first pass, as solved by the pass before in others. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_find_candidates(struct skd_stroke *stroke,
                                                          struct skd_error *error);

#endif
