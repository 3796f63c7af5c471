/* See remembered_rows.h. */
#include "journal/remembered_rows.h"

#include "journal/checksum.h"

#include <stdlib.h>
#include <string.h>

static uint64_t sum_of(uint64_t id, const char *client, uint64_t sequence, uint64_t revision,
                       const char *answer)
{
    uint64_t sum = skd_sum_text(id, client);
    return skd_sum_text(skd_sum_number(skd_sum_number(sum, sequence), revision), answer);
}

static enum skd_status delete_row(struct skd_store *store, uint64_t id, struct skd_error *error)
{
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_REMEMBERED_DELETE);
    return skd_store_run(store, row, skd_bind_number(row, 1, id), error);
}

/* Makes room for one more client where there is none: the one that was longest silent goes. */
static enum skd_status drop_silent(struct skd_store *store, struct skd_remembered_rows *rows,
                                   struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    if (rows->count < SKD_REMEMBERED_CLIENTS_MAX)
        return SKD_OK;
    for (size_t i = 0; i < rows->clients[0].count && status == SKD_OK; i++)
        status = delete_row(store, rows->clients[0].rows[i], error);
    rows->count--;
    memmove(rows->clients, rows->clients + 1, rows->count * sizeof *rows->clients);
    return status;
}

/* The client, made the last one to have spoken, with room for one more row. */
static enum skd_status find_client(struct skd_store *store, struct skd_remembered_rows *rows,
                                   const char *id, struct skd_speaker_rows **client,
                                   struct skd_error *error)
{
    struct skd_speaker_rows found = {0};
    enum skd_status status = SKD_OK;
    size_t at = 0;
    while (at < rows->count && strcmp(rows->clients[at].id, id) != 0)
        at++;
    if (at < rows->count) {
        found = rows->clients[at];
        rows->count--;
        memmove(rows->clients + at, rows->clients + at + 1,
                (rows->count - at) * sizeof *rows->clients);
    } else {
        memcpy(found.id, id, strlen(id) + 1);
        status = drop_silent(store, rows, error);
    }
    if (status == SKD_OK && found.count == SKD_REMEMBERED_ANSWERS_MAX) {
        status = delete_row(store, found.rows[0], error);
        found.count--;
        memmove(found.rows, found.rows + 1, found.count * sizeof *found.rows);
    }
    *client = &rows->clients[rows->count++];
    **client = found;
    return status;
}

enum skd_status skd_remembered_rows_add(struct skd_store *store, struct skd_remembered_rows *rows,
                                        const char *client_id, uint64_t sequence, uint64_t revision,
                                        const char *answer, struct skd_error *error)
{
    struct skd_speaker_rows *client;
    enum skd_status status = find_client(store, rows, client_id, &client, error);
    if (status != SKD_OK)
        return status;
    uint64_t id = rows->next_id++;
    client->rows[client->count++] = id;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_REMEMBERED_WRITE);
    int bound = skd_bind_number(row, 1, id);
    bound |= skd_bind_text(row, 2, client_id);
    bound |= skd_bind_number(row, 3, sequence);
    bound |= skd_bind_number(row, 4, revision);
    bound |= skd_bind_text(row, 5, answer);
    bound |= skd_bind_number(row, 6, sum_of(id, client_id, sequence, revision, answer));
    return skd_store_run(store, row, bound, error);
}

/* A row as it is read. Texts are the statement's. */
struct row {
    uint64_t id, sequence, revision;
    const char *client, *answer;
};

static bool take(sqlite3_stmt *statement, struct row *row)
{
    uint64_t sum;
    return skd_column_number(statement, 0, INT64_MAX - 1, &row->id) &&
           skd_column_text(statement, 1, SKD_CLIENT_ID_BYTES_MAX, &row->client) &&
           skd_column_number(statement, 2, INT64_MAX, &row->sequence) &&
           skd_column_number(statement, 3, INT64_MAX, &row->revision) &&
           skd_column_text(statement, 4, SKD_JSON_BYTES_MAX, &row->answer) &&
           skd_column_sum(statement, 5, &sum) &&
           sum_of(row->id, row->client, row->sequence, row->revision, row->answer) == sum;
}

enum skd_status skd_remembered_rows_start(struct skd_remembered_rows *rows, struct skd_error *error)
{
    *rows = (struct skd_remembered_rows){
        .next_id = 1, .clients = calloc(SKD_REMEMBERED_CLIENTS_MAX, sizeof *rows->clients)};
    return rows->clients != NULL ? SKD_OK : skd_fail_memory(error, "the answers to give again");
}

enum skd_status skd_remembered_rows_open(struct skd_store *store, struct skd_remembered_rows *rows,
                                         struct skd_error *error)
{
    bool has_row;
    enum skd_status status = skd_remembered_rows_start(rows, error);
    if (status != SKD_OK)
        return status;
    sqlite3_stmt *statement = skd_store_statement(store, SKD_SQL_REMEMBERED_READ);
    while ((status = skd_store_next(store, statement, &has_row, error)) == SKD_OK && has_row) {
        struct row row;
        struct skd_speaker_rows *client;
        status = take(statement, &row) ? find_client(store, rows, row.client, &client, error)
                                       : skd_store_damaged(store, "an answer", error);
        if (status != SKD_OK) {
            (void)sqlite3_reset(statement);
            return status;
        }
        client->rows[client->count++] = row.id;
        rows->next_id = row.id + 1;
    }
    return status;
}

void skd_remembered_rows_finish(struct skd_remembered_rows *rows)
{
    free(rows->clients);
    *rows = (struct skd_remembered_rows){0};
}

struct walk {
    struct skd_store *store;
    struct skd_remembered_rows rows;
    enum skd_status status;
    struct skd_error *error;
};

static bool write_one(void *user, const char *client_id, uint64_t sequence, uint64_t revision,
                      const char *answer)
{
    struct walk *walk = user;
    walk->status = skd_remembered_rows_add(walk->store, &walk->rows, client_id, sequence, revision,
                                           answer, walk->error);
    return walk->status == SKD_OK;
}

enum skd_status skd_remembered_rows_write(struct skd_store *store,
                                          const struct skd_session *session,
                                          struct skd_error *error)
{
    struct walk walk = {.store = store, .error = error};
    walk.status = skd_remembered_rows_start(&walk.rows, error);
    if (walk.status == SKD_OK)
        skd_remembered_each(&session->remembered, write_one, &walk);
    skd_remembered_rows_finish(&walk.rows);
    return walk.status;
}

enum skd_status skd_remembered_rows_read(struct skd_store *store, struct skd_session *session,
                                         size_t *damaged, struct skd_error *error)
{
    bool has_row;
    enum skd_status status;
    *damaged = 0;
    sqlite3_stmt *statement = skd_store_statement(store, SKD_SQL_REMEMBERED_READ);
    while ((status = skd_store_next(store, statement, &has_row, error)) == SKD_OK && has_row) {
        struct row row;
        if (!take(statement, &row))
            status = skd_store_damaged(store, "an answer", error);
        else if (row.revision <= session->revision) /* what it answered is not lost */
            status = skd_remembered_add(&session->remembered, row.client, row.sequence,
                                        row.revision, row.answer, error);
        *damaged += status == SKD_DAMAGED;
        if (status != SKD_OK && status != SKD_DAMAGED) {
            (void)sqlite3_reset(statement);
            return status;
        }
    }
    *damaged += status == SKD_DAMAGED; /* what comes after cannot be reached */
    return status == SKD_DAMAGED ? SKD_OK : status;
}
