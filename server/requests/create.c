/* session.create: a file or a client's arrays become a rig session.
 *
 * Stage: request -> rig session. Thread: a worker reads, checks and builds; the loop reserves the
 * name before and opens the session after. Files and arrays meet in skd_session_create.
 */
#include "requests/handlers.h"

#include "requests/close.h"
#include "requests/describe.h"
#include "requests/live.h"
#include "rig/gltf.h"
#include "rig/rig_build.h"
#include "session/creation.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct creating {
    struct skd_live *live; /* reserved; the session is put in when it is made */
    struct skd_session *session;
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

static enum skd_status create(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session_create_params *params = &call->request.params.session_create;
    struct creating *creating = call->state;
    struct skd_rig *rig = NULL;
    struct skd_influences influences = {0};
    enum skd_status status = params->file != NULL
                                 ? skd_gltf_import(params->file, &rig, &influences, error)
                                 : build_from_arrays(params, &rig, &influences, error);
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
    if (status != SKD_OK)
        return status;
    memcpy(creating->session->name, creating->live->name, sizeof creating->live->name);
    call->reply.body = skd_describe_created(creating->session);
    return SKD_OK;
}

static void created(struct skd_call *call)
{
    struct creating *creating = call->state;
    if (call->status == SKD_OK) {
        creating->live->session = creating->session;
        creating->live = NULL;
        creating->session = NULL;
    }
    skd_call_finish(call);
}

/* What did not come to be is taken back. */
static void dismiss(struct skd_call *call)
{
    struct creating *creating = call->state;
    if (creating->live != NULL)
        skd_session_close(call->daemon, creating->live, "it could not be made");
    skd_session_destroy(creating->session);
    free(creating);
}

/* "Knight" from ".../Knight.glb": the file's stem, with '_' for what a name may not hold. */
static void stem_of(const char *file, char name[SKD_SESSION_NAME_BYTES_MAX + 1])
{
    const char *slash = strrchr(file, '/');
    const char *stem = slash != NULL ? slash + 1 : file;
    const char *dot = strrchr(stem, '.');
    size_t length = dot != NULL ? (size_t)(dot - stem) : strlen(stem);
    size_t used = 0;
    for (size_t i = 0; i < length && used < SKD_SESSION_NAME_BYTES_MAX - 4; i++) {
        unsigned char letter = (unsigned char)stem[i];
        bool plain = letter < 128 && (isalnum(letter) || letter == '_' || letter == '-');
        name[used++] = plain ? (char)letter : '_';
    }
    name[used] = '\0';
    if (used == 0)
        (void)snprintf(name, SKD_SESSION_NAME_BYTES_MAX, "rig");
}

/* The wanted name, or one made from the file's that is not taken. */
static enum skd_status reserve(struct skd_daemon *daemon,
                               const struct skd_session_create_params *params,
                               struct skd_live **live, struct skd_error *error)
{
    if (params->name != NULL)
        return skd_live_reserve(daemon, params->name, live, error);
    char stem[SKD_SESSION_NAME_BYTES_MAX + 1], name[SKD_SESSION_NAME_BYTES_MAX + 16];
    stem_of(params->file != NULL ? params->file : "rig", stem);
    (void)snprintf(name, sizeof name, "%s", stem);
    enum skd_status status = skd_live_reserve(daemon, name, live, error);
    for (int number = 2; status == SKD_NAME_TAKEN && number <= SKD_SESSIONS_MAX + 1; number++) {
        (void)snprintf(name, sizeof name, "%s-%d", stem, number);
        status = skd_live_reserve(daemon, name, live, error);
    }
    return status;
}

void skd_handle_session_create(struct skd_call *call)
{
    const struct skd_session_create_params *params = &call->request.params.session_create;
    struct skd_error error;
    struct creating *creating = calloc(1, sizeof *creating);
    enum skd_status status = creating != NULL
                                 ? reserve(call->daemon, params, &creating->live, &error)
                                 : skd_fail_memory(&error, "a session");
    if (status != SKD_OK) {
        free(creating);
        skd_call_fail(call, &error);
        return;
    }
    call->state = creating;
    call->dismiss = dismiss;
    skd_call_work(call, create, created);
}
