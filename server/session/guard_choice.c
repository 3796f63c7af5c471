/* See guard_choice.h. */
#include "session/guard_choice.h"

#include <stdlib.h>

static enum skd_status check(const struct skd_session *session,
                             const struct skd_guards_input *input, struct skd_error *error)
{
    size_t bones = (size_t)session->rig->skeleton.bone_count;
    if (input->matrix_count % bones != 0)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "matrices holds %zu matrices, which is no whole number of poses of %zu "
                        "bones",
                        input->matrix_count, bones);
    if (input->pose_count + input->matrix_count / bones > SKD_GUARD_CANDIDATES_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "%zu poses are named or sent, and %d are the limit; leave out those that "
                        "are like others",
                        input->pose_count + input->matrix_count / bones, SKD_GUARD_CANDIDATES_MAX);
    return SKD_OK;
}

static enum skd_status stop_if_cancelled(const struct skd_guards_input *input,
                                         struct skd_error *error)
{
    if (input->cancelled == NULL || !atomic_load(input->cancelled))
        return SKD_OK;
    return skd_fail(error, SKD_CANCELLED, "choosing the guard poses was cancelled");
}

/* All the named clips' frames that there is room for. */

static enum skd_status add_clips(const struct skd_session *session,
                                 const struct skd_guards_input *input, struct skd_samples *samples,
                                 struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    enum skd_status status = SKD_OK;
    int *clips = malloc(input->clip_count * sizeof *clips + 1);
    if (clips == NULL)
        return skd_fail_memory(error, "the clips' names");
    for (size_t i = 0; i < input->clip_count && status == SKD_OK; i++) {
        clips[i] = skd_rig_find_clip(rig, input->clips[i]);
        if (clips[i] < 0)
            status = skd_fail(error, SKD_NO_CLIP, "session \"%s\" has no clip \"%s\" (%zu clips)",
                              session->name, input->clips[i], rig->nodes.clip_count);
    }
    if (status == SKD_OK)
        status = skd_samples_add_clips(samples, rig, clips, input->clip_count,
                                       samples->capacity - samples->count, error);
    free(clips);
    return status;
}

static enum skd_status gather(const struct skd_session *session,
                              const struct skd_guards_input *input, struct skd_samples *samples,
                              struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    size_t bones = (size_t)rig->skeleton.bone_count;
    size_t sent = input->matrix_count / bones;
    size_t capacity = input->clip_count > 0 ? SKD_GUARD_CANDIDATES_MAX : input->pose_count + sent;
    enum skd_status status = skd_samples_init(samples, capacity, rig, error);
    for (size_t i = 0; i < input->pose_count && status == SKD_OK; i++)
        skd_samples_add_pose(samples, input->poses[i], (int)i);
    for (size_t i = 0; i < sent && status == SKD_OK; i++)
        status =
            skd_samples_add_matrices(samples, rig, input->matrices + i * bones * 16, (int)i, error);
    return status == SKD_OK ? add_clips(session, input, samples, error) : status;
}

static enum skd_status pick(const struct skd_session *session, const struct skd_guards_input *input,
                            const struct skd_samples *samples, struct skd_guards *guards,
                            struct skd_error *error)
{
    const struct skd_samples_skin skin = {
        .slot_count = session->slot_count,
        .joints = skd_session_start_joints(session),
        .weights = skd_session_start_weights(session),
    };
    size_t most = input->most < samples->count ? input->most : samples->count;
    guards->candidate_count = samples->count;
    enum skd_status status = skd_samples_init(&guards->poses, most, session->rig, error);
    if (status == SKD_OK)
        status = skd_samples_pick(samples, session->rig, &skin, most, &guards->poses, error);
    if (status == SKD_OK && guards->poses.count == 0)
        status = skd_fail(error, SKD_BAD_PARAMS,
                          "none of the %zu poses differs from the rest pose of session \"%s\", so "
                          "there is nothing to guard",
                          samples->count, session->name);
    return status;
}

enum skd_status skd_guards_build(const struct skd_session *session,
                                 const struct skd_guards_input *input, struct skd_guards *guards,
                                 struct skd_error *error)
{
    struct skd_samples samples = {0};
    enum skd_status status;
    *guards = (struct skd_guards){0};
    if (input->pose_count + input->clip_count + input->matrix_count == 0)
        return SKD_OK;
    if ((status = check(session, input, error)) != SKD_OK ||
        (status = gather(session, input, &samples, error)) != SKD_OK ||
        (status = stop_if_cancelled(input, error)) != SKD_OK ||
        (status = pick(session, input, &samples, guards, error)) != SKD_OK ||
        (status = stop_if_cancelled(input, error)) != SKD_OK)
        goto done;
    status = skd_guards_factor(&guards->poses, &guards->factors, error);
done:
    skd_samples_finish(&samples);
    return status;
}
