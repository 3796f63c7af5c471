/* A stroke on its way through a session: checked, solved in chunks, written.
 *
 *     skd_stroke_prepare   check the arrays, gather what is solved       one worker
 *     skd_stroke_solve     any run of the vertices, in any order         many workers at once
 *     skd_stroke_finish    residuals                                     one worker
 *     skd_session_write    into the session's weights                    the same worker
 *
 * Stage: job -> [pure solve] -> result. Thread: a worker, while the session is lent to the job.
 * Until the write nothing of the session has changed, so a stroke can be dropped at any point.
 */
#ifndef SKD_SESSION_STROKE_H
#define SKD_SESSION_STROKE_H

#include "session/session.h"

/* What a client asked for. Arrays and names are borrowed for the stroke's life. */
struct skd_stroke_input {
    const uint32_t *vertices; /* [count] */
    const float *positions;   /* [count][3] posed positions wanted */
    size_t count;
    const char *const *locked_bones;
    size_t locked_bone_count;
    const uint32_t *locked_vertices;
    size_t locked_vertex_count;
    struct skd_solve_options options; /* length is filled from the rig */
};

struct skd_residual {
    double mean; /* scene units */
    double max;
};

struct skd_stroke {
    const struct skd_session *session; /* borrowed */
    struct skd_pose *pose;             /* borrowed; the job holds it */
    struct skd_stroke_input input;
    struct skd_step *step;  /* vertices, before, after: the result */
    const float *targets;   /* [step->count][3]; the input's own positions or `expanded` */
    float *expanded;        /* owned, when twins joined; else NULL */
    float *residual_before; /* [step->count] owned */
    float *residual_after;
    uint8_t *bone_locked;   /* [bones] owned, or NULL */
    uint8_t *vertex_locked; /* [V] owned, or NULL */
    /* filled by skd_stroke_finish */
    struct skd_residual before;
    struct skd_residual after;
    size_t unreached_count; /* farther than `reach` from their target */
    double reach;           /* scene units */
};

/* Checks the input against the session and makes room for the result. Errors: SKD_COUNT_MISMATCH,
 * SKD_BAD_INDEX (also a vertex named twice), SKD_NOT_FINITE, SKD_NO_BONE, SKD_UNSUPPORTED (the
 * thesis's method with other than 4 slots or with locked bones), SKD_NO_MEMORY. Call
 * skd_stroke_dismiss in any case. */
SKD_MUST_CHECK enum skd_status skd_stroke_prepare(struct skd_stroke *stroke,
                                                  struct skd_error *error);

/* Solves vertices [first, first + count) of the step. */
void skd_stroke_solve(struct skd_stroke *stroke, size_t first, size_t count);

void skd_stroke_finish(struct skd_stroke *stroke);

/* Frees what the stroke owns but for the step, which it lets go of (loop thread: the step's
 * references are counted there). */
void skd_stroke_dismiss(struct skd_stroke *stroke);

#endif
