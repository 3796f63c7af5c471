/* A connection to skind: requests out, answers and notifications in.
 *
 * Stage: the client's end of the wire. Thread: one; every call blocks. Speaks frames.
 *
 * An address is the path of a socket, or "tcp:PORT" for a port of this machine, where the daemon
 * asks for its token: $SKIND_TOKEN, else what stands beside the user's own socket.
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
    bool has_ended;   /* nothing more comes */
    int patience_s;   /* how long a read may still wait; 0: for ever */
    /* Called for each notification that comes while an answer is waited for; may be NULL. */
    void (*notify)(void *user, const struct skd_message *message);
    void *user;
};

enum skd_link_state {
    SKD_LINK_UP,     /* connected and greeted */
    SKD_LINK_NOBODY, /* nobody listens there, or not any more */
    SKD_LINK_FAILED, /* somebody does, but refused us; see the error */
};

/* "tcp:PORT", and nothing else. */
bool skd_address_is_port(const char *address);

/* A TCP daemon's token and port, from the file beside its socket. Errors: SKD_NO_FILE when there is
 * none, SKD_BAD_TOKEN when it holds something else. */
SKD_MUST_CHECK enum skd_status skd_token_read(const char *socket_path,
                                              char token[SKD_TOKEN_DIGITS + 1], int *port,
                                              struct skd_error *error);

/* Connects to an address and says hello, which a daemon that still reads its sessions answers when
 * it has them: a minute at most, and after two seconds that is told. It is said with a name that is
 * the same for all that is run in this terminal: $SKIND_CLIENT, else one made of the terminal
 * session's number. *link is to be closed only when it is up. */
SKD_MUST_CHECK enum skd_link_state skd_link_open(struct skd_link *link, const char *address,
                                                 struct skd_error *error);
void skd_link_close(struct skd_link *link);

/* Sends a request and waits for its answer, which the caller finishes with skd_message_finish, in
 * any case. `body` (may be NULL) is taken over. Errors: the daemon's own (its sentence with its
 * hint in brackets); SKD_SHUTTING_DOWN when the connection ends before the answer. */
SKD_MUST_CHECK enum skd_status skd_link_call(struct skd_link *link, const char *method, cJSON *body,
                                             const struct skd_array_out *arrays, int array_count,
                                             struct skd_message *answer, struct skd_error *error);

/* Whether the connection was cut off, by a daemon that did not say goodbye. */
bool skd_link_is_lost(const struct skd_link *link);

/* Waits for the next message of any kind; finish it in any case. */
SKD_MUST_CHECK enum skd_status skd_link_next(struct skd_link *link, struct skd_message *message,
                                             struct skd_error *error);

#endif
