/* stroke.apply, pins.solve, session.refit: from posed positions to committed weights.
 *
 * Stage: job -> [pure solve] -> result -> commit -> reply. Thread: the loop steers, workers do.
 *
 *     begin ==> prepare ==> chunk 0 ==> ... ==> chunk n ==> commit ==> answer
 *               (worker)    (any worker, a few at once)     (worker)   revision + 1
 *                  ^          |            |          |
 *                  |          +-> stroke.weights to whoever sent the stroke
 *                  +------------- next pass <---------+  (smoothing and refit take several)
 *
 * A stroke keeps only a few chunks in the pool's queue, so that strokes of several sessions share
 * the workers fairly. Up to the commit it can be dropped; from then on it is done.
 */
#include "requests/handlers.h"

#include "requests/claims.h"
#include "requests/commit.h"
#include "requests/memory.h"
#include "requests/named_poses.h"
#include "requests/repeats.h"
#include "requests/updates.h"
#include "session/stroke_run.h"

#include <math.h>
#include <stdlib.h>

/* Vertices of a chunk; fewer where each takes long, so that a cancelled stroke ends soon. */
enum { CHUNK_VERTICES = 8192, CHUNK_VERTICES_SLOW = 1024 };

struct job {
    struct skd_call *call;
    struct skd_stroke stroke;
    struct skd_named_poses frames; /* of a refit */
    struct skd_claims_seen *claims;
    size_t next;   /* first vertex of the next chunk */
    int in_flight; /* chunks that workers have */
    bool lost;     /* a chunk's weights could not be told */
    uint64_t begun_ns;
    uint64_t solving_ns;
    uint64_t solved_ns;
};

/* A run of vertices that one worker solves, and the notification that tells the result. */
struct chunk {
    uv_work_t work;
    struct job *job;
    size_t first;
    size_t count;
    struct skd_encoded encoded; /* head NULL: nothing to send */
    bool lost;                  /* it could not be encoded */
};

static void submit_chunks(struct job *job);
static void prepared(struct skd_call *call);

static void release_step(void *step)
{
    skd_step_release(step);
}

static void encode_chunk(struct chunk *chunk)
{
    const struct skd_call *call = chunk->job->call;
    const struct skd_step *step = chunk->job->stroke.step;
    struct skd_error error;
    struct skd_array_out arrays[SKD_STEP_ARRAYS];
    cJSON *body = cJSON_CreateObject();
    int count = skd_step_arrays(step, false, chunk->first, chunk->count, arrays);
    cJSON_AddStringToObject(body, "session", call->live->name);
    skd_add_id(body, "request", &call->request.message.id);
    cJSON_AddNumberToObject(body, "first", (double)chunk->first);
    cJSON_AddNumberToObject(body, "count", (double)chunk->count);
    cJSON_AddNumberToObject(body, "total", (double)step->count);
    cJSON_AddNumberToObject(body, "influences", step->slot_count);
    if (step->shape != NULL)
        cJSON_AddStringToObject(body, "shape", step->shape->sheet->pose->name);
    if (skd_encode_notification(call->mode, "stroke.weights", body, arrays, count, &chunk->encoded,
                                &error) != SKD_OK) {
        chunk->encoded.head = NULL;
        chunk->lost = true;
    }
}

static bool is_last_pass(const struct job *job)
{
    return job->stroke.pass + 1 >= job->stroke.pass_count;
}

static void solve_chunk(uv_work_t *work)
{
    struct chunk *chunk = work->data;
    const struct skd_call *call = chunk->job->call;
    if (atomic_load(&call->cancelled))
        return;
    skd_stroke_solve(&chunk->job->stroke, chunk->first, chunk->count);
    if (call->request.params.stroke.stream && is_last_pass(chunk->job))
        encode_chunk(chunk);
}

static bool stop_if_cancelled(struct job *job)
{
    struct skd_error error;
    if (!atomic_load(&job->call->cancelled))
        return false;
    skd_call_cancelled(job->call, &error);
    skd_call_fail(job->call, &error);
    return true;
}

