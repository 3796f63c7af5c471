/* session.set, save, open, fork, delete, verify: what people do with the files of sessions.
 *
 * Stage: job -> reply. Thread: the loop finds names and files; a worker reads and writes, in the
 * session's turn where there is one.
 */
#include "requests/handlers.h"

#include "journal/read.h"
#include "journal/whole.h"
#include "requests/close.h"
#include "requests/commit.h"
#include "requests/keeping.h"
#include "requests/live.h"
#include "requests/memory.h"
#include "requests/naming.h"
#include "requests/rewriting.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* A call's state; what a handler does not need stays empty. */
struct keeping_call {
    struct skd_rewriting rewriting; /* first: see rewriting.h */
    struct skd_live *made;          /* reserved; the session is put in when it is there */
    struct skd_session *session;
    struct skd_journal_identity identity; /* of a fork */
    size_t dropped;                       /* steps that a new limit leaves no room for */
    char from[SKD_STATE_PATH_BYTES];      /* the file that is read */
    char file[SKD_STATE_FILE_BYTES];      /* the session's new one */
    enum skd_status kept;                 /* whether that could be written */
    struct skd_error trouble;
};

/* What did not come to be is taken back. */
static void dismiss(struct skd_call *call)
{
    struct keeping_call *state = call->state;
    char path[SKD_STATE_PATH_BYTES];
    if (state->made != NULL) {
        skd_session_close(call->daemon, state->made, SKD_KEEPING_REMOVED, "it could not be made");
        if (state->file[0] != '\0' && skd_state_path(call->daemon->keeping.folder, SKD_STATE_OPEN,
                                                     state->file, path, NULL) == SKD_OK)
            skd_state_remove(path);
    }
    skd_session_destroy(state->session);
    skd_rewriting_finish(&state->rewriting);
    free(state);
}

/* NULL: the call was answered. */
static struct keeping_call *give_state(struct skd_call *call)
{
    struct skd_error error;
    struct keeping_call *state = calloc(1, sizeof *state);
    if (state == NULL) {
        (void)skd_fail_memory(&error, "a request");
        skd_call_fail(call, &error);
        return NULL;
    }
    call->state = state;
    call->dismiss = dismiss;
    return state;
}

static cJSON *describe(const struct skd_session *session)
{
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", session->name);
    cJSON_AddStringToObject(body, "instance", session->instance);
    cJSON_AddNumberToObject(body, "revision", (double)session->revision);
    cJSON_AddNumberToObject(body, "vertices", (double)session->rig->mesh.vertex_count);
    cJSON_AddNumberToObject(body, "influences", session->slot_count);
    cJSON_AddNumberToObject(body, "bones", session->rig->skeleton.bone_count);
    cJSON_AddNumberToObject(body, "undo_steps", (double)session->history.position);
    cJSON_AddNumberToObject(body, "redo_steps",
                            (double)(session->history.count - session->history.position));
    cJSON_AddStringToObject(body, "durability", skd_durability_words[session->durability]);
    if (session->damage[0] != '\0')
        cJSON_AddStringToObject(body, "damage", session->damage);
    return body;
}

/* ---- session.set -------------------------------------------------------------------------- */

static cJSON *describe_settings(const struct skd_session *session, enum skd_durability durability)
{
    cJSON *body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "session", session->name);
    cJSON_AddStringToObject(body, "durability", skd_durability_words[durability]);
    cJSON_AddNumberToObject(body, "history_bytes", (double)session->history.bytes_max);
    return body;
}

static enum skd_status tell_settings(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session *session = call->live->session;
    (void)error;
    call->reply.body = describe_settings(session, session->durability);
    return SKD_OK;
}

static void settings_told(struct skd_call *call)
{
    const struct skd_session *session = call->live->session;
    const struct keeping_call *state = call->state;
    if (call->status == SKD_OK && call->live->journal != NULL)
        skd_commit_record(call,
                          skd_record_create_settings(session->durability,
                                                     session->history.bytes_max, state->dropped));
    else
        skd_call_finish(call);
}

static void answer_settings(struct skd_call *call)
{
    skd_call_work(call, tell_settings, settings_told);
}

static void forgotten(void *user)
{
    skd_call_answer_prepared(user);
}

