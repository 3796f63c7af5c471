/* weights.get and mesh.get: a session's arrays.
 *
 * Stage: job -> reply. Thread: a worker, in the session's turn, so that the session neither changes
 * nor goes away under it.
 */
#include "requests/handlers.h"

#include <stdlib.h>
#include <string.h>

static enum skd_status get_weights(struct skd_call *call, struct skd_error *error)
{
    const struct skd_shown_params *params = &call->request.params.shown;
    const struct skd_session *session = call->live->session;
    const uint32_t *vertices = params->vertices.data;
    size_t slots = (size_t)session->slot_count;
    size_t count =
        params->vertices_given ? params->vertices.count : session->rig->mesh.vertex_count;
    if (params->vertices_given) {
        enum skd_status status = skd_session_check_vertices(session, vertices, count, error);
        if (status != SKD_OK)
            return status;
    }
    float *weights = malloc(count * slots * (sizeof(float) + sizeof(uint16_t)) + 1);
    if (weights == NULL)
        return skd_fail_memory(error, "the weights");
    uint16_t *joints = (uint16_t *)(weights + count * slots);
    if (!params->vertices_given) {
        memcpy(weights, session->weights, count * slots * sizeof(float));
        memcpy(joints, session->joints, count * slots * sizeof(uint16_t));
    }
    for (size_t i = 0; params->vertices_given && i < count; i++) {
        memcpy(weights + i * slots, session->weights + vertices[i] * slots, slots * sizeof(float));
        memcpy(joints + i * slots, session->joints + vertices[i] * slots, slots * sizeof(uint16_t));
    }
    struct skd_reply *reply = &call->reply;
    reply->body = cJSON_CreateObject();
    cJSON_AddNumberToObject(reply->body, "revision", (double)session->revision);
    cJSON_AddNumberToObject(reply->body, "influences", session->slot_count);
    reply->arrays[0] = (struct skd_array_out){"joints", SKD_U16, count, slots, joints};
    reply->arrays[1] = (struct skd_array_out){"weights", SKD_F32, count, slots, weights};
    reply->array_count = 2;
    reply->owner = weights;
    reply->release = free;
    return SKD_OK;
}

/* 3x4 matrices as the wire has them: 4x4, with the last row 0 0 0 1. */
static void widen(const double *matrices, int count, double *out)
{
    static const double last_row[4] = {0, 0, 0, 1};
    for (int i = 0; i < count; i++) {
        memcpy(out + 16 * i, matrices + 12 * i, 12 * sizeof(double));
        memcpy(out + 16 * i + 12, last_row, sizeof last_row);
    }
}

static enum skd_status get_mesh(struct skd_call *call, struct skd_error *error)
{
    const struct skd_session *session = call->live->session;
    const struct skd_mesh *mesh = &session->rig->mesh;
    const struct skd_skeleton *skeleton = &session->rig->skeleton;
    size_t bone_count = (size_t)skeleton->bone_count;
    size_t bind_bytes = bone_count * 16 * sizeof(double);
    size_t position_bytes = mesh->vertex_count * 3 * sizeof(float);
    size_t triangle_bytes = mesh->triangle_count * 3 * sizeof(uint32_t);
    /* A copy: the rig may be closed before the last byte is written. */
    char *binds = malloc(bind_bytes + 2 * position_bytes + triangle_bytes + 1);
    if (binds == NULL)
        return skd_fail_memory(error, "the mesh");
    char *positions = binds + bind_bytes, *rest = positions + position_bytes;
    char *triangles = rest + position_bytes;
    widen(skeleton->inverse_binds, skeleton->bone_count, (double *)binds);
    memcpy(positions, mesh->rest, position_bytes);
    memcpy(rest, session->rest, position_bytes);
    memcpy(triangles, mesh->triangles, triangle_bytes);
    struct skd_reply *reply = &call->reply;
    reply->body = cJSON_CreateObject();
    reply->arrays[0] =
        (struct skd_array_out){"positions", SKD_F32, mesh->vertex_count, 3, positions};
    reply->arrays[1] =
        (struct skd_array_out){"triangles", SKD_U32, mesh->triangle_count, 3, triangles};
    reply->arrays[2] = (struct skd_array_out){"inverse_binds", SKD_F64, bone_count, 16, binds};
    reply->arrays[3] = (struct skd_array_out){"rest", SKD_F32, mesh->vertex_count, 3, rest};
    reply->array_count = 4;
    reply->owner = binds;
    reply->release = free;
    return SKD_OK;
}

static void begin_weights(struct skd_call *call)
{
    skd_call_work(call, get_weights, NULL);
}

static void begin_mesh(struct skd_call *call)
{
    skd_call_work(call, get_mesh, NULL);
}

static void take_turn(struct skd_call *call, const char *name, void (*begin)(struct skd_call *call))
{
    struct skd_live *live = skd_call_find_session(call, name);
    if (live != NULL)
        skd_call_take_turn(call, live, begin);
}

void skd_handle_weights_get(struct skd_call *call)
{
    take_turn(call, call->request.params.shown.session, begin_weights);
}

void skd_handle_mesh_get(struct skd_call *call)
{
    take_turn(call, call->request.params.session.session, begin_mesh);
}
