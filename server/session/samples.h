/* Poses of a rig gathered from wherever they come, and the few among them that are least alike.
 *
 * Stage: job. Thread: a worker. Owns its matrices; named poses are copied.
 */
#ifndef SKD_SESSION_SAMPLES_H
#define SKD_SESSION_SAMPLES_H

#include "rig/rig.h"
#include "session/poses.h"

enum skd_sample_source { SKD_SAMPLE_CLIP, SKD_SAMPLE_POSE, SKD_SAMPLE_MATRICES, SKD_SAMPLE_BEND };

struct skd_sample {
    enum skd_sample_source source;
    char name[SKD_NAME_BYTES_MAX + 1]; /* of the clip or pose, else "" */
    double time;                       /* in the clip, seconds; else 0 */
    int index;                         /* place within its source */
};

/* How far a sample's bend turns every joint: 25 degrees. */
#define SKD_SAMPLE_BEND_RAD (25.0 * 3.14159265358979323846 / 180.0)

struct skd_samples {
    size_t count;
    size_t capacity;
    int bone_count;
    struct skd_sample *items; /* [count] */
    double *matrices;         /* [count][bones][12] */
};

/* Room for `capacity` poses. Errors: SKD_NO_MEMORY. Finish in any case. */
SKD_MUST_CHECK enum skd_status skd_samples_init(struct skd_samples *samples, size_t capacity,
                                                const struct skd_rig *rig, struct skd_error *error);
void skd_samples_finish(struct skd_samples *samples);
const double *skd_samples_matrices(const struct skd_samples *samples, size_t index);

/* One more: a named pose, a client's posed bones ([bones][16]), a pose that bends every joint by 25
 * degrees. There must be room. Errors: those of skd_pose_from_matrices. */
void skd_samples_add_pose(struct skd_samples *samples, const struct skd_pose *pose, int index);
SKD_MUST_CHECK enum skd_status skd_samples_add_matrices(struct skd_samples *samples,
                                                        const struct skd_rig *rig,
                                                        const double *posed, int index,
                                                        struct skd_error *error);
void skd_samples_add_bend(struct skd_samples *samples, const struct skd_rig *rig, int seed);

/* Frames of clips, ten a second with the first and the last; evenly thinned to `most` over all of
 * them. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_samples_add_clips(struct skd_samples *samples,
                                                     const struct skd_rig *rig, const int *clips,
                                                     size_t clip_count, size_t most,
                                                     struct skd_error *error);

/* What skins the vertices that poses are told apart by. */
struct skd_samples_skin {
    int slot_count;
    const uint16_t *joints; /* [V][slots] */
    const float *weights;
};

/* Adds at most `most` poses to `picked`, which must have room for them, the least alike first: each
 * is the one whose nearest among the rest pose and those picked here before is farthest, by the
 * root mean square over at most 2000 evenly taken vertices; of equal ones, the first. Ends early
 * where all that is left is within 1e-6 L of one of them. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_samples_pick(const struct skd_samples *samples,
                                                const struct skd_rig *rig,
                                                const struct skd_samples_skin *skin, size_t most,
                                                struct skd_samples *picked,
                                                struct skd_error *error);

#endif
