/* What the loop owns and the handlers work on: connections, open sessions, calls.
 *
 * Stage: all from the request to the reply. Thread: the loop. Workers see only what a call lends
 * them.
 */
#ifndef SKD_REQUESTS_STATE_H
#define SKD_REQUESTS_STATE_H

#include "import/import.h"
#include "journal/journal.h"
#include "net/connection.h"
#include "protocol/request.h"
#include "requests/changes.h"
#include "requests/state_folder.h"
#include "session/session.h"

#include <stdatomic.h>

struct skd_call;
struct skd_claim;

/* A connection that hears of a session's changes: present there, and perhaps with a claim. */
struct skd_listener_of_session {
    uint64_t connection_id;
    UT_hash_handle hh;
    uint64_t told;             /* the revision it has once it has read all that was sent to it */
    uint64_t making;           /* the update for it that a worker makes (its number), or 0 */
    int64_t since_s;           /* unix time */
    uint64_t presence_told;    /* which of live->presence_changes it knows */
    struct skd_claim *claim;   /* NULL: nothing */
    uint64_t claim_change;     /* which of live->claim_changes was the last of its own */
    uint64_t claim_asked;      /* so that of two requests at once the later one holds */
    uint64_t claims_told;      /* which of live->claim_changes it knows */
    uint64_t claims_at_attach; /* those up to here were none of its business */
};

/* What becomes of the file of a session that is closed. */
enum skd_keeping_end {
    SKD_KEEPING_STAYS,   /* the daemon stops: the session is there at its next start */
    SKD_KEEPING_CLOSED,  /* among the closed ones, if it has a step */
    SKD_KEEPING_REMOVED, /* deleted */
};

/* A rig session that is open in this daemon, and who takes turns on it. */
struct skd_live {
    struct skd_daemon *daemon;
    char name[SKD_SESSION_NAME_BYTES_MAX + 1];
    UT_hash_handle hh;
    struct skd_session *session; /* NULL while it is being loaded */
    size_t promised_bytes;       /* that it will take; counted until it is there */
    /* The session's file; NULL where it has none, and while it is away (requests/keeping.h). */
    struct skd_journal_file *journal;
    char file[SKD_STATE_FILE_BYTES]; /* its name in the state folder; "": none */
    uint64_t file_bytes;             /* that it had when it was last written whole, about */
    bool away;                       /* closed for a moment, to be verified or written anew */
    enum skd_keeping_end end;        /* what is to become of it then, once the session is closed */
    bool suspended;                  /* it could not be written */
    bool renews;                     /* gets a new instance before its next turn */
    bool rewriting;                  /* it is being written anew, or will be in the next turn */
    bool poses_changed;              /* while the file was away */
    struct skd_call *closer;         /* prepared; answered when the file is where it is to be */
    bool closed;                     /* goes when nobody holds it any more */
    int holds;                       /* calls that wait for the disk, work in the pool */
    struct skd_call *running;        /* the call whose turn it is */
    struct skd_call *waiting;        /* list */
    struct skd_call *awaiting;       /* list: done, and to be answered when it is durable */
    bool serving;                    /* requests/live.c is handing the turn out */
    struct skd_changes changes;
    uint64_t durable_revision; /* up to which others may hear of changes */
    uint64_t settled_revision; /* up to which it was looked who knows them by their own answer */
    struct skd_listener_of_session *listeners; /* by connection_id, in the order they came */
    uint64_t presence_changes;                 /* counted: somebody came, went or claimed */
    uint64_t presence_due;  /* up to which of them listeners are to be told now */
    uint64_t claim_changes; /* counted */
    size_t claim_bytes;     /* that all claims take */
};

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
    struct skd_author author;
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

struct skd_stats {
    uint64_t requests[SKD_REQUEST_METHOD_COUNT];
    uint64_t vertices_solved;
    uint64_t solve_ns;
};

/* Where sessions are kept; requests/keeping.c's. */
struct skd_keeping {
    char folder[SKD_STATE_PATH_BYTES];
    int lock;
    struct skd_journal *journal;
    uv_timer_t retry; /* for sessions that are suspended; requests/rewriting.c's */
    cJSON *unopened;  /* files that no session was made of at the start: [{file, text}], or NULL */
};

/* What sessions may take; see requests/memory.h. */
struct skd_memory_limits {
    size_t total_bytes;
    size_t session_bytes;
};

struct skd_daemon {
    struct skd_memory_limits memory;
    struct skd_importer importer;
    struct skd_keeping keeping;
    uv_loop_t *loop;
    int worker_count;
    uint64_t started_ns;
    struct skd_connection *connections; /* by id */
    struct skd_live *sessions;          /* by name */
    struct skd_call *calls;             /* all that are not answered yet */
    uv_timer_t *presence;               /* requests/presence.c's; NULL: nothing to be told */
    uint64_t updates_made;              /* numbers of requests/updates.c */
    struct skd_stats stats;
    bool stopping;
    /* Begins to stop; daemon.c's. */
    void (*stop)(struct skd_daemon *daemon, const char *reason);
};

#endif
