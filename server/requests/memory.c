/* See memory.h. */
#include "requests/memory.h"

#include <unistd.h>

static size_t machine_bytes(void)
{
    const long pages = sysconf(_SC_PHYS_PAGES), page_bytes = sysconf(_SC_PAGESIZE);
    return pages > 0 && page_bytes > 0 ? (size_t)pages * (size_t)page_bytes : SIZE_MAX / 2;
}

void skd_memory_set_limits(struct skd_daemon *daemon, size_t total_bytes, size_t session_bytes)
{
    const size_t machine = machine_bytes();
    daemon->memory = (struct skd_memory_limits){
        .total_bytes = total_bytes > 0 ? total_bytes : machine / 4 * 3,
        .session_bytes = session_bytes > 0 ? session_bytes : machine / 2,
    };
}

size_t skd_memory_used(const struct skd_daemon *daemon)
{
    const struct skd_live *live, *next;
    size_t bytes = 0;
    HASH_ITER(hh, daemon->sessions, live, next)
    {
        bytes += live->session != NULL ? skd_session_bytes(live->session) : live->promised_bytes;
    }
    return bytes;
}

/* Sizes are told in MiB, rounded so that the larger one never looks like the smaller. */
static unsigned long long mib_up(size_t bytes)
{
    return (unsigned long long)(bytes >> 20) + ((bytes & ((1 << 20) - 1)) != 0);
}

enum skd_status skd_memory_check_session(const struct skd_daemon *daemon, size_t bytes,
                                         struct skd_error *error)
{
    const size_t most = daemon->memory.session_bytes;
    if (bytes <= most)
        return SKD_OK;
    return skd_fail(error, SKD_TOO_LARGE,
                    "the session would take %llu MiB of memory, and %llu MiB is the limit of one; "
                    "keep less history, or start skind with a larger --session-memory",
                    mib_up(bytes), (unsigned long long)(most >> 20));
}

enum skd_status skd_memory_check(const struct skd_daemon *daemon, const struct skd_session *session,
                                 size_t more, struct skd_error *error)
{
    const size_t used = skd_memory_used(daemon), most = daemon->memory.total_bytes;
    const size_t own = session != NULL ? skd_session_bytes(session) : 0;
    const enum skd_status status = skd_memory_check_session(daemon, own + more, error);
    if (status != SKD_OK || more == 0 || used + more <= most)
        return status;
    return skd_fail(error, SKD_TOO_LARGE,
                    "all sessions would take %llu MiB of memory, and %llu MiB is the limit; close "
                    "one, or start skind with a larger --memory",
                    mib_up(used + more), (unsigned long long)(most >> 20));
}

enum skd_status skd_memory_check_step(const struct skd_daemon *daemon,
                                      const struct skd_session *session, size_t count,
                                      struct skd_error *error)
{
    const struct skd_history *history = &session->history;
    const size_t slots = (size_t)session->slot_count;
    /* The most that a row of a step has (skd_step_bytes): weights, bones and rest position, or a
     * pin, before and after. */
    const size_t row_bytes =
        sizeof(uint32_t) + 2 * slots * (sizeof(float) + sizeof(uint16_t)) + 2 * 3 * sizeof(float);
    if (count == 0 || count > session->rig->mesh.vertex_count)
        count = session->rig->mesh.vertex_count;
    const size_t step_bytes = sizeof(struct skd_step) + count * row_bytes;
    size_t after = history->bytes + step_bytes;
    if (after > history->bytes_max)
        after = step_bytes > history->bytes_max ? step_bytes : history->bytes_max;
    return after > history->bytes ? skd_memory_check(daemon, session, after - history->bytes, error)
                                  : SKD_OK;
}

enum skd_status skd_memory_promise(const struct skd_daemon *daemon, struct skd_live *live,
                                   size_t bytes, struct skd_error *error)
{
    live->promised_bytes = 0;
    const enum skd_status status = skd_memory_check(daemon, NULL, bytes, error);
    if (status == SKD_OK)
        live->promised_bytes = bytes;
    return status;
}
