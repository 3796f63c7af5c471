/* guard.set and guard.get: the poses that strokes of a session should leave as they are.
 *
 * Stage: job -> reply. Thread: a worker, in the session's turn. A guard is no step of the history.
 */
#include "requests/handlers.h"

#include "requests/commit.h"
#include "requests/named_poses.h"
#include "session/guard_choice.h"

#include <stdlib.h>

struct guarding {
    struct skd_named_poses poses;
    struct skd_guards guards; /* the new ones; once in place, those that were there before */
};

static cJSON *describe(const struct skd_call *call, const struct skd_guards *guards)
{
    static const char *const sources[] = {"clip", "pose", "matrices"};
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", call->live->name);
    cJSON_AddNumberToObject(body, "candidates", (double)guards->candidate_count);
    cJSON *poses = cJSON_AddArrayToObject(body, "poses");
    for (size_t i = 0; i < guards->poses.count; i++) {
        const struct skd_sample *sample = &guards->poses.items[i];
        cJSON *pose = cJSON_CreateObject();
        SKD_ASSERT(sample->source <= SKD_SAMPLE_MATRICES);
        cJSON_AddStringToObject(pose, "source", sources[sample->source]);
        cJSON_AddStringToObject(pose, "name", sample->name);
        cJSON_AddNumberToObject(pose, "time", sample->time);
        cJSON_AddNumberToObject(pose, "index", sample->index);
        cJSON_AddItemToArray(poses, pose);
    }
    return body;
}

static enum skd_status build(struct skd_call *call, struct skd_error *error)
{
    const struct skd_guard_set_params *params = &call->request.params.guard_set;
    struct guarding *guarding = call->state;
    const struct skd_guards_input input = {
        .poses = guarding->poses.items,
        .pose_count = guarding->poses.count,
        .clips = params->clips,
        .clip_count = params->clip_count,
        .matrices = params->matrices.data,
        .matrix_count = params->matrices.rows,
        .most = (size_t)params->count,
        .cancelled = &call->cancelled,
    };
    enum skd_status status =
        skd_guards_build(call->live->session, &input, &guarding->guards, error);
    if (status == SKD_CANCELLED) {
        skd_call_cancelled(call, error);
        return error->status;
    }
    if (status == SKD_OK)
        call->reply.body = describe(call, &guarding->guards);
    return status;
}

static void put_in_place(struct skd_call *call)
{
    struct guarding *guarding = call->state;
    struct skd_session *session = call->live->session;
    struct skd_guards before = session->guards;
    session->guards = guarding->guards;
    guarding->guards = before;
}

static void built(struct skd_call *call)
{
    struct skd_session *session = call->live->session;
    skd_session_account(session);
    if (call->status == SKD_OK)
        skd_commit_record(call, skd_record_create_guard(&session->guards));
    else
        skd_call_finish(call);
}

static void dismiss(struct skd_call *call)
{
    struct guarding *guarding = call->state;
    skd_named_poses_finish(&guarding->poses);
    skd_guards_finish(&guarding->guards);
    free(guarding);
}

static void begin_build(struct skd_call *call)
{
    call->apply = put_in_place;
    skd_call_work(call, build, built);
}

void skd_handle_guard_set(struct skd_call *call)
{
    const struct skd_guard_set_params *params = &call->request.params.guard_set;
    struct skd_live *live = skd_call_find_session(call, params->session);
    if (live == NULL)
        return;
    struct skd_error error;
    struct guarding *guarding = calloc(1, sizeof *guarding);
    enum skd_status status = guarding != NULL ? SKD_OK : skd_fail_memory(&error, "a request");
    if (status == SKD_OK) {
        call->state = guarding;
        call->dismiss = dismiss;
        status = skd_named_poses_find(live->session, params->poses, params->pose_count,
                                      &guarding->poses, &error);
    }
    if (status == SKD_OK)
        skd_call_take_turn(call, live, begin_build);
    else
        skd_call_fail(call, &error);
}

static enum skd_status tell(struct skd_call *call, struct skd_error *error)
{
    (void)error;
    call->reply.body = describe(call, &call->live->session->guards);
    return SKD_OK;
}

static void begin_tell(struct skd_call *call)
{
    skd_call_work(call, tell, NULL);
}

void skd_handle_guard_get(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    if (live != NULL)
        skd_call_take_turn(call, live, begin_tell);
}
