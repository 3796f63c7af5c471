/* One pass of a stroke over its vertices, and the way to the next.
 *
 * Stage: job -> [pure solve], inside session/. Thread: as marked.
 */
#ifndef SKD_SESSION_STROKE_PASS_H
#define SKD_SESSION_STROKE_PASS_H

#include "session/stroke.h"

/* Solves vertices [first, first + count) of the step. Many workers at once. */
void skd_stroke_solve(struct skd_stroke *stroke, size_t first, size_t count);

/* After all vertices were solved, in one worker: goes to the next of pass_count passes. Errors:
 * SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_next_pass(struct skd_stroke *stroke,
                                                    struct skd_error *error);

#endif
