/* Which bones a stroke's vertices may choose from.
 *
 * Stage: job, between passes, inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_CANDIDATES_H
#define SKD_SESSION_STROKE_CANDIDATES_H

#include "session/stroke.h"

/* Lists the bones that each vertex may use, near to what it has now: at the session's start in the
 * first pass, as solved by the pass before in others. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_find_candidates(struct skd_stroke *stroke,
                                                          struct skd_error *error);

#endif
