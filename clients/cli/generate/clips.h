/* The figure's animation clips: walk (cyclic), bend, reach, range_of_motion.
 *
 * Pure; any thread; a clip owns its arrays (skd_clips_finish frees them).
 *
 * Poses are tables of angles by anatomical bone: bend about the hinge (X), twist about the bone
 * (Y), swing about Z; degrees. A bone that is cut into a chain bends at its first joint (limbs) or
 * evenly (trunk) and twists evenly.
 */
#ifndef SKD_GENERATE_CLIPS_H
#define SKD_GENERATE_CLIPS_H

#include "base/error.h"
#include "skeleton.h"

enum { CLIP_COUNT = 4, CLIP_MAX_TIMES = 8, CLIP_MAX_KEYS = 16 };

struct clip_times {
    uint32_t key_count;
    float time[CLIP_MAX_KEYS]; /* seconds, rising */
};

/* One bone's keys, LINEAR; values are quaternions x y z w, or the hips' translations. */
struct clip_track {
    uint32_t bone;
    uint32_t times; /* index into clip.times */
    int is_translation;
    float value[CLIP_MAX_KEYS][4];
};

struct clip {
    const char *name;
    uint32_t times_count, track_count;
    struct clip_times times[CLIP_MAX_TIMES];
    struct clip_track *track;
};

/* Errors: SKD_NO_MEMORY; what was made must be finished all the same. */
SKD_MUST_CHECK enum skd_status skd_clips_init(struct clip clips[CLIP_COUNT],
                                              const struct skeleton *skeleton,
                                              struct skd_error *error);

void skd_clips_finish(struct clip clips[CLIP_COUNT]);

#endif
