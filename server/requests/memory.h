/* How much memory sessions may take: one of them, and all together.
 *
 * Stage: request -> rig session. Thread: the loop, where nothing else is said.
 * Asked before memory is taken, with what will stay: the rig, the weights, poses and the undo
 * history. What a call needs while it runs is not counted. Sessions that were kept are opened at
 * the start whatever they take.
 */
#ifndef SKD_REQUESTS_MEMORY_H
#define SKD_REQUESTS_MEMORY_H

#include "requests/state.h"

/* The limits in bytes; 0: three quarters of the machine's memory for all, half for one. */
void skd_memory_set_limits(struct skd_daemon *daemon, size_t total_bytes, size_t session_bytes);

/* Whether the session (NULL: a new one) may grow by `more` bytes. Errors: SKD_TOO_LARGE. */
SKD_MUST_CHECK enum skd_status skd_memory_check(const struct skd_daemon *daemon,
                                                const struct skd_session *session, size_t more,
                                                struct skd_error *error);

/* The same for a step of up to `count` vertices (0: all), the older steps that it pushes out of the
 * history taken off. */
SKD_MUST_CHECK enum skd_status skd_memory_check_step(const struct skd_daemon *daemon,
                                                     const struct skd_session *session,
                                                     size_t count, struct skd_error *error);

/* Whether one session may have so many bytes; any thread. Errors: SKD_TOO_LARGE. */
SKD_MUST_CHECK enum skd_status skd_memory_check_session(const struct skd_daemon *daemon,
                                                        size_t bytes, struct skd_error *error);

/* For a session that is being loaded: checks its bytes, and counts them until it is there. */
SKD_MUST_CHECK enum skd_status skd_memory_promise(const struct skd_daemon *daemon,
                                                  struct skd_live *live, size_t bytes,
                                                  struct skd_error *error);

/* Bytes that all sessions take, those that are being loaded included. */
size_t skd_memory_used(const struct skd_daemon *daemon);

#endif