static void add_residual(cJSON *object, const char *name, const struct skd_residual *residual)
{
    cJSON *item = cJSON_AddObjectToObject(object, name);
    cJSON_AddNumberToObject(item, "mean", residual->mean);
    cJSON_AddNumberToObject(item, "max", residual->max);
}

static void add_warnings(cJSON *body, const struct job *job)
{
    const struct skd_stroke *stroke = &job->stroke;
    cJSON *list = cJSON_AddArrayToObject(body, "warnings");
    for (int w = 0; w < SKD_WARNING_COUNT; w++) {
        char text[256];
        if (stroke->warnings[w] == 0)
            continue;
        cJSON *item = cJSON_CreateObject();
        skd_stroke_warning_text((enum skd_stroke_warning)w, stroke->warnings[w], text, sizeof text);
        cJSON_AddStringToObject(item, "name", skd_stroke_warning_name((enum skd_stroke_warning)w));
        cJSON_AddNumberToObject(item, "count", (double)stroke->warnings[w]);
        cJSON_AddStringToObject(item, "text", text);
        cJSON_AddItemToArray(list, item);
    }
    skd_claims_warn(job->claims, job->call->live->session, stroke->step, list);
}

static cJSON *describe(const struct job *job, uint64_t revision)
{
    const struct skd_stroke *stroke = &job->stroke;
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", job->call->live->name);
    cJSON_AddNumberToObject(body, "revision", (double)revision);
    cJSON_AddNumberToObject(body, "vertices", (double)stroke->step->count);
    cJSON_AddNumberToObject(body, "unreached", (double)stroke->unreached_count);
    cJSON_AddNumberToObject(body, "reach", stroke->reach);
    cJSON *residual = cJSON_AddObjectToObject(body, "residual");
    add_residual(residual, "before", &stroke->before);
    add_residual(residual, "after", &stroke->after);
    cJSON_AddNumberToObject(body, "stiffness", stroke->input.options.stiffness);
    cJSON_AddNumberToObject(body, "poses", stroke->most_poses);
    cJSON_AddNumberToObject(body, "slots_changed", (double)stroke->slots_changed);
    cJSON_AddNumberToObject(body, "rest_moved", (double)stroke->rest_moved);
    cJSON_AddNumberToObject(body, "shaped", (double)stroke->shaped);
    add_warnings(body, job);
    cJSON *ms = cJSON_AddObjectToObject(body, "ms");
    cJSON_AddNumberToObject(ms, "wait", (double)(job->begun_ns - job->call->arrived_ns) * 1e-6);
    cJSON_AddNumberToObject(ms, "solve", (double)(job->solved_ns - job->solving_ns) * 1e-6);
    cJSON_AddNumberToObject(ms, "total", (double)(uv_hrtime() - job->call->arrived_ns) * 1e-6);
    return body;
}

/* The last thing in a worker: residuals, the answer, then the weights. */
static enum skd_status answer(struct skd_call *call, struct skd_error *error)
{
    struct job *job = call->state;
    const struct skd_session *session = call->live->session;
    uint64_t revision = session->revision + (job->stroke.step->count > 0);
    struct skd_reply *reply = &call->reply;
    enum skd_status status = skd_stroke_finish(&job->stroke, error);
    if (status != SKD_OK)
        return status;
    reply->body = describe(job, revision);
    reply->arrays[0] =
        (struct skd_array_out){"residuals", SKD_F32, job->stroke.told_count, 0, job->stroke.told};
    reply->array_count = 1;
    reply->owner = job->stroke.told; /* goes with the answer, not with the stroke */
    reply->release = free;
    job->stroke.told = NULL;
    return SKD_OK;
}

static void write_step(struct skd_call *call)
{
    const struct job *job = call->state;
    skd_session_write(call->live->session, job->stroke.step, false);
}

