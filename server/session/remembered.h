/* Answers to give again: what a client's last numbered requests were answered, so that one that
 * comes a second time, because its answer was lost, is not done a second time.
 *
 *     client "blender-3f2a"   [ 17: {...} | 18: {...} | 20: {...} ]   its last 64 changes
 *     client "replay-77"      [ 1: {...} ]                            the 64 who spoke last
 *
 * Stage: commit. Thread: the loop (a worker reads and fills it while it has the session for
 * itself). A request that failed changed nothing, and is not here: it may come again and be done.
 */
#ifndef SKD_SESSION_REMEMBERED_H
#define SKD_SESSION_REMEMBERED_H

#include "base/error.h"
#include "base/hash.h"
#include "protocol/limits.h"

#include <stdint.h>

struct skd_remembered_answer {
    uint64_t sequence;
    uint64_t revision;
    char *text; /* JSON, without arrays; owned */
};

struct skd_remembered_client {
    char id[SKD_CLIENT_ID_BYTES_MAX + 1];
    UT_hash_handle hh;
    uint64_t forgotten; /* the highest of those that had to go */
    size_t count;
    struct skd_remembered_answer answers[SKD_REMEMBERED_ANSWERS_MAX]; /* rising sequences */
};

struct skd_remembered {
    struct skd_remembered_client *clients; /* who spoke last is last */
    size_t bytes;
};

enum skd_remembered_kind {
    SKD_SEQUENCE_NEW,
    SKD_SEQUENCE_REPEATED, /* *text is the answer, borrowed */
    SKD_SEQUENCE_STALE,    /* so old that nobody knows any more */
};

enum skd_remembered_kind skd_remembered_find(const struct skd_remembered *remembered,
                                             const char *client_id, uint64_t sequence,
                                             const char **text);

/* Makes sure that the client's next answer can be put without asking for memory; the client counts
 * as the one who spoke last. Errors: SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_remembered_reserve(struct skd_remembered *remembered,
                                                      const char *client_id,
                                                      struct skd_error *error);

/* Remembers an answer (taken over) of the client that was reserved last. What is beyond the limits
 * goes, the oldest first. */
void skd_remembered_put(struct skd_remembered *remembered, const char *client_id, uint64_t sequence,
                        uint64_t revision, char *answer);

/* Both, with a copy of the answer. Errors: SKD_NO_MEMORY, and then it is not remembered. */
SKD_MUST_CHECK enum skd_status skd_remembered_add(struct skd_remembered *remembered,
                                                  const char *client_id, uint64_t sequence,
                                                  uint64_t revision, const char *answer,
                                                  struct skd_error *error);

/* Visits all answers in an order in which adding them makes the same memory again, until visit
 * returns false. */
void skd_remembered_each(const struct skd_remembered *remembered,
                         bool (*visit)(void *user, const char *client_id, uint64_t sequence,
                                       uint64_t revision, const char *answer),
                         void *user);

void skd_remembered_finish(struct skd_remembered *remembered);

#endif
