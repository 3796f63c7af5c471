/* Poses and strokes of a script, played into a session.
 *
 * Stage: the client's side of a stroke: evaluate the pose, apply the brush, send what moved.
 * Thread: one.
 */
#ifndef SKD_CLI_PLAY_H
#define SKD_CLI_PLAY_H

#include "clients/cli/model.h"
#include "clients/cli/script.h"

/* What came of a stroke. Finish it with skd_outcome_finish. */
struct skd_outcome {
    struct skd_message answer;
    double round_trip_ms; /* from sending to the answer */
    size_t streamed;      /* vertices whose weights came while it was solved */
};
void skd_outcome_finish(struct skd_outcome *outcome);

/* Holds a script against a session: poses, clips, bones, vertices and matrices must be there.
 * Nothing is changed. `path` names the script in errors. */
SKD_MUST_CHECK enum skd_status skd_play_check(struct skd_model *model,
                                              const struct skd_script *script, const char *path,
                                              struct skd_error *error);

/* pose.set. */
SKD_MUST_CHECK enum skd_status
skd_play_pose(struct skd_model *model, const struct skd_script_pose *pose, struct skd_error *error);

/* Applies one stroke, with a progress line on a terminal. Errors: the daemon's; SKD_BAD_PARAMS when
 * the brush touches no vertex. */
SKD_MUST_CHECK enum skd_status skd_play_stroke(struct skd_model *model,
                                               const struct skd_script_stroke *stroke,
                                               struct skd_outcome *outcome,
                                               struct skd_error *error);

/* pins.solve: the vertices pinned in the stroke's pose, or those of them that it names, for all
 * their pins; of the stroke the members that pins.solve takes too. */
SKD_MUST_CHECK enum skd_status skd_play_pins(struct skd_model *model,
                                             const struct skd_script_stroke *stroke,
                                             struct skd_outcome *outcome, struct skd_error *error);

/* A request that solves, with a progress line on a terminal while weights stream in. It is done
 * once, also when the daemon dies on the way (skd_model_call). Takes the body over. */
SKD_MUST_CHECK enum skd_status skd_play_call(struct skd_model *model, const char *method,
                                             cJSON *body, const struct skd_array_out *arrays,
                                             int array_count, struct skd_outcome *outcome,
                                             struct skd_error *error);

/* The outcome as JSON: the answer's members, and what was seen from here. The residuals of single
 * vertices are left out where nobody wants them. */
cJSON *skd_outcome_json(const struct skd_outcome *outcome, const char *pose, bool with_residuals);

/* The outcome as a sentence. */
void skd_outcome_print(const struct skd_outcome *outcome, const char *pose);

/* The outcome as one line of a table; the title line goes before the first. */
void skd_outcome_print_titles(int pose_width);
void skd_outcome_print_line(const struct skd_outcome *outcome, size_t number, const char *pose,
                            int pose_width);

#endif
