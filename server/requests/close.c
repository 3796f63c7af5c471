/* See close.h. */
#include "requests/close.h"

#include "requests/call.h"
#include "requests/keeping.h"
#include "requests/live.h"
#include "requests/updates.h"

void skd_session_close(struct skd_daemon *daemon, struct skd_live *live, enum skd_keeping_end end,
                       const char *reason)
{
    skd_live_retire(daemon, live);
    skd_updates_closed(daemon, live, reason);
    /* Cancelling may end other calls as well, so the list is looked at anew each time. */
    while (live->waiting != NULL)
        skd_call_cancel(live->waiting, SKD_NO_SESSION);
    if (live->running != NULL)
        skd_call_cancel(live->running, SKD_NO_SESSION);
    skd_keeping_end(daemon, live, end);
    skd_live_dismiss(live);
}
