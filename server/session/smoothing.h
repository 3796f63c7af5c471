/* Smoothing of a stroke's change: each vertex is drawn to what its mesh neighbours changed by.
 *
 *     (mu L)^2 |w - pull|^2    pull_i = o_i + mean over the neighbours of (w - o) of slot i's bone
 *
 * Stage: job -> [pure solve], inside session/. Thread: a worker.
 * The first pass solves without; every further one takes the neighbours' weights from the pass
 * before (Jacobi), so that the result depends neither on the vertices' order nor on the workers.
 * Neighbours outside of the stroke count with the weights that they have.
 */
#ifndef SKD_SESSION_SMOOTHING_H
#define SKD_SESSION_SMOOTHING_H

#include "session/stroke.h"

/* Makes stroke->smoothing and sets the number of passes. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_smoothing_create(struct skd_stroke *stroke,
                                                    struct skd_error *error);
void skd_smoothing_destroy(struct skd_smoothing *smoothing); /* NULL is fine */

/* Between two passes. */
void skd_smoothing_next(struct skd_stroke *stroke);

/* Solves the batch (items from `first` on) once more, drawn to its neighbours. */
void skd_smoothing_solve(struct skd_stroke *stroke, const struct skd_solve_batch *batch,
                         size_t first);

#endif
