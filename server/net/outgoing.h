/* A message on its way out, shared by all the connections that it goes to.
 *
 * Stage: reply -> bytes out. Thread: the loop (a worker may fill `encoded` before the loop has it).
 * The arrays of the message are borrowed from `owner`, which is let go of when the last byte is
 * written or the last connection is gone.
 */
#ifndef SKD_NET_OUTGOING_H
#define SKD_NET_OUTGOING_H

#include "protocol/encode.h"

struct skd_outgoing {
    int references;
    struct skd_encoded encoded;   /* owned */
    void (*release)(void *owner); /* may be NULL */
    void *owner;
};

/* Takes over *encoded (also on failure) and the owner: release(owner) is called once, at the end,
 * or at once when there is no memory (NULL). One reference is the caller's. */
struct skd_outgoing *skd_outgoing_create(struct skd_encoded *encoded, void (*release)(void *owner),
                                         void *owner);
struct skd_outgoing *skd_outgoing_hold(struct skd_outgoing *outgoing);
void skd_outgoing_release(struct skd_outgoing *outgoing); /* NULL is fine */

#endif
