/* See remembered.h. */
#include "session/remembered.h"

#include <stdlib.h>
#include <string.h>

static struct skd_remembered_client *find_client(const struct skd_remembered *remembered,
                                                 const char *id)
{
    struct skd_remembered_client *client;
    HASH_FIND_STR(remembered->clients, id, client);
    return client;
}

enum skd_remembered_kind skd_remembered_find(const struct skd_remembered *remembered,
                                             const char *client_id, uint64_t sequence,
                                             const char **text)
{
    const struct skd_remembered_client *client = find_client(remembered, client_id);
    if (client == NULL)
        return SKD_SEQUENCE_NEW;
    for (size_t i = 0; i < client->count; i++) {
        if (client->answers[i].sequence == sequence) {
            *text = client->answers[i].text;
            return SKD_SEQUENCE_REPEATED;
        }
    }
    /* What is missing between those that are here failed, and may be done now. Of those before
     * them nobody knows, if there may have been any: a full list may have come from a file. */
    bool is_full = client->count == SKD_REMEMBERED_ANSWERS_MAX;
    bool is_stale =
        sequence <= client->forgotten || (is_full && sequence < client->answers[0].sequence);
    return is_stale ? SKD_SEQUENCE_STALE : SKD_SEQUENCE_NEW;
}

static size_t bytes_of(const struct skd_remembered_answer *answer)
{
    return strlen(answer->text) + 1;
}

static void free_client(struct skd_remembered *remembered, struct skd_remembered_client *client)
{
    for (size_t i = 0; i < client->count; i++) {
        remembered->bytes -= bytes_of(&client->answers[i]);
        free(client->answers[i].text);
    }
    remembered->bytes -= sizeof *client;
    free(client);
}

static void drop_client(struct skd_remembered *remembered, struct skd_remembered_client *client)
{
    HASH_DEL(remembered->clients, client);
    free_client(remembered, client);
}

static void drop_oldest(struct skd_remembered *remembered, struct skd_remembered_client *client)
{
    client->forgotten = client->answers[0].sequence;
    remembered->bytes -= bytes_of(&client->answers[0]);
    free(client->answers[0].text);
    client->count--;
    memmove(client->answers, client->answers + 1, client->count * sizeof *client->answers);
}

/* Of who was silent longest the oldest first; the newest answer of who spoke last stays. */
static void keep_to_bytes(struct skd_remembered *remembered)
{
    while (remembered->bytes > SKD_REMEMBERED_BYTES_MAX) {
        struct skd_remembered_client *silent = remembered->clients;
        if (silent->count > 1)
            drop_oldest(remembered, silent);
        else if (silent->hh.next != NULL)
            drop_client(remembered, silent);
        else
            break;
    }
}

/* The client, made where it is not known, as the last one of the table. NULL: no memory. */
static struct skd_remembered_client *need_client(struct skd_remembered *remembered, const char *id)
{
    struct skd_remembered_client *client = find_client(remembered, id);
    if (client != NULL) {
        if (client->hh.next == NULL)
            return client;
        HASH_DEL(remembered->clients, client);
    } else {
        client = calloc(1, sizeof *client);
        if (client == NULL)
            return NULL;
        memcpy(client->id, id, strlen(id) + 1);
        remembered->bytes += sizeof *client;
    }
    HASH_ADD_STR(remembered->clients, id, client);
    if (!skd_hash_added(client)) {
        free_client(remembered, client);
        return NULL;
    }
    if (HASH_COUNT(remembered->clients) > SKD_REMEMBERED_CLIENTS_MAX)
        drop_client(remembered, remembered->clients);
    return client;
}

enum skd_status skd_remembered_reserve(struct skd_remembered *remembered, const char *client_id,
                                       struct skd_error *error)
{
    return need_client(remembered, client_id) != NULL
               ? SKD_OK
               : skd_fail_memory(error, "an answer to give again");
}

void skd_remembered_put(struct skd_remembered *remembered, const char *client_id, uint64_t sequence,
                        uint64_t revision, char *answer)
{
    struct skd_remembered_client *client = find_client(remembered, client_id);
    SKD_ASSERT(client != NULL);
    if (client->count == SKD_REMEMBERED_ANSWERS_MAX)
        drop_oldest(remembered, client);
    size_t at = client->count++;
    for (; at > 0 && client->answers[at - 1].sequence > sequence; at--)
        client->answers[at] = client->answers[at - 1];
    client->answers[at] = (struct skd_remembered_answer){sequence, revision, answer};
    remembered->bytes += bytes_of(&client->answers[at]);
    keep_to_bytes(remembered);
}

enum skd_status skd_remembered_add(struct skd_remembered *remembered, const char *client_id,
                                   uint64_t sequence, uint64_t revision, const char *answer,
                                   struct skd_error *error)
{
    char *text = strdup(answer);
    if (text == NULL)
        return skd_fail_memory(error, "an answer to give again");
    enum skd_status status = skd_remembered_reserve(remembered, client_id, error);
    if (status == SKD_OK)
        skd_remembered_put(remembered, client_id, sequence, revision, text);
    else
        free(text);
    return status;
}

void skd_remembered_each(const struct skd_remembered *remembered,
                         bool (*visit)(void *user, const char *client_id, uint64_t sequence,
                                       uint64_t revision, const char *answer),
                         void *user)
{
    const struct skd_remembered_client *client, *next;
    HASH_ITER(hh, remembered->clients, client, next)
    {
        for (size_t i = 0; i < client->count; i++) {
            const struct skd_remembered_answer *answer = &client->answers[i];
            if (!visit(user, client->id, answer->sequence, answer->revision, answer->text))
                return;
        }
    }
}

void skd_remembered_finish(struct skd_remembered *remembered)
{
    struct skd_remembered_client *client, *next;
    HASH_ITER(hh, remembered->clients, client, next)
    {
        drop_client(remembered, client);
    }
}
