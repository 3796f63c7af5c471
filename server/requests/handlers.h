/* One handler a method; requests/router.c finds it. Each is called on the loop thread with a call
 * whose parameters are read and checked in form, and ends it (call.h). */
#ifndef SKD_REQUESTS_HANDLERS_H
#define SKD_REQUESTS_HANDLERS_H

#include "requests/call.h"

/* greeting.c */
void skd_handle_hello(struct skd_call *call);
void skd_handle_ping(struct skd_call *call);
void skd_handle_cancel(struct skd_call *call);
void skd_handle_stats(struct skd_call *call);
void skd_handle_shutdown(struct skd_call *call);
/* create.c */
void skd_handle_session_create(struct skd_call *call);
/* sessions.c */
void skd_handle_session_list(struct skd_call *call);
void skd_handle_session_info(struct skd_call *call);
void skd_handle_session_attach(struct skd_call *call);
void skd_handle_session_detach(struct skd_call *call);
void skd_handle_session_close(struct skd_call *call);
/* kept.c */
void skd_handle_session_claim(struct skd_call *call);
void skd_handle_session_set(struct skd_call *call);
void skd_handle_session_save(struct skd_call *call);
void skd_handle_session_open(struct skd_call *call);
void skd_handle_session_fork(struct skd_call *call);
void skd_handle_session_delete(struct skd_call *call);
void skd_handle_session_verify(struct skd_call *call);
/* poses.c */
void skd_handle_pose_set(struct skd_call *call);
void skd_handle_pose_evaluate(struct skd_call *call);
/* stroke.c */
void skd_handle_stroke_apply(struct skd_call *call);
void skd_handle_pins_solve(struct skd_call *call);
void skd_handle_session_refit(struct skd_call *call);
/* layers.c */
void skd_handle_pins_list(struct skd_call *call);
void skd_handle_pins_get(struct skd_call *call);
void skd_handle_shapes_list(struct skd_call *call);
void skd_handle_shapes_get(struct skd_call *call);
/* guarding.c */
void skd_handle_guard_set(struct skd_call *call);
void skd_handle_guard_get(struct skd_call *call);
/* edits.c */
void skd_handle_weights_set(struct skd_call *call);
void skd_handle_pins_weigh(struct skd_call *call);
void skd_handle_pins_clear(struct skd_call *call);
void skd_handle_weights_mirror(struct skd_call *call);
void skd_handle_weights_prune(struct skd_call *call);
void skd_handle_weights_reduce(struct skd_call *call);
/* reading.c */
void skd_handle_weights_get(struct skd_call *call);
void skd_handle_mesh_get(struct skd_call *call);
void skd_handle_session_export(struct skd_call *call);
/* history.c */
void skd_handle_history_undo(struct skd_call *call);
void skd_handle_history_redo(struct skd_call *call);

/* router.c: a frame came in. Parses it (a large one in a worker), answers what cannot be read,
 * and hands the rest to its handler. */
void skd_route_frame(struct skd_daemon *daemon, struct skd_connection *connection,
                     struct skd_frame *frame);

/* router.c: answers a request without a call of its own (it could not be read, or there is no
 * memory for one). */
void skd_route_refuse(struct skd_connection *connection, const struct skd_request_id *id,
                      const struct skd_error *failure);

#endif
