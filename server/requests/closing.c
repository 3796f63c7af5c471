/* session.close: the session ends, and its file goes among the closed ones.
 *
 * Stage: job -> reply. Thread: the loop. What the disk did not take so far has to be written first,
 * so that nobody loses work by closing; answered when the file is where it is to be.
 */
#include "requests/handlers.h"

#include "requests/close.h"
#include "requests/rewriting.h"

#include <stdlib.h>

static void close_now(struct skd_call *call, struct skd_live *live)
{
    if (!skd_call_prepare(call, cJSON_CreateObject()))
        return;
    live->closer = call;
    skd_session_close(call->daemon, live, SKD_KEEPING_CLOSED, "a client closed it");
}

static void written(struct skd_call *call)
{
    struct skd_error error;
    if (call->status == SKD_OK) {
        close_now(call, call->live);
        return;
    }
    (void)skd_fail(&error, SKD_FILE_IO,
                   "session \"%s\" stays open, because it is not on the disk: %s; make room and "
                   "close it again, or delete it",
                   call->live->name, call->error.text);
    skd_call_fail(call, &error);
}

static void begin(struct skd_call *call)
{
    if (call->live->suspended)
        skd_rewriting_run(call, written);
    else
        close_now(call, call->live);
}

static void dismiss(struct skd_call *call)
{
    skd_rewriting_finish(call->state);
    free(call->state);
}

void skd_handle_session_close(struct skd_call *call)
{
    struct skd_live *live = skd_call_find_session(call, call->request.params.session.session);
    struct skd_error error;
    if (live == NULL)
        return;
    if (!live->suspended) {
        close_now(call, live);
        return;
    }
    call->state = calloc(1, sizeof(struct skd_rewriting));
    if (call->state == NULL) {
        (void)skd_fail_memory(&error, "a request");
        skd_call_fail(call, &error);
        return;
    }
    call->dismiss = dismiss;
    skd_call_take_turn(call, live, begin);
}
