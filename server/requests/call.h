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

#include <stdatomic.h>

/* What a worker made for the answer: the body and the arrays that go with it. */
struct skd_reply {
    cJSON *body;
    struct skd_array_out arrays[SKD_ARRAYS_MAX];
    int array_count;
    void (*release)(void *owner); /* of the arrays' memory, may be NULL */
    void *owner;
};

struct skd_call {
    struct skd_daemon *daemon;
    struct skd_call *prev, *next;           /* in daemon->calls */
    struct skd_call *turn_prev, *turn_next; /* in live->waiting */
    bool queued;                            /* it is there */
    struct skd_live *live;                  /* whose turn it waits for or has, or NULL */
    uint64_t connection_id;
    enum skd_wire_mode mode;
    char client[SKD_CLIENT_NAME_BYTES_MAX + 1];
    char client_id[SKD_CLIENT_ID_BYTES_MAX + 1];
    struct skd_request request;
    uint64_t arrived_ns;
    atomic_bool cancelled; /* set by the loop, looked at by whoever can still stop */
    enum skd_status why;   /* of the cancelling: SKD_CANCELLED, SKD_SHUTTING_DOWN, SKD_NO_SESSION */
    void (*begin)(struct skd_call *call);
    /* One piece of work at a time. */
    uv_work_t work;
    enum skd_status (*run)(struct skd_call *call, struct skd_error *error);
    void (*apply)(struct skd_call *call); /* NULL, or what changes the session: cannot fail */
    void (*done)(struct skd_call *call);
    enum skd_status status;
    struct skd_error error;
    struct skd_reply reply;
    struct skd_encoded encoded; /* the reply as bytes */
    char *answer;      /* the reply's body as text, where it is to be remembered (a sequence) */
    uint64_t revision; /* that it made; or that it read, and that is not durable yet */
    void *state;       /* a handler's own */
    void (*dismiss)(struct skd_call *call); /* frees the state, however the call ends; or NULL */
};

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

/* Stops a call as soon as it can be: one that waits for its turn at once. */
void skd_call_cancel(struct skd_call *call, enum skd_status why);

/* Fills *error with the sentence for a cancelled call. */
void skd_call_cancelled(const struct skd_call *call, struct skd_error *error);

/* The call's connection, or NULL when it is gone. */
struct skd_connection *skd_call_connection(const struct skd_call *call);

/* Sends an encoded message (taken over) to the call's connection; release(owner) when written. */
void skd_call_send(struct skd_call *call, struct skd_encoded *encoded, void (*release)(void *owner),
                   void *owner);

#endif
