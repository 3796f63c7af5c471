/* See prune.h. */
#include "session/prune.h"

#include "session/row_edit.h"

static size_t prune_row(int n, const uint16_t *joints, float *weights, float below)
{
    int largest = skd_row_largest(n, joints, weights);
    size_t removed = 0;
    for (int i = 0; i < n; i++) {
        bool none = !(weights[i] > 0) && !(weights[i] < 0);
        if (none || i == largest || weights[i] >= below)
            continue;
        weights[i] = 0;
        removed++;
    }
    if (removed > 0)
        skd_row_scale(n, joints, weights);
    return removed;
}

enum skd_status skd_prune_prepare(struct skd_session *session, const struct skd_edit_scope *scope,
                                  double below, struct skd_step **step, size_t *removed,
                                  struct skd_error *error)
{
    struct skd_rows rows = {0};
    uint32_t *vertices;
    size_t count, n = (size_t)session->slot_count;
    *removed = 0;
    enum skd_status status = skd_rows_list(session, scope, &vertices, &count, error);
    if (status == SKD_OK)
        status = skd_rows_take(session, vertices, count, &rows, error);
    for (size_t i = 0; i < rows.count && status == SKD_OK; i++) {
        *removed +=
            prune_row(rows.slot_count, rows.joints + i * n, rows.weights + i * n, (float)below);
        status = skd_scope_check(scope, i, error);
    }
    if (status == SKD_OK)
        status = skd_rows_step(session, &rows, step, error);
    skd_rows_finish(&rows);
    return status;
}
