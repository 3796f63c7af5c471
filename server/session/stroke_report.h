/* What a client is told of a stroke: residuals, and how much changed.
 *
 * Stage: result, inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_REPORT_H
#define SKD_SESSION_STROKE_REPORT_H

#include "session/stroke.h"

/* After the last pass: fills the stroke's residuals, counts and warnings, and `told`.
 * Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_finish(struct skd_stroke *stroke,
                                                 struct skd_error *error);

#endif
