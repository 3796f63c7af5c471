/* What comes of solved weights: rest positions, corrective shape, and how far vertices are left
 * from where they were wanted.
 *
 * Stage: job -> result, inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_OUTCOME_H
#define SKD_SESSION_STROKE_OUTCOME_H

#include "session/stroke.h"

enum { SKD_PIECE_VERTICES = 256 }; /* whose rows fit on the stack */

/* Whether there is anything to do beyond the solver's own residuals: the client asked for another
 * place than the solve did, or something else than weights moves. */
bool skd_stroke_has_outcome(const struct skd_stroke *stroke);

/* Moves the rest positions of a piece (at most SKD_PIECE_VERTICES; items from `first` on) as far
 * as its targets tell, weights with them: into the step's `after` and `rest_after`. */
void skd_stroke_move_rest(struct skd_stroke *stroke, const struct skd_solve_batch *piece,
                          size_t first);

/* After the last pass: the shape and the residuals of a piece. */
void skd_stroke_settle(struct skd_stroke *stroke, const struct skd_solve_batch *piece,
                       size_t first);

#endif
