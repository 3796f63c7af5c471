/* session.create: a file or a client's arrays become a rig session.
 *
 * Stage: request -> rig session. A file is parsed in a process of its own (import/), which no
 * worker waits for. Thread: a worker checks and builds; the loop reserves the name before and opens
 * the session after. Files and arrays meet in skd_session_create.
 */
#include "requests/handlers.h"

#include "import/import.h"
#include "requests/close.h"
#include "requests/describe.h"
#include "requests/keeping.h"
#include "requests/live.h"
#include "requests/memory.h"
#include "requests/naming.h"
#include "rig/rig_build.h"
#include "session/creation.h"

#include <stdlib.h>
#include <string.h>

struct creating {
    struct skd_live *live;     /* reserved; the session is put in when it is made */
    struct skd_import *import; /* of a file */
    struct skd_session *session;
    char file[SKD_STATE_FILE_BYTES]; /* the session's, in the state folder */
    enum skd_status kept;            /* whether it could be written */
    struct skd_error trouble;
};

static enum skd_status build_from_arrays(const struct skd_session_create_params *params,
                                         struct skd_rig **rig, struct skd_influences *influences,
                                         struct skd_error *error)
{
    /* That the arrays fit each other was checked when the request was decoded. */
    size_t vertices = params->positions.rows;
    size_t bones = params->bone_parents.rows;
    const uint32_t *offsets = params->influence_offsets.data;
    if (params->influence_joints.count != offsets[vertices])
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "influence_joints holds %zu numbers, but the last of influence_offsets "
                        "says %u",
                        params->influence_joints.count, (unsigned)offsets[vertices]);
    if (bones > SKD_BONES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "%zu bones are more than the limit of %d", bones,
                        SKD_BONES_MAX);
    struct skd_rig_arrays arrays = {
        .vertex_count = vertices,
        .positions = params->positions.data,
        .triangle_count = params->triangles.rows,
        .triangles = params->triangles.data,
        .bone_count = (int)bones,
        .bone_names = (const char *const *)params->bone_names,
        .parents = params->bone_parents.data,
        .bind_matrices = params->bone_binds.data,
        .influence_offsets = offsets,
        .influence_joints = params->influence_joints.data,
        .influence_weights = params->influence_weights.data,
    };
    return skd_rig_from_arrays(&arrays, rig, influences, error);
}

static enum skd_status build_rig(struct skd_call *call, struct skd_rig **rig,
                                 struct skd_influences *influences, struct skd_error *error)
{
    struct creating *creating = call->state;
    if (creating->import == NULL)
        return build_from_arrays(&call->request.params.session_create, rig, influences, error);
    return skd_import_read(creating->import, rig, influences, error);
}

/* Once there is an answer: what was refused must not be found at the next start. */
static void keep(struct skd_call *call)
{
    struct creating *creating = call->state;
    creating->kept = skd_keeping_write_first(call->daemon, creating->session, creating->file,
                                             &creating->trouble);
}

static enum skd_status create(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session_create_params *params = &call->request.params.session_create;
    struct creating *creating = call->state;
    struct skd_rig *rig = NULL;
    struct skd_influences influences = {0};
    enum skd_status status = build_rig(call, &rig, &influences, error);
    if (status != SKD_OK)
        return status;
    static const enum skd_cut cuts[] = {
        [SKD_REDUCE_REFUSE] = SKD_CUT_REFUSE,
        [SKD_REDUCE_LARGEST] = SKD_CUT_LARGEST,
        [SKD_REDUCE_POSED] = SKD_CUT_POSED,
    };
    struct skd_session_options options = {
        .slot_count = params->influences,
        .fill = (enum skd_fill)params->fill,
        .cut = cuts[params->reduce],
    };
    status = skd_session_create(rig, &influences, params->file != NULL ? params->file : "",
                                &options, &creating->session, error);
    skd_influences_finish(&influences);
    skd_import_destroy(creating->import);
    creating->import = NULL;
    if (status == SKD_OK && atomic_load(&call->cancelled)) {
        skd_call_cancelled(call, error); /* the session goes with the call */
        status = error->status;
    }
    struct skd_session *session = creating->session;
    if (status == SKD_OK)
        status = skd_memory_check_session(call->daemon, skd_session_bytes(session), error);
    if (status != SKD_OK)
        return status;
    memcpy(session->name, creating->live->name, sizeof session->name);
    session->durability = (enum skd_durability)params->durability;
    if (params->history_bytes > 0)
        session->history.bytes_max = (size_t)params->history_bytes;
    call->apply = keep;
    call->reply.body = skd_describe_created(creating->session);
    return SKD_OK;
}

