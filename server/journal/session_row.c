/* See session_row.h. */
#include "journal/session_row.h"

#include "journal/checksum.h"

#include <stdlib.h>

static uint64_t number_of(double number)
{
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    return bits;
}

static uint64_t session_sum(const struct skd_session_row *row)
{
    const uint64_t numbers[] = {
        row->slots,
        row->vertices,
        row->bones,
        row->rig_bytes,
        row->parts,
        row->sheets,
        row->revision,
        row->report.reduced_count,
        row->report.filled_count,
        row->report.empty_count,
        number_of((double)row->report.largest_cut),
        (uint64_t)row->reduction.pose_count,
        number_of(row->reduction.mean),
        number_of(row->reduction.max),
    };
    uint64_t sum = skd_sum_text(0, row->name);
    return skd_sum_bytes(skd_sum_text(sum, row->source), numbers, sizeof numbers);
}

enum skd_status skd_session_row_write(struct skd_store *store, struct skd_session_row *row,
                                      struct skd_error *error)
{
    sqlite3_stmt *statement = skd_store_statement(store, SKD_SQL_SESSION_WRITE);
    row->sum = session_sum(row);
    int bound = skd_bind_text(statement, 1, row->name);
    bound |= skd_bind_text(statement, 2, row->source);
    bound |= skd_bind_number(statement, 3, row->slots);
    bound |= skd_bind_number(statement, 4, row->vertices);
    bound |= skd_bind_number(statement, 5, row->bones);
    bound |= skd_bind_number(statement, 6, row->rig_bytes);
    bound |= skd_bind_number(statement, 7, row->parts);
    bound |= skd_bind_number(statement, 8, row->sheets);
    bound |= skd_bind_number(statement, 9, row->revision);
    bound |= skd_bind_number(statement, 10, row->report.reduced_count);
    bound |= skd_bind_number(statement, 11, row->report.filled_count);
    bound |= skd_bind_number(statement, 12, row->report.empty_count);
    bound |= sqlite3_bind_double(statement, 13, (double)row->report.largest_cut);
    bound |= sqlite3_bind_int(statement, 14, row->reduction.pose_count);
    bound |= sqlite3_bind_double(statement, 15, row->reduction.mean);
    bound |= sqlite3_bind_double(statement, 16, row->reduction.max);
    bound |= skd_bind_number(statement, 17, row->sum);
    return skd_store_run(store, statement, bound, error);
}

static bool take_text(sqlite3_stmt *row, int column, size_t most, char *out)
{
    const char *text;
    if (!skd_column_text(row, column, most, &text))
        return false;
    memcpy(out, text, strlen(text) + 1);
    return true;
}

static bool take_report(sqlite3_stmt *row, struct skd_session_row *out)
{
    uint64_t reduced, filled, empty, measured, most = SKD_VERTICES_MAX * 64;
    double cut;
    if (!skd_column_number(row, 9, most, &reduced) || !skd_column_number(row, 10, most, &filled) ||
        !skd_column_number(row, 11, most, &empty) || !skd_column_real(row, 12, &cut) ||
        !(cut >= 0 && cut <= 1) || !skd_column_number(row, 13, INT32_MAX, &measured) ||
        !skd_column_real(row, 14, &out->reduction.mean) ||
        !skd_column_real(row, 15, &out->reduction.max))
        return false;
    out->report = (struct skd_slots_report){.reduced_count = (size_t)reduced,
                                            .filled_count = (size_t)filled,
                                            .empty_count = (size_t)empty,
                                            .largest_cut = (float)cut};
    out->reduction.pose_count = (int)measured;
    return true;
}

