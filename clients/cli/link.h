/* A connection to skind: requests out, answers and notifications in.
 *
 * Stage: the client's end of the wire. Thread: one; every call blocks. Speaks frames.
 */
#ifndef SKD_CLI_LINK_H
#define SKD_CLI_LINK_H

#include "protocol/encode.h"

struct skd_link {
    int fd; /* -1: not connected */
    struct skd_frame_reader reader;
    int64_t last_id;
    long pid;         /* the daemon's, as it said in hello */
    char version[32]; /* likewise */
    char bye[128];    /* why the daemon closes the connection, once it said so */
    /* Called for each notification that comes while an answer is waited for; may be NULL. */
    void (*notify)(void *user, const struct skd_message *message);
    void *user;
};

enum skd_link_state {
    SKD_LINK_UP,     /* connected and greeted */
    SKD_LINK_NOBODY, /* nobody listens there, or not any more */
    SKD_LINK_FAILED, /* somebody does, but refused us; see the error */
};

/* Connects to a socket and says hello. *link is to be closed only when it is up. */
SKD_MUST_CHECK enum skd_link_state skd_link_open(struct skd_link *link, const char *path,
                                                 struct skd_error *error);
void skd_link_close(struct skd_link *link);

/* Sends a request and waits for its answer, which the caller finishes with skd_message_finish, in
 * any case. `body` (may be NULL) is taken over. Errors: the daemon's own (its sentence with its
 * hint in brackets); SKD_SHUTTING_DOWN when the connection ends before the answer. */
SKD_MUST_CHECK enum skd_status skd_link_call(struct skd_link *link, const char *method, cJSON *body,
                                             const struct skd_array_out *arrays, int array_count,
                                             struct skd_message *answer, struct skd_error *error);

/* Waits for the next message of any kind; finish it in any case. */
SKD_MUST_CHECK enum skd_status skd_link_next(struct skd_link *link, struct skd_message *message,
                                             struct skd_error *error);

#endif
