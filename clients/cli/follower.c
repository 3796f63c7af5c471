/* See follower.h. */
#include "clients/cli/follower.h"

#include "clients/cli/model.h"
#include "clients/cli/print.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <xxhash.h>

/* An array of a message as `count` rows of `width`, copied to the rows that `vertices` names (NULL:
 * one after the other). */
static enum skd_status copy_rows(const struct skd_message *message, const cJSON *object,
                                 const char *name, enum skd_dtype dtype, const uint32_t *vertices,
                                 size_t count, size_t width, void *rows, struct skd_error *error)
{
    struct skd_array array;
    void *owned;
    enum skd_status status =
        skd_message_array(message, object, name, dtype, width, &array, &owned, error);
    size_t bytes = width * skd_dtype_bytes(dtype);
    if (status == SKD_OK && array.data != NULL && array.count != count * width)
        status = skd_fail(error, SKD_INTERNAL, "skind sent %s of another size", name);
    for (size_t i = 0; status == SKD_OK && array.data != NULL && i < count; i++)
        memcpy((char *)rows + (vertices != NULL ? vertices[i] : i) * bytes,
               (const char *)array.data + i * bytes, bytes);
    free(owned);
    return status;
}

static enum skd_status keep_weights(struct skd_follower *follower, const struct skd_message *answer,
                                    struct skd_error *error)
{
    struct skd_array array;
    void *owned;
    size_t slots = (size_t)skd_json_number(answer->result, "influences");
    enum skd_status status =
        skd_message_array(answer, answer->result, "weights", SKD_F32, slots, &array, &owned, error);
    free(owned);
    if (status != SKD_OK)
        return status;
    size_t count = array.rows;
    skd_follower_finish(follower);
    follower->slots = slots;
    follower->vertex_count = count;
    follower->joints = malloc(count * slots * sizeof *follower->joints + 1);
    follower->weights = malloc(count * slots * sizeof *follower->weights + 1);
    if (follower->joints == NULL || follower->weights == NULL)
        return skd_fail_memory(error, "the weights");
    status = copy_rows(answer, answer->result, "joints", SKD_U16, NULL, count, slots,
                       follower->joints, error);
    return status == SKD_OK ? copy_rows(answer, answer->result, "weights", SKD_F32, NULL, count,
                                        slots, follower->weights, error)
                            : status;
}

enum skd_status skd_follower_fetch(struct skd_follower *follower, struct skd_link *link,
                                   struct skd_error *error)
{
    struct skd_message answer;
    if (follower->is_whole || !follower->holds_weights)
        return SKD_OK;
    enum skd_status status = skd_link_call(link, "weights.get", skd_session_body(follower->session),
                                           NULL, 0, &answer, error);
    if (status == SKD_OK)
        status = keep_weights(follower, &answer, error);
    if (status == SKD_OK) {
        follower->revision = skd_json_number(answer.result, "revision");
        follower->is_whole = true;
    }
    skd_message_finish(&answer);
    return status;
}

static void adopt_instance(struct skd_follower *follower, const cJSON *told)
{
    (void)snprintf(follower->instance, sizeof follower->instance, "%s",
                   skd_json_text(told, "instance"));
}

enum skd_status skd_follower_attach(struct skd_follower *follower, struct skd_link *link,
                                    struct skd_message *answer, struct skd_error *error)
{
    cJSON *body = skd_session_body(follower->session);
    bool has_revision = follower->revision >= 0 && (follower->is_whole || !follower->holds_weights);
    if (has_revision) {
        cJSON_AddNumberToObject(body, "revision", follower->revision);
        cJSON_AddStringToObject(body, "instance", follower->instance);
    }
    enum skd_status status = skd_link_call(link, "session.attach", body, NULL, 0, answer, error);
    if (status != SKD_OK)
        return status;
    adopt_instance(follower, answer->result);
    if (!has_revision || cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(answer->result, "resync"))) {
        follower->revision = skd_json_number(answer->result, "revision");
        follower->is_whole = false;
    }
    return SKD_OK;
}

static enum skd_status apply(struct skd_follower *follower, const struct skd_message *update,
                             struct skd_error *error)
{
    struct skd_array vertices;
    void *owned;
    enum skd_status status =
        skd_message_array(update, update->params, "vertices", SKD_U32, 0, &vertices, &owned, error);
    const uint32_t *named = vertices.data;
    for (size_t i = 0; status == SKD_OK && i < vertices.count; i++) {
        if (named[i] >= follower->vertex_count)
            status = skd_fail(error, SKD_INTERNAL, "skind names vertex %u of %zu",
                              (unsigned)named[i], follower->vertex_count);
    }
    if (status == SKD_OK)
        status = copy_rows(update, update->params, "joints", SKD_U16, named, vertices.count,
                           follower->slots, follower->joints, error);
    if (status == SKD_OK)
        status = copy_rows(update, update->params, "weights", SKD_F32, named, vertices.count,
                           follower->slots, follower->weights, error);
    free(owned);
    return status;
}

bool skd_follower_is_behind(const struct skd_follower *follower, const struct skd_message *update)
{
    return skd_json_number(update->params, "revision") > follower->revision;
}

enum skd_status skd_follower_take(struct skd_follower *follower, struct skd_link *link,
                                  const struct skd_message *update, struct skd_error *error)
{
    const cJSON *told = update->params;
    bool is_whole = follower->is_whole &&
                    !cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(told, "resync")) &&
                    skd_json_number(told, "since") <= follower->revision;
    adopt_instance(follower, told);
    follower->is_whole = false; /* should it fail half way */
    if (is_whole && apply(follower, update, error) != SKD_OK)
        return error->status;
    follower->revision = skd_json_number(told, "revision");
    follower->is_whole = is_whole;
    return skd_follower_fetch(follower, link, error);
}

void skd_follower_digest(const struct skd_follower *follower, char digest[SKD_DIGEST_BYTES])
{
    size_t count = follower->vertex_count * follower->slots;
    uint64_t joints = XXH3_64bits(follower->joints, count * sizeof *follower->joints);
    XXH128_hash_t hash =
        XXH3_128bits_withSeed(follower->weights, count * sizeof *follower->weights, joints);
    (void)snprintf(digest, SKD_DIGEST_BYTES, "%016llx%016llx", (unsigned long long)hash.high64,
                   (unsigned long long)hash.low64);
}

void skd_follower_finish(struct skd_follower *follower)
{
    free(follower->joints);
    free(follower->weights);
    follower->joints = NULL;
    follower->weights = NULL;
}
