/* The stiffness of a stroke from its own targets.
 *
 * Stage: job, before the solve, inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_STIFFNESS_H
#define SKD_SESSION_STROKE_STIFFNESS_H

#include "session/stroke.h"

/* Sets the stroke's stiffness from a sample of its targets. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_choose_stiffness(struct skd_stroke *stroke,
                                                           struct skd_error *error);

#endif
