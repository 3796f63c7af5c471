/* See claim.h. */
#include "requests/claim.h"

#include <stdlib.h>
#include <string.h>

struct skd_claim *skd_claim_hold(struct skd_claim *claim)
{
    claim->references++;
    return claim;
}

void skd_claim_release(void *held)
{
    struct skd_claim *claim = held;
    if (claim == NULL || --claim->references > 0)
        return;
    free(claim->bones);
    free(claim->is_bone);
    free(claim->vertices);
    free(claim->bits);
    free(claim);
}

static bool has_bit(const uint8_t *bits, uint32_t vertex)
{
    return (bits[vertex >> 3] >> (vertex & 7) & 1) != 0;
}

static enum skd_status take_bones(struct skd_claim *claim, const struct skd_skeleton *skeleton,
                                  const struct skd_session_claim_params *params,
                                  struct skd_error *error)
{
    claim->is_bone = calloc((size_t)skeleton->bone_count, 1);
    claim->bones = calloc((size_t)skeleton->bone_count, sizeof *claim->bones);
    if (claim->is_bone == NULL || claim->bones == NULL)
        return skd_fail_memory(error, "a claim");
    for (size_t i = 0; i < params->bone_count; i++) {
        bool found = false;
        for (int bone = 0; bone < skeleton->bone_count; bone++) {
            if (strcmp(skeleton->names[bone], params->bones[i]) == 0)
                claim->is_bone[bone] = 1, found = true;
        }
        if (!found)
            return skd_fail(error, SKD_NO_BONE,
                            "bones names \"%s\", which is no bone of session "
                            "\"%s\"",
                            params->bones[i], params->session);
    }
    for (int bone = 0; bone < skeleton->bone_count; bone++) {
        if (claim->is_bone[bone] != 0)
            claim->bones[claim->bone_count++] = (uint16_t)bone;
    }
    claim->bytes += (size_t)skeleton->bone_count * (1 + sizeof *claim->bones);
    return SKD_OK;
}

static enum skd_status take_vertices(struct skd_claim *claim, const struct skd_session *session,
                                     const struct skd_array *named, struct skd_error *error)
{
    const uint32_t *vertices = named->data;
    size_t all = session->rig->mesh.vertex_count;
    if (named->count == 0)
        return SKD_OK;
    enum skd_status status = skd_session_check_vertices(session, vertices, named->count, error);
    if (status != SKD_OK)
        return status;
    claim->bits = calloc(all / 8 + 1, 1);
    if (claim->bits == NULL)
        return skd_fail_memory(error, "a claim");
    for (size_t i = 0; i < named->count; i++) {
        uint8_t bit = (uint8_t)(1U << (vertices[i] & 7));
        claim->vertex_count += (claim->bits[vertices[i] >> 3] & bit) == 0;
        claim->bits[vertices[i] >> 3] |= bit;
    }
    claim->vertices = malloc(claim->vertex_count * sizeof *claim->vertices);
    if (claim->vertices == NULL)
        return skd_fail_memory(error, "a claim");
    size_t count = 0;
    for (uint32_t vertex = 0; vertex < all; vertex++) {
        if (has_bit(claim->bits, vertex))
            claim->vertices[count++] = vertex;
    }
    claim->bytes += all / 8 + 1 + count * sizeof *claim->vertices;
    return SKD_OK;
}

enum skd_status skd_claim_create(const struct skd_session *session,
                                 const struct skd_session_claim_params *params,
                                 struct skd_claim **result, struct skd_error *error)
{
    struct skd_claim *claim = calloc(1, sizeof *claim);
    *result = claim;
    if (claim == NULL)
        return skd_fail_memory(error, "a claim");
    claim->references = 1;
    claim->bytes = sizeof *claim;
    enum skd_status status = take_bones(claim, &session->rig->skeleton, params, error);
    if (status == SKD_OK)
        status = take_vertices(claim, session, &params->vertices, error);
    return status;
}

void skd_claim_drop(struct skd_live *live, struct skd_listener_of_session *listener)
{
    if (listener->claim == NULL)
        return;
    live->claim_bytes -= listener->claim->bytes;
    skd_claim_release(listener->claim);
    listener->claim = NULL;
}

void skd_claim_add_bones(cJSON *object, const struct skd_live *live, const struct skd_claim *claim)
{
    cJSON *bones = cJSON_AddArrayToObject(object, "bones");
    for (int i = 0; claim != NULL && i < claim->bone_count; i++)
        cJSON_AddItemToArray(
            bones, cJSON_CreateString(live->session->rig->skeleton.names[claim->bones[i]]));
}

cJSON *skd_claim_describe(const struct skd_live *live,
                          const struct skd_listener_of_session *listener)
{
    const struct skd_claim *claim = listener->claim;
    cJSON *object = cJSON_CreateObject();
    skd_claim_add_bones(object, live, claim);
    cJSON_AddNumberToObject(object, "vertices", claim != NULL ? (double)claim->vertex_count : 0);
    return object;
}

bool skd_claim_covers(const struct skd_claim *claim, uint32_t vertex, uint16_t bone)
{
    return (claim->bits != NULL && has_bit(claim->bits, vertex)) ||
           (bone != SKD_SLOT_EMPTY && claim->is_bone[bone] != 0);
}
