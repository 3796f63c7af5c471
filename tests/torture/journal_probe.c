/* Reads sessions' files for torn.py: a path a line on stdin, an answer a line on stdout:
 *
 *     STATUS REVISION CUT HASH HASH TEXT
 *
 * STATUS is an error's wire name, or "ok"; CUT 1 where something was lost. The hashes (FNV-1a,
 * hexadecimal) are over joints, weights and rest positions, so that torn.py can hold them against
 * what a daemon told: as the file is, and once all is undone.
 */
#include "journal/read.h"
#include "protocol/errors.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static uint64_t add_bytes(uint64_t hash, const void *data, size_t bytes)
{
    const unsigned char *at = data;
    for (size_t i = 0; i < bytes; i++)
        hash = (hash ^ at[i]) * UINT64_C(0x100000001b3);
    return hash;
}

static uint64_t hash_of(const struct skd_session *session)
{
    const size_t vertices = session->rig->mesh.vertex_count;
    const size_t slots = vertices * (size_t)session->slot_count;
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    hash = add_bytes(hash, session->joints, slots * sizeof *session->joints);
    hash = add_bytes(hash, session->weights, slots * sizeof *session->weights);
    return add_bytes(hash, session->rest, vertices * 3 * sizeof *session->rest);
}

static void undo_all(struct skd_session *session)
{
    struct skd_history *history = &session->history;
    struct skd_step *step;
    while ((step = skd_history_undoable(history)) != NULL) {
        skd_session_write(session, step, true);
        skd_history_move(history, -1, history->position - 1, session->revision);
    }
}

static void tell(const char *path)
{
    struct skd_session *session = NULL;
    struct skd_journal_report report = {0};
    struct skd_error error = {0};
    uint64_t held = 0, begun = 0;
    enum skd_status status = skd_journal_read(path, NULL, &session, &report, &error);
    if (status == SKD_OK) {
        held = hash_of(session);
        undo_all(session);
        begun = hash_of(session);
    }
    printf("%s %" PRIu64 " %d %016" PRIx64 " %016" PRIx64 " %s\n",
           status == SKD_OK ? "ok" : skd_error_entry(status)->name, report.revision, report.cut,
           held, begun, status == SKD_OK ? report.text : error.text);
    fflush(stdout);
    skd_session_destroy(session);
}

int main(void)
{
    char line[4096];
    while (fgets(line, sizeof line, stdin) != NULL) {
        line[strcspn(line, "\n")] = '\0';
        tell(line);
    }
    return 0;
}
