/* A stroke on its way through a session: checked, solved in chunks, written.
 *
 *     skd_stroke_claim       the sheets that it may write to                 the loop
 *     skd_stroke_prepare     check the arrays, gather what is solved         one worker
 *     skd_stroke_solve       any run of the vertices, in any order           many workers at once
 *     skd_stroke_next_pass   what a further pass over them all needs         one worker
 *     skd_stroke_finish      residuals and counts                            one worker
 *     skd_session_write      into the session's weights                      the same worker
 *
 * Stage: job -> [pure solve] -> result. Thread: a worker, while the session is lent to the job.
 * Until the write nothing of the session has changed that anybody is told of, so a stroke can be
 * dropped at any point.
 *
 * Three requests are strokes: one that brings targets in a pose (stroke.apply), one that solves for
 * pins as they are (pins.solve: no positions), one that brings targets of all vertices in several
 * poses (session.refit: frames).
 */
#ifndef SKD_SESSION_STROKE_RUN_H
#define SKD_SESSION_STROKE_RUN_H

#include "session/stroke_pass.h"
#include "session/stroke_report.h"

/* Finds or makes the sheets of the stroke's pose (which they hold). Loop thread, at the beginning
 * of the turn. Errors: SKD_TOO_LARGE (targets in too many poses), SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_stroke_claim(struct skd_stroke *stroke, struct skd_error *error);

/* Checks the input against the session and makes room for the result. Errors: SKD_COUNT_MISMATCH,
 * SKD_BAD_INDEX (also a vertex named twice), SKD_NOT_FINITE, SKD_BAD_PARAMS (a mask beyond 0..1),
 * SKD_NO_BONE, SKD_UNSUPPORTED (the thesis's method with other than 4 slots or with locked bones;
 * rest positions where no vertex has targets in two poses), SKD_NO_MEMORY. Call skd_stroke_dismiss
 * in any case. */
SKD_MUST_CHECK enum skd_status skd_stroke_prepare(struct skd_stroke *stroke,
                                                  struct skd_error *error);

/* Frees what the stroke owns but for the step, which it lets go of (loop thread: the step's
 * references are counted there). */
void skd_stroke_dismiss(struct skd_stroke *stroke);

#endif
