/* A call: one request from its arrival to its answer.
 *
 * Stage: request -> job -> reply. Thread: the loop, but for the function that skd_call_work gives
 * to a worker. A call ends exactly once, in skd_call_answer, skd_call_finish or skd_call_fail,
 * which send the answer, pass the session's turn on and free the call.
 *
 *     handler(call) --answer at once---------------------------------> skd_call_answer
 *           |
 *           +-- skd_call_take_turn(call, live, begin) -- begin(call) --+
 *                                                                      |
 *           +----------------------------------------------------------+
 *           +-- skd_call_work(call, run, done) == worker: run ==> done(call) -> skd_call_finish
 */
#ifndef SKD_REQUESTS_CALL_H
#define SKD_REQUESTS_CALL_H

#include "requests/state.h"

/* Turns a decoded request (taken over) into a call. NULL: no memory. */
struct skd_call *skd_call_create(struct skd_daemon *daemon, struct skd_connection *connection,
                                 struct skd_request *request);

/* A call that nobody sent and nobody hears of: the daemon's own work on a session, in its turn.
 * NULL: no memory. */
struct skd_call *skd_call_create_own(struct skd_daemon *daemon);

/* Finds the session by name or answers with an error and returns NULL; then the call is gone. */
struct skd_live *skd_call_find_session(struct skd_call *call, const char *name);

/* begin(call) is called when no other call has the session: at once or later. */
void skd_call_take_turn(struct skd_call *call, struct skd_live *live,
                        void (*begin)(struct skd_call *call));

/* run(call, &call->error) in a worker; its reply is encoded there too, and when both went well
 * call->apply(call), so that nothing is changed by a call that fails. Then done(call) here, with
 * call->status; NULL stands for skd_call_finish. */
void skd_call_work(struct skd_call *call,
                   enum skd_status (*run)(struct skd_call *call, struct skd_error *error),
                   void (*done)(struct skd_call *call));

/* Lets the next call have the session, while this one goes on without it. */
void skd_call_pass_turn(struct skd_call *call);

/* Ends the call: a small answer made here (body is taken over); the reply that a worker encoded,
 * or its error; an error. */
void skd_call_answer(struct skd_call *call, cJSON *body);
void skd_call_finish(struct skd_call *call);
void skd_call_fail(struct skd_call *call, const struct skd_error *error);

/* For what cannot be taken back: the answer is encoded before it is done. False: the call has
 * failed and is gone. Then it ends with skd_call_answer_prepared, or failing after all. */
bool skd_call_prepare(struct skd_call *call, cJSON *body);
void skd_call_answer_prepared(struct skd_call *call);

/* Stops a call as soon as it can be: one that waits for its turn at once. */
void skd_call_cancel(struct skd_call *call, enum skd_status why);

/* Fills *error with the sentence for a cancelled call. */
void skd_call_cancelled(const struct skd_call *call, struct skd_error *error);

/* Ends the calls that read a revision which has become durable now. */
void skd_call_end_awaiting(struct skd_live *live);

/* The call's connection, or NULL when it is gone. */
struct skd_connection *skd_call_connection(const struct skd_call *call);

/* Sends an encoded message (taken over) to the call's connection; release(owner) when written. */
void skd_call_send(struct skd_call *call, struct skd_encoded *encoded, void (*release)(void *owner),
                   void *owner);

#endif
