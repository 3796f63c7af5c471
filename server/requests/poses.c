/* pose.set and pose.evaluate.
 *
 * Stage: request -> (job) -> reply. Thread: pose.set on the loop (a clip sample or B matrices take
 * microseconds); pose.evaluate in a worker, in its turn, because it reads the weights.
 */
#include "requests/handlers.h"

#include "requests/commit.h"
#include "requests/memory.h"
#include "rig/pose.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double RAD_PER_DEGREE = 3.14159265358979323846 / 180;

static enum skd_status make_pose(const struct skd_session *session,
                                 const struct skd_pose_set_params *params, struct skd_pose *pose,
                                 struct skd_error *error)
{
    const struct skd_rig *rig = session->rig;
    size_t bones = (size_t)rig->skeleton.bone_count;
    if (strcmp(params->pose, "rest") == 0)
        return skd_fail(error, SKD_NAME_TAKEN,
                        "the pose \"rest\" is the rig's own; choose another name");
    if (!isnan(params->bend)) {
        skd_pose_bend(rig, (uint32_t)params->seed, params->bend * RAD_PER_DEGREE, pose->matrices);
        return SKD_OK;
    }
    if (params->clip == NULL) {
        if (params->matrices.count != bones * 16)
            return skd_fail(error, SKD_COUNT_MISMATCH,
                            "matrices holds %zu numbers, but %zu bones take %zu (4x4 each)",
                            params->matrices.count, bones, bones * 16);
        return skd_pose_from_matrices(rig, params->matrices.data, pose->matrices, error);
    }
    int clip = skd_rig_find_clip(rig, params->clip);
    if (clip < 0)
        return skd_fail(error, SKD_NO_CLIP, "session \"%s\" has no clip \"%s\" (%zu clips)",
                        session->name, params->clip, rig->nodes.clip_count);
    return skd_pose_from_clip(rig, clip, params->time, pose->matrices, error);
}

/* The answer is there before the pose is put under its name, so that an error means no change. */
static enum skd_status encode_pose(struct skd_call *call, const struct skd_pose *pose,
                                   struct skd_error *error)
{
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "pose", pose->name);
    return skd_encode_answer(call->mode, &call->request.message.id, body, NULL, 0, &call->encoded,
                             error);
}

/* Answers once the pose is kept. While the session's file is away (requests/rewriting.c), it is
 * told to the new one. */
static void commit_pose(struct skd_call *call, struct skd_live *live, struct skd_pose *pose)
{
    live->poses_changed = live->poses_changed || live->journal == NULL;
    call->live = live;
    skd_commit_record(call, skd_record_create_pose(pose));
}

void skd_handle_pose_set(struct skd_call *call)
{
    const struct skd_pose_set_params *params = &call->request.params.pose_set;
    struct skd_live *live = skd_call_find_session(call, params->session);
    if (live == NULL)
        return;
    struct skd_error error;
    enum skd_status status;
    const int bones = live->session->rig->skeleton.bone_count;
    struct skd_pose *pose = skd_pose_create(params->pose, bones);
    if (pose == NULL) {
        status = skd_fail_memory(&error, "a pose");
    } else if ((status = skd_memory_check(call->daemon, live->session,
                                          (size_t)bones * SKD_MATRIX_SIZE * sizeof(double),
                                          &error)) != SKD_OK) {
        skd_pose_release(pose);
    } else if ((status = make_pose(live->session, params, pose, &error)) != SKD_OK ||
               (status = encode_pose(call, pose, &error)) != SKD_OK) {
        skd_pose_release(pose);
    } else if ((status = skd_poses_put(&live->session->poses, pose, &error)) != SKD_OK) {
        skd_encoded_finish(&call->encoded);
    }
    if (status != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    commit_pose(call, live, pose);
}

static enum skd_status evaluate(struct skd_call *call, struct skd_error *error)
{
    const struct skd_shown_params *params = &call->request.params.shown;
    const struct skd_session *session = call->live->session;
    const struct skd_pose *pose = call->state;
    const uint32_t *vertices = params->vertices_given ? params->vertices.data : NULL;
    size_t count =
        params->vertices_given ? params->vertices.count : session->rig->mesh.vertex_count;
    if (params->vertices_given) {
        enum skd_status status = skd_session_check_vertices(session, vertices, count, error);
        if (status != SKD_OK)
            return status;
    }
    float *positions = malloc(count * 3 * sizeof(float) + 1);
    if (positions == NULL)
        return skd_fail_memory(error, "the posed positions");
    if (count > 0)
        skd_session_show(session, pose, count, vertices, positions);
    call->reply.body = cJSON_CreateObject();
    cJSON_AddNumberToObject(call->reply.body, "revision", (double)session->revision);
    call->reply.arrays[0] = (struct skd_array_out){"positions", SKD_F32, count, 3, positions};
    call->reply.array_count = 1;
    call->reply.owner = positions;
    call->reply.release = free;
    return SKD_OK;
}

static void begin_evaluate(struct skd_call *call)
{
    skd_call_work(call, evaluate, NULL);
}

static void let_pose_go(struct skd_call *call)
{
    skd_pose_release(call->state);
}

void skd_handle_pose_evaluate(struct skd_call *call)
{
    const struct skd_shown_params *params = &call->request.params.shown;
    struct skd_live *live = skd_call_find_session(call, params->session);
    if (live == NULL)
        return;
    struct skd_error error;
    struct skd_pose *pose = skd_session_find_pose(live->session, params->pose, &error);
    if (pose == NULL) {
        skd_call_fail(call, &error);
        return;
    }
    call->state = skd_pose_hold(pose);
    call->dismiss = let_pose_go;
    skd_call_take_turn(call, live, begin_evaluate);
}
