/* What the attached connections of a session hear.
 *
 * Stage: reply. Thread: the loop; skd_update_encode also a worker, for connections that speak
 * lines, because spelling out a million numbers takes long.
 */
#ifndef SKD_REQUESTS_UPDATES_H
#define SKD_REQUESTS_UPDATES_H

#include "requests/state.h"

/* One committed change. The step is borrowed. */
struct skd_update {
    const char *session;
    uint64_t revision;
    const char *cause;  /* "stroke", "set", "undo", "redo", ... */
    const char *client; /* who asked */
    struct skd_step *step;
    bool undo;  /* the step's `before` is what holds now */
    bool brief; /* say `resync` and leave the arrays out */
};

/* The arrays that tell items [first, first + count) of a step: vertices and weights; joints, rest
 * and offsets where the step may change them. Returns how many. */
enum { SKD_STEP_ARRAYS = 5 };
int skd_step_arrays(const struct skd_step *step, bool undo, size_t first, size_t count,
                    struct skd_array_out arrays[SKD_STEP_ARRAYS]);

/* A line names no more than 16,384 vertices: beyond that it says `resync` and leaves them out. */
SKD_MUST_CHECK enum skd_status skd_update_encode(enum skd_wire_mode mode,
                                                 const struct skd_update *update,
                                                 struct skd_encoded *encoded,
                                                 struct skd_error *error);

/* True when a listener other than `but` speaks lines, so that a worker should encode one. */
bool skd_updates_want_line(const struct skd_daemon *daemon, const struct skd_live *live,
                           uint64_t but);

/* Sends the change to every listener but one (0: to all). *line, where its head is not NULL, is the
 * update as a line; it is taken over. Whoever came to speak lines too late for one is told to
 * `resync`. A listener with more than 64 MiB unread is dropped. */
void skd_updates_send(struct skd_daemon *daemon, struct skd_live *live,
                      const struct skd_update *update, uint64_t but, struct skd_encoded *line);

/* Tells the listeners that the session is gone. */
void skd_updates_closed(struct skd_daemon *daemon, struct skd_live *live, const char *reason);

#endif
