/* What a tool knows of a session by its messages alone: which revision, and, if it holds them, all
 * weights, which are fetched once and then changed by each update.
 *
 * Thread: one. Follows the rule of protocol/PROTOCOL.md (Revisions).
 */
#ifndef SKD_CLI_FOLLOWER_H
#define SKD_CLI_FOLLOWER_H

#include "clients/cli/link.h"

enum { SKD_DIGEST_BYTES = 33 }; /* 32 hexadecimal digits and a NUL */

struct skd_follower {
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    char instance[32];
    double revision; /* that it has; below 0: nothing yet */
    bool holds_weights;
    bool is_whole; /* its weights are those of the revision */
    size_t vertex_count;
    size_t slots;
    uint16_t *joints; /* [V][slots] */
    float *weights;   /* [V][slots] */
};

/* Attaches with what it has; what is missing comes as updates, or is to be fetched. Finish *answer
 * in any case. */
SKD_MUST_CHECK enum skd_status skd_follower_attach(struct skd_follower *follower,
                                                   struct skd_link *link,
                                                   struct skd_message *answer,
                                                   struct skd_error *error);

/* Fetches the weights, if it holds them and has not got them whole. Errors: the daemon's;
 * SKD_NO_MEMORY; SKD_INTERNAL when it sends arrays of other sizes. */
SKD_MUST_CHECK enum skd_status skd_follower_fetch(struct skd_follower *follower,
                                                  struct skd_link *link, struct skd_error *error);

/* Whether a session.update tells it anything new; if so, it is to be taken in. Errors: as above. */
bool skd_follower_is_behind(const struct skd_follower *follower, const struct skd_message *update);
SKD_MUST_CHECK enum skd_status skd_follower_take(struct skd_follower *follower,
                                                 struct skd_link *link,
                                                 const struct skd_message *update,
                                                 struct skd_error *error);

/* XXH3 of the weights (128 bits), seeded with that of the joints (64 bits), as they are held. */
void skd_follower_digest(const struct skd_follower *follower, char digest[SKD_DIGEST_BYTES]);

void skd_follower_finish(struct skd_follower *follower);

#endif
