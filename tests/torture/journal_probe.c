/* Reads sessions' files for torn.py: a path a line on stdin, an answer a line on stdout:
 *
 *     STATUS REVISION STEPS CUT HASH TEXT
 *
 * STATUS is an error's wire name, or "ok"; CUT 1 where something was lost; HASH (FNV-1a,
 * hexadecimal) is over joints, weights and rest positions, so that torn.py can hold it against what
 * a daemon told.
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

int main(void)
{
    char line[4096];
    while (fgets(line, sizeof line, stdin) != NULL) {
        struct skd_session *session = NULL;
        struct skd_journal_report report = {0};
        struct skd_error error = {0};
        line[strcspn(line, "\n")] = '\0';
        enum skd_status status = skd_journal_read(line, NULL, &session, &report, &error);
        printf("%s %" PRIu64 " %zu %d %016" PRIx64 " %s\n",
               status == SKD_OK ? "ok" : skd_error_entry(status)->name, report.revision,
               report.steps, report.cut, status == SKD_OK ? hash_of(session) : 0,
               status == SKD_OK ? report.text : error.text);
        fflush(stdout);
        skd_session_destroy(session);
    }
    return 0;
}