static void created(struct skd_call *call)
{
    struct creating *creating = call->state;
    if (call->status == SKD_OK) {
        struct skd_live *live = creating->live;
        live->session = creating->session;
        creating->live = NULL;
        creating->session = NULL;
        skd_keeping_begin(call->daemon, live, creating->file,
                          creating->kept != SKD_OK ? &creating->trouble : NULL);
    }
    skd_call_finish(call);
}

/* What did not come to be is taken back. */
static void dismiss(struct skd_call *call)
{
    struct creating *creating = call->state;
    if (creating->live != NULL)
        skd_session_close(call->daemon, creating->live, SKD_KEEPING_REMOVED,
                          "it could not be made");
    skd_import_destroy(creating->import);
    skd_session_destroy(creating->session);
    free(creating);
}

/* What a session of these arrays will take, nearly: each edge of a triangle is kept from both of
 * its ends. */
static size_t bytes_of_arrays(const struct skd_session_create_params *params)
{
    const size_t bone_bytes = 2 * SKD_MATRIX_SIZE * sizeof(double);
    const size_t vertex_bytes =
        3 * sizeof(float) + (size_t)params->influences * (sizeof(uint16_t) + 2 * sizeof(float));
    return params->positions.rows * vertex_bytes + params->triangles.rows * 6 * sizeof(uint32_t) +
           params->bone_parents.rows * bone_bytes;
}

static void imported(void *user)
{
    struct skd_call *call = user;
    struct creating *creating = call->state;
    struct skd_error error;
    enum skd_status status = skd_import_result(creating->import, &error);
    if (status == SKD_CANCELLED)
        skd_call_cancelled(call, &error);
    if (status == SKD_OK)
        status = skd_memory_promise(call->daemon, creating->live,
                                    skd_import_bytes(creating->import), &error);
    if (status != SKD_OK)
        skd_call_fail(call, &error);
    else
        skd_call_work(call, create, created);
}

void skd_handle_session_create(struct skd_call *call)
{
    const struct skd_session_create_params *params = &call->request.params.session_create;
    struct skd_error error;
    struct creating *creating = calloc(1, sizeof *creating);
    enum skd_status status =
        creating != NULL
            ? skd_reserve_name(call->daemon, params->name, params->file, &creating->live, &error)
            : skd_fail_memory(&error, "a session");
    if (status == SKD_OK && params->file == NULL)
        status = skd_memory_promise(call->daemon, creating->live, bytes_of_arrays(params), &error);
    if (status == SKD_OK && params->file != NULL) {
        const struct skd_import_wish wish = {.path = params->file,
                                             .memory_bytes = call->daemon->memory.session_bytes,
                                             .seconds = SKD_IMPORT_SECONDS_MAX,
                                             .cancelled = &call->cancelled,
                                             .done = imported,
                                             .user = call};
        creating->import = skd_import_start(&call->daemon->importer, &wish);
        if (creating->import == NULL)
            status = skd_fail_memory(&error, "a session");
    }
    call->state = creating;
    call->dismiss = creating != NULL ? dismiss : NULL;
    if (status != SKD_OK)
        skd_call_fail(call, &error);
    else if (creating->import == NULL)
        skd_call_work(call, create, created);
}
