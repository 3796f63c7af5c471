/* Memory for large messages that are coming in, shared by all connections.
 *
 * Stage: bytes in -> frame. Thread: the loop.
 * A message of up to SKD_ROOM_FREE_BYTES needs no room. A larger one takes a share before a byte of
 * it is read, or waits, first come, first served. Owns nothing: a share is part of a connection.
 */
#ifndef SKD_NET_ROOM_H
#define SKD_NET_ROOM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SKD_ROOM_BYTES ((size_t)1 << 30) /* more than the largest message, so each has its day */
#define SKD_ROOM_FREE_BYTES ((size_t)1 << 20)

struct skd_room_share {
    struct skd_room_share *prev, *next; /* in one of the room's lists */
    size_t bytes;                       /* 0: in neither */
    uint64_t fed_ms;                    /* holders: when bytes of the message came last */
    void *user;
    void (*granted)(void *user); /* after a wait */
};

struct skd_room {
    size_t used;
    struct skd_room_share *holders;
    struct skd_room_share *waiting; /* oldest first */
};

/* True: the share is taken. False: it waits, and granted() comes later. */
bool skd_room_take(struct skd_room *room, struct skd_room_share *share, size_t bytes,
                   uint64_t now_ms);

/* Gives a share back, or stops waiting for it; nothing when there is none. */
void skd_room_give(struct skd_room *room, struct skd_room_share *share, uint64_t now_ms);

/* A holder whose message has stood still for that long while others wait, or NULL. */
struct skd_room_share *skd_room_stuck(const struct skd_room *room, uint64_t now_ms,
                                      uint64_t still_ms);

#endif
