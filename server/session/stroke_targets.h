/* What a stroke's vertices are drawn to: the client's positions, the mask, twins, and pins.
 *
 * Stage: job, inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_TARGETS_H
#define SKD_SESSION_STROKE_TARGETS_H

#include "session/stroke.h"

/* Makes the stroke's step (vertices, pin change, shape change) and its poses with their targets,
 * from an input that was checked. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_gather(struct skd_stroke *stroke,
                                                 struct skd_error *error);

#endif