/* Answered when the file is gone: a session that is said not to be kept must not come back. */
static void set_off(struct skd_call *call)
{
    struct skd_session *session = call->live->session;
    if (!skd_call_prepare(call, describe_settings(session, SKD_DURABILITY_OFF)))
        return;
    session->durability = SKD_DURABILITY_OFF;
    skd_keeping_forget(call->daemon, call->live, forgotten, call);
}

static void begin_set(struct skd_call *call)
{
    const struct skd_session_keep_params *params = &call->request.params.session_keep;
    struct skd_session *session = call->live->session;
    enum skd_durability before = session->durability;
    struct keeping_call *state = call->state;
    if (params->history_bytes > 0)
        state->dropped = skd_history_limit(&session->history, (size_t)params->history_bytes);
    if (params->durability == SKD_DURABILITY_OFF && before != SKD_DURABILITY_OFF) {
        set_off(call);
        return;
    }
    if (params->durability >= 0)
        session->durability = (enum skd_durability)params->durability;
    if (before == SKD_DURABILITY_OFF && session->durability != before)
        skd_rewriting_run(call, answer_settings);
    else
        answer_settings(call);
}

void skd_handle_session_set(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session_keep.session);
    if (live != NULL && give_state(call) != NULL)
        skd_call_take_turn(call, live, begin_set);
}

/* ---- session.save ------------------------------------------------------------------------- */

static enum skd_status save(struct skd_call *call, struct skd_error *error)
{
    const char *path = call->request.params.session_keep.path;
    struct keeping_call *state = call->state;
    struct skd_session *session = call->live->session;
    struct stat info;
    if (skd_state_has(call->daemon->keeping.folder, path))
        return skd_fail(error, SKD_BAD_PARAMS,
                        "\"%s\" is in the folder where skind keeps its sessions; save it elsewhere",
                        path);
    enum skd_status status = skd_journal_write(path, session, NULL, state->rewriting.poses.items,
                                               state->rewriting.poses.count, error);
    if (status != SKD_OK)
        return status;
    cJSON *body = call->reply.body = cJSON_CreateObject();
    cJSON_AddStringToObject(body, "path", path);
    cJSON_AddNumberToObject(body, "bytes", stat(path, &info) == 0 ? (double)info.st_size : 0);
    cJSON_AddNumberToObject(body, "revision", (double)session->revision);
    return SKD_OK;
}

/* Holds the poses for a worker that writes the session; false: the call was answered. */
static bool hold_poses(struct skd_call *call)
{
    struct keeping_call *state = call->state;
    struct skd_error error;
    if (skd_named_poses_all(call->live->session, &state->rewriting.poses, &error) == SKD_OK)
        return true;
    skd_call_fail(call, &error);
    return false;
}

static void begin_save(struct skd_call *call)
{
    if (hold_poses(call))
        skd_call_work(call, save, NULL);
}

void skd_handle_session_save(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session_keep.session);
    if (live != NULL && give_state(call) != NULL)
        skd_call_take_turn(call, live, begin_save);
}

/* ---- session.open, session.fork ------------------------------------------------------------ */

/* The new session is there, and its file, or the reason why there is none. */
static void made(struct skd_call *call)
{
    struct keeping_call *state = call->state;
    struct skd_live *live = state->made;
    if (call->status == SKD_OK) {
        live->session = state->session;
        live->durable_revision = live->session->revision;
        state->made = NULL;
        state->session = NULL;
        skd_keeping_begin(call->daemon, live, state->file,
                          state->kept != SKD_OK ? &state->trouble : NULL);
    }
    skd_call_finish(call);
}

/* Once there is an answer: what was refused must not be found at the next start. */
static void keep_opened(struct skd_call *call)
{
    struct keeping_call *state = call->state;
    state->kept =
        skd_keeping_write_first(call->daemon, state->session, state->file, &state->trouble);
    if (call->request.params.session_keep.closed != NULL && state->kept == SKD_OK &&
        state->file[0] != '\0')
        skd_state_remove(state->from);
}