/* As the wire's schema has it: it becomes part of a file's name. */
static bool is_name(const char *text)
{
    static const char letters[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.";
    return text[0] != '\0' && text[0] != '.' && text[strspn(text, letters)] == '\0';
}

static bool is_instance(const char *text)
{
    return strspn(text, "0123456789abcdef") == SKD_INSTANCE_BYTES &&
           text[SKD_INSTANCE_BYTES] == '\0';
}

enum skd_status skd_session_row_read(struct skd_store *store, struct skd_session_row *out,
                                     struct skd_error *error)
{
    bool has_row;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_SESSION_READ);
    *out = (struct skd_session_row){0};
    enum skd_status status = skd_store_next(store, row, &has_row, error);
    if (status != SKD_OK)
        return status;
    if (!has_row || !take_text(row, 0, SKD_SESSION_NAME_BYTES_MAX, out->name) ||
        !is_name(out->name) || !take_text(row, 1, SKD_PATH_BYTES_MAX, out->source) ||
        !skd_column_number(row, 2, 8, &out->slots) ||
        !skd_column_number(row, 3, SKD_VERTICES_MAX, &out->vertices) ||
        !skd_column_number(row, 4, SKD_BONES_MAX, &out->bones) ||
        !skd_column_number(row, 5, UINT64_C(1) << 40, &out->rig_bytes) ||
        !skd_column_number(row, 6, SKD_PART_REST | SKD_PART_START_JOINTS, &out->parts) ||
        !skd_column_number(row, 7, 2 * SKD_TARGET_POSES_MAX, &out->sheets) ||
        !skd_column_sum(row, 8, &out->revision) || !take_report(row, out) ||
        !skd_column_sum(row, 16, &out->sum) || session_sum(out) != out->sum)
        status = skd_store_damaged(store, "what the session is", error);
    (void)sqlite3_reset(row);
    return status;
}

static uint64_t state_sum(uint64_t seed, const struct skd_state_row *state)
{
    const uint64_t numbers[] = {
        state->revision, state->first,      state->position,      state->count,
        state->exported, state->durability, state->history_bytes, state->chain,
    };
    return skd_sum_bytes(skd_sum_text(seed, state->instance), numbers, sizeof numbers);
}

enum skd_status skd_state_row_write(struct skd_store *store, uint64_t seed,
                                    const struct skd_state_row *state, struct skd_error *error)
{
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_STATE_WRITE);
    int bound = skd_bind_text(row, 1, state->instance);
    bound |= skd_bind_number(row, 2, state->revision);
    bound |= skd_bind_number(row, 3, state->first);
    bound |= skd_bind_number(row, 4, state->position);
    bound |= skd_bind_number(row, 5, state->count);
    bound |= skd_bind_number(row, 6, state->exported);
    bound |= skd_bind_number(row, 7, state->durability);
    bound |= skd_bind_number(row, 8, state->history_bytes);
    bound |= skd_bind_number(row, 9, state->chain);
    bound |= skd_bind_number(row, 10, state_sum(seed, state));
    return skd_store_run(store, row, bound, error);
}

enum skd_status skd_state_row_read(struct skd_store *store, uint64_t seed,
                                   struct skd_state_row *out, struct skd_error *error)
{
    uint64_t sum;
    bool has_row;
    sqlite3_stmt *row = skd_store_statement(store, SKD_SQL_STATE_READ);
    *out = (struct skd_state_row){0};
    enum skd_status status = skd_store_next(store, row, &has_row, error);
    if (status != SKD_OK)
        return status;
    if (!has_row || !take_text(row, 0, SKD_INSTANCE_BYTES, out->instance) ||
        !is_instance(out->instance) || !skd_column_number(row, 1, INT64_MAX, &out->revision) ||
        !skd_column_number(row, 4, INT32_MAX, &out->count) ||
        !skd_column_number(row, 3, out->count, &out->position) ||
        !skd_column_number(row, 2, out->position, &out->first) ||
        !skd_column_number(row, 5, INT64_MAX, &out->exported) ||
        !skd_column_number(row, 6, SKD_DURABILITY_OFF, &out->durability) ||
        !skd_column_number(row, 7, INT64_MAX, &out->history_bytes) ||
        !skd_column_sum(row, 8, &out->chain) || !skd_column_sum(row, 9, &sum) ||
        state_sum(seed, out) != sum)
        status = skd_store_damaged(store, "how far the session has come", error);
    (void)sqlite3_reset(row);
    return status;
}

uint64_t skd_history_chain(uint64_t before, uint64_t place, const struct skd_history_row *row)
{
    const uint64_t numbers[] = {place, row->step, row->revision, row->sum};
    return skd_sum_bytes(before, numbers, sizeof numbers);
}

enum skd_status skd_history_row_write(struct skd_store *store, uint64_t place,
                                      const struct skd_history_row *row, struct skd_error *error)
{
    sqlite3_stmt *statement = skd_store_statement(store, SKD_SQL_HISTORY_WRITE);
    int bound = skd_bind_number(statement, 1, place);
    bound |= skd_bind_number(statement, 2, row->step);
    bound |= skd_bind_number(statement, 3, row->revision);
    bound |= skd_bind_number(statement, 4, row->chain);
    return skd_store_run(store, statement, bound, error);
}
