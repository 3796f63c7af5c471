/* What the attached connections of a session hear: every change, in order, and no stale one.
 *
 *     committed ──> changes ──> durable ──> one message at a time to each listener
 *                   (ring)                  [told + 1 .. revision], the newest value of each vertex
 *
 * Stage: reply. Thread: the loop; what has to be merged or spelled out is made by a worker.
 *
 * A listener that reads as fast as changes come gets each by itself, straight from its step. To one
 * that does not, nothing is sent while anything waits in its connection, so that it costs no memory
 * but the queue's; then changes that can be told together are. Where more is missing than the ring
 * holds, or than it is worth, the message says `resync`.
 *
 * `told` is what a listener has when it has read what was sent. Whose stroke it was has its weights
 * from stroke.weights and needs no update, but only if it has all before that: otherwise an update
 * tells it the stroke together with the rest. So the rule for a tool is: the answer of a stroke
 * counts if its revision is one more than what the tool has, else an update that covers it comes.
 */
#ifndef SKD_REQUESTS_UPDATES_H
#define SKD_REQUESTS_UPDATES_H

#include "requests/state.h"

/* The arrays that tell items [first, first + count) of a step: vertices and weights; joints, rest
 * and offsets where the step may change them. Returns how many. */
enum { SKD_STEP_ARRAYS = 5 };
int skd_step_arrays(const struct skd_step *step, bool undo, size_t first, size_t count,
                    struct skd_array_out arrays[SKD_STEP_ARRAYS]);

/* Tells what may be told by now: when live->durable_revision rose, and before the answer of the
 * change that it rose for. */
void skd_updates_flush(struct skd_daemon *daemon, struct skd_live *live);

/* The connection has written all that waited, and is ready for more. */
void skd_updates_drained(struct skd_daemon *daemon, const struct skd_connection *connection);

/* Begins to tell a listener what came after a revision that it has. False: that cannot be told any
 * more, and it is only told what comes from now on. */
bool skd_updates_follow(struct skd_live *live, struct skd_listener_of_session *listener,
                        bool has_revision, uint64_t revision);

/* Tells the listeners that the session is gone. */
void skd_updates_closed(struct skd_daemon *daemon, struct skd_live *live, const char *reason);

#endif