static enum skd_status open_file(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session_keep_params *params = &call->request.params.session_keep;
    struct keeping_call *state = call->state;
    struct skd_journal_report report;
    enum skd_status status = skd_journal_read(state->from, NULL, &state->session, &report, error);
    if (status != SKD_OK)
        return status;
    struct skd_session *session = state->session;
    status = skd_memory_check_session(call->daemon, skd_session_bytes(session), error);
    if (status != SKD_OK)
        return status;
    memcpy(session->name, state->made->name, sizeof session->name);
    /* A file may be opened twice, a closed session only once. */
    if (params->path != NULL)
        skd_session_new_instance(session->instance);
    /* What tools sent to a session they did not send to another one. */
    if (params->path != NULL || strcmp(session->name, params->closed) != 0)
        skd_remembered_finish(&session->remembered);
    call->apply = keep_opened;
    call->reply.body = describe(session);
    return SKD_OK;
}

/* The newest closed session of that name. */
static enum skd_status find_closed(struct skd_daemon *daemon, const char *name,
                                   char path[SKD_STATE_PATH_BYTES], struct skd_error *error)
{
    struct skd_state_files files;
    const char *folder = daemon->keeping.folder;
    enum skd_status status = skd_state_list(folder, SKD_STATE_CLOSED, &files, error);
    if (status != SKD_OK)
        return status;
    status = skd_fail(error, SKD_NO_SESSION, "no session \"%s\" is open or closed here", name);
    for (size_t i = 0; i < files.count; i++) {
        if (strcmp(files.items[i].session, name) == 0) {
            status = skd_state_path(folder, SKD_STATE_CLOSED, files.items[i].name, path, error);
            break;
        }
    }
    free(files.items);
    return status;
}

/* A file is about as large as what is read from it. That it cannot be read comes out later. */
static enum skd_status promise_file(struct skd_call *call, struct skd_error *error)
{
    struct keeping_call *state = call->state;
    struct stat info;
    const size_t bytes = stat(state->from, &info) == 0 ? (size_t)info.st_size : 0;
    return skd_memory_promise(call->daemon, state->made, bytes, error);
}

void skd_handle_session_open(struct skd_call *call)
{
    const struct skd_session_keep_params *params = &call->request.params.session_keep;
    struct keeping_call *state = give_state(call);
    struct skd_error error;
    enum skd_status status = SKD_OK;
    if (state == NULL)
        return;
    if (params->path != NULL)
        (void)snprintf(state->from, sizeof state->from, "%s", params->path);
    else
        status = find_closed(call->daemon, params->closed, state->from, &error);
    if (status == SKD_OK)
        status =
            skd_reserve_name(call->daemon, params->name != NULL ? params->name : params->closed,
                             params->path, &state->made, &error);
    if (status == SKD_OK)
        status = promise_file(call, &error);
    if (status == SKD_OK)
        skd_call_work(call, open_file, made);
    else
        skd_call_fail(call, &error);
}

/* Written under its new name, then read again: what comes is known to be whole. */
static enum skd_status fork_session(struct skd_call *call, struct skd_error *error)
{
    struct keeping_call *state = call->state;
    struct skd_session *session = call->live->session;
    char path[SKD_STATE_PATH_BYTES];
    struct skd_journal_report report;
    skd_state_new_file(state->identity.name, state->file);
    enum skd_status status =
        skd_state_path(call->daemon->keeping.folder, SKD_STATE_OPEN, state->file, path, error);
    if (status == SKD_OK)
        status = skd_journal_write(path, session, &state->identity, state->rewriting.poses.items,
                                   state->rewriting.poses.count, error);
    if (status != SKD_OK)
        return status;
    status = skd_journal_read(path, NULL, &state->session, &report, error);
    if (status != SKD_OK || session->durability == SKD_DURABILITY_OFF) {
        skd_state_remove(path);
        state->file[0] = '\0';
    }
    if (status == SKD_OK)
        call->reply.body = describe(state->session);
    return status;
}

static void begin_fork(struct skd_call *call)
{
    struct keeping_call *state = call->state;
    struct skd_error error;
    if (skd_memory_promise(call->daemon, state->made, skd_session_bytes(call->live->session),
                           &error) != SKD_OK)
        skd_call_fail(call, &error);
    else if (hold_poses(call))
        skd_call_work(call, fork_session, made);
}

