/* A stroke's input against its session, before anything is solved.
 *
 * Stage: job, inside session/. Thread: a worker.
 */
#ifndef SKD_SESSION_STROKE_CHECK_H
#define SKD_SESSION_STROKE_CHECK_H

#include "session/stroke.h"

/* Checks everything that a client chose and marks what is locked (stroke->bone_locked,
 * vertex_locked). Errors: those of skd_stroke_prepare. */
SKD_MUST_CHECK enum skd_status skd_stroke_check(struct skd_stroke *stroke, struct skd_error *error);

#endif