static void committed(struct skd_call *call)
{
    const struct job *job = call->state;
    struct skd_step *step = job->stroke.step;
    if (call->status != SKD_OK) {
        skd_call_finish(call);
        return;
    }
    if (step->count == 0) {
        skd_commit_unchanged(call);
        return;
    }
    call->daemon->stats.vertices_solved += step->count;
    call->daemon->stats.solve_ns += job->solved_ns - job->solving_ns;
    const struct skd_commit commit = {
        .kind = SKD_COMMIT_STEP,
        .step = step,
        .cause = job->stroke.pose != NULL ? SKD_CAUSE_STROKE : SKD_CAUSE_REFIT,
        .sender_knows = call->request.params.stroke.stream,
    };
    skd_commit(call, &commit);
}

static void begin_commit(struct job *job)
{
    struct skd_call *call = job->call;
    struct skd_error error;
    job->solved_ns = uv_hrtime();
    if (job->lost) { /* a sender that missed weights must not take them as told */
        (void)skd_fail_memory(&error, "the stroke's weights on their way");
        skd_call_fail(call, &error);
        return;
    }
    if (skd_history_reserve(&call->live->session->history, &error) != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    call->apply = write_step;
    skd_call_work(call, answer, committed);
}

static void chunk_done(uv_work_t *work, int status)
{
    struct chunk *chunk = work->data;
    struct job *job = chunk->job;
    SKD_ASSERT(status == 0);
    if (chunk->encoded.head != NULL)
        skd_call_send(job->call, &chunk->encoded, release_step, skd_step_hold(job->stroke.step));
    job->lost |= chunk->lost;
    free(chunk);
    job->in_flight--;
    submit_chunks(job);
}

static size_t chunk_size(const struct skd_stroke *stroke)
{
    bool slow = stroke->candidates != NULL || stroke->step->rest_after != NULL;
    return slow ? CHUNK_VERTICES_SLOW : CHUNK_VERTICES;
}

static bool submit_chunk(struct job *job)
{
    struct chunk *chunk = calloc(1, sizeof *chunk);
    size_t left = job->stroke.step->count - job->next;
    if (chunk == NULL)
        return false;
    chunk->work.data = chunk;
    chunk->job = job;
    chunk->first = job->next;
    size_t most = chunk_size(&job->stroke);
    chunk->count = left < most ? left : most;
    job->next += chunk->count;
    job->in_flight++;
    int result = uv_queue_work(job->call->daemon->loop, &chunk->work, solve_chunk, chunk_done);
    SKD_ASSERT(result == 0);
    return true;
}

static enum skd_status next_pass(struct skd_call *call, struct skd_error *error)
{
    struct job *job = call->state;
    job->next = 0;
    return skd_stroke_next_pass(&job->stroke, error);
}

/* Keeps a few chunks with the workers; when the last one is back, goes on to the commit. */
static void submit_chunks(struct job *job)
{
    int most = 2 * job->call->daemon->worker_count;
    bool stop = atomic_load(&job->call->cancelled);
    while (!stop && job->in_flight < most && job->next < job->stroke.step->count) {
        if (submit_chunk(job))
            continue;
        if (job->in_flight == 0) {
            struct skd_error error;
            (void)skd_fail_memory(&error, "the stroke");
            skd_call_fail(job->call, &error);
            return;
        }
        break; /* a chunk that comes back tries again */
    }
    if (job->in_flight > 0 || stop_if_cancelled(job))
        return;
    if (is_last_pass(job))
        begin_commit(job);
    else
        skd_call_work(job->call, next_pass, prepared);
}

static enum skd_status prepare(struct skd_call *call, struct skd_error *error)
{
    struct job *job = call->state;
    return skd_stroke_prepare(&job->stroke, error);
}

static void prepared(struct skd_call *call)
{
    struct job *job = call->state;
    if (call->status != SKD_OK) {
        skd_call_finish(call);
        return;
    }
    if (job->stroke.pass == job->stroke.first_pass)
        job->solving_ns = uv_hrtime();
    submit_chunks(job);
}

static void begin(struct skd_call *call)
{
    struct job *job = call->state;
    struct skd_error error;
    if (skd_repeat_answered(call))
        return;
    job->begun_ns = uv_hrtime();
    job->stroke.session = call->live->session;
    job->claims = skd_claims_look(call);
    if (skd_memory_check_step(call->daemon, job->stroke.session, job->stroke.input.count, &error) !=
            SKD_OK ||
        skd_stroke_claim(&job->stroke, &error) != SKD_OK)
        skd_call_fail(call, &error);
    else
        skd_call_work(call, prepare, prepared);
}

static void dismiss(struct skd_call *call)
{
    struct job *job = call->state;
    struct skd_pose *pose = job->stroke.pose;
    skd_stroke_dismiss(&job->stroke);
    skd_pose_release(pose);
    skd_named_poses_finish(&job->frames);
    skd_claims_forget(job->claims);
    free(job);
}

static void read_params(const struct skd_stroke_params *params, struct skd_stroke_input *input)
{
    *input = (struct skd_stroke_input){
        .vertices = params->vertices.data,
        .positions = params->positions.data,
        .count = params->vertices.count,
        .mask = params->mask.data,
        .mix = params->mix,
        .locked_bones = params->locked_bones,
        .locked_bone_count = params->locked_bone_count,
        .locked_vertices = params->locked_vertices.data,
        .locked_vertex_count = params->locked_vertices.count,
        .pin = (enum skd_pin_mode)params->pin,
        .slots = (enum skd_slots_mode)params->slots,
        .residual = (enum skd_residual_mode)params->residual,
        .choose_stiffness = isnan(params->stiffness) && params->method == SKD_METHOD_EXACT,
        .options = skd_solve_defaults(),
    };
    input->options.method = (enum skd_method)params->method;
    input->options.constraint = (enum skd_constraint)params->constraint;
    if (!isnan(params->stiffness))
        input->options.stiffness = params->stiffness;
    input->options.guard = params->guard;
    input->options.smooth = params->smooth;
    input->options.thesis_k = params->thesis_k;
    input->options.thesis_h = params->thesis_h;
}

/* The session named, and a job for it that has read the params; NULL: the call was answered. */
static struct job *start_job(struct skd_call *call, struct skd_live **live)
{
    const struct skd_stroke_params *params = &call->request.params.stroke;
    *live = skd_call_find_session(call, params->session);
    if (*live == NULL)
        return NULL;
    struct job *job = calloc(1, sizeof *job);
    if (job == NULL) {
        struct skd_error error;
        (void)skd_fail_memory(&error, "a stroke");
        skd_call_fail(call, &error);
        return NULL;
    }
    job->call = call;
    call->state = job;
    call->dismiss = dismiss;
    read_params(params, &job->stroke.input);
    return job;
}

static void handle_in_pose(struct skd_call *call, bool solves_pins)
{
    struct skd_live *live;
    struct job *job = start_job(call, &live);
    struct skd_error error;
    if (job == NULL)
        return;
    struct skd_pose *pose =
        skd_session_find_pose(live->session, call->request.params.stroke.pose, &error);
    if (pose == NULL) {
        skd_call_fail(call, &error);
        return;
    }
    job->stroke.pose = skd_pose_hold(pose);
    job->stroke.input.solves_pins = solves_pins;
    job->stroke.input.names_vertices = call->request.params.stroke.vertices_given;
    skd_call_take_turn(call, live, begin);
}

void skd_handle_stroke_apply(struct skd_call *call)
{
    handle_in_pose(call, false);
}

void skd_handle_pins_solve(struct skd_call *call)
{
    handle_in_pose(call, true);
}

void skd_handle_session_refit(struct skd_call *call)
{
    const struct skd_stroke_params *params = &call->request.params.stroke;
    struct skd_live *live;
    struct job *job = start_job(call, &live);
    struct skd_error error;
    if (job == NULL)
        return;
    struct skd_stroke_input *input = &job->stroke.input;
    if (skd_named_poses_find(live->session, params->poses, params->pose_count, &job->frames,
                             &error) != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    input->frames = job->frames.items;
    input->frame_count = job->frames.count;
    input->frame_positions = params->positions.data;
    input->positions = NULL;
    input->count = params->positions.rows;
    input->rounds = params->rounds;
    skd_call_take_turn(call, live, begin);
}