void skd_handle_session_fork(struct skd_call *call)
{
    const struct skd_session_keep_params *params = &call->request.params.session_keep;
    struct skd_live *live = skd_call_find_session(call, params->session);
    struct keeping_call *state = live != NULL ? give_state(call) : NULL;
    struct skd_error error;
    if (state == NULL)
        return;
    if (skd_live_reserve(call->daemon, params->name, &state->made, &error) != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    (void)snprintf(state->identity.name, sizeof state->identity.name, "%s", params->name);
    skd_session_new_instance(state->identity.instance);
    skd_call_take_turn(call, live, begin_fork);
}

/* ---- session.delete ------------------------------------------------------------------------ */

void skd_handle_session_delete(struct skd_call *call)
{
    const char *name = call->request.params.session_keep.session;
    struct skd_daemon *daemon = call->daemon;
    char path[SKD_STATE_PATH_BYTES];
    struct skd_error error;
    struct skd_live *live = skd_live_find(daemon, name, &error);
    if (live != NULL) {
        if (!skd_call_prepare(call, cJSON_CreateObject()))
            return;
        live->closer = call;
        skd_session_close(daemon, live, SKD_KEEPING_REMOVED, "a client deleted it");
        return;
    }
    if (error.status == SKD_BUSY || find_closed(daemon, name, path, &error) != SKD_OK) {
        skd_call_fail(call, &error);
        return;
    }
    if (!skd_call_prepare(call, cJSON_CreateObject()))
        return;
    skd_state_remove(path);
    skd_call_answer_prepared(call);
}

/* ---- session.verify ------------------------------------------------------------------------ */

static enum skd_status verify(struct skd_call *call, struct skd_error *error)
{
    struct keeping_call *state = call->state;
    struct skd_journal_report report;
    const struct skd_session *session = call->live != NULL ? call->live->session : NULL;
    cJSON *body = call->reply.body = cJSON_CreateObject();
    enum skd_status status = skd_journal_verify(state->from, session, &report, error);
    if (status != SKD_OK && status != SKD_DAMAGED)
        return status;
    const char *problem = status != SKD_OK ? error->text : report.cut ? report.text : NULL;
    cJSON_AddBoolToObject(body, "ok", problem == NULL);
    cJSON_AddNumberToObject(body, "revision", (double)report.revision);
    cJSON_AddNumberToObject(body, "steps", (double)report.steps);
    cJSON_AddNumberToObject(body, "bytes", (double)report.bytes);
    cJSON *problems = cJSON_AddArrayToObject(body, "problems");
    if (problem != NULL)
        cJSON_AddItemToArray(problems, cJSON_CreateString(problem));
    return SKD_OK;
}

/* Back from being read: appended to again. */
static void verified(struct skd_call *call)
{
    struct skd_live *live = call->live;
    live->away = false;
    (void)skd_keeping_reopen(call->daemon, live);
    if (live->closed)
        skd_keeping_end(call->daemon, live, live->end);
    skd_call_finish(call);
}

static void closed_for_verify(void *user)
{
    skd_call_work(user, verify, verified);
}

static void begin_verify(struct skd_call *call)
{
    struct keeping_call *state = call->state;
    struct skd_live *live = call->live;
    struct skd_journal_file *journal = live->journal;
    struct skd_error error;
    if (journal == NULL) {
        (void)skd_fail(&error, SKD_FILE_IO, "session \"%s\" has no file now: its journal is %s",
                       live->name, skd_keeping_word(live));
        skd_call_fail(call, &error);
    } else if (skd_state_path(call->daemon->keeping.folder, SKD_STATE_OPEN, live->file, state->from,
                              &error) != SKD_OK) {
        skd_call_fail(call, &error);
    } else {
        live->journal = NULL;
        live->away = true;
        skd_journal_close(journal, NULL, closed_for_verify, call);
    }
}

void skd_handle_session_verify(struct skd_call *call)
{
    const struct skd_session_keep_params *params = &call->request.params.session_keep;
    struct skd_live *live = NULL;
    if (params->session != NULL && (live = skd_call_find_session(call, params->session)) == NULL)
        return; /* the call is gone, and its params */
    struct keeping_call *state = give_state(call);
    if (state == NULL)
        return;
    if (live != NULL) {
        skd_call_take_turn(call, live, begin_verify);
        return;
    }
    (void)snprintf(state->from, sizeof state->from, "%s", params->path);
    skd_call_work(call, verify, NULL);
}
