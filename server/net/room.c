/* See room.h. */
#include "net/room.h"

#include <utlist.h>

static bool fits(const struct skd_room *room, size_t bytes)
{
    return bytes <= SKD_ROOM_BYTES - room->used;
}

static void hand_out(struct skd_room *room, struct skd_room_share *share, uint64_t now_ms)
{
    room->used += share->bytes;
    share->fed_ms = now_ms;
    DL_APPEND(room->holders, share);
}

bool skd_room_take(struct skd_room *room, struct skd_room_share *share, size_t bytes,
                   uint64_t now_ms)
{
    share->bytes = bytes;
    /* Behind those that wait, also where it would fit: else a large one could wait for ever. */
    bool taken = room->waiting == NULL && fits(room, bytes);
    if (taken)
        hand_out(room, share, now_ms);
    else
        DL_APPEND(room->waiting, share);
    return taken;
}

static bool is_holder(const struct skd_room *room, const struct skd_room_share *share)
{
    const struct skd_room_share *holder;
    DL_FOREACH(room->holders, holder)
    {
        if (holder == share)
            return true;
    }
    return false;
}

void skd_room_give(struct skd_room *room, struct skd_room_share *share, uint64_t now_ms)
{
    struct skd_room_share *first;
    if (share->bytes == 0)
        return;
    if (is_holder(room, share)) {
        DL_DELETE(room->holders, share);
        room->used -= share->bytes;
    } else {
        DL_DELETE(room->waiting, share);
    }
    share->bytes = 0;
    while ((first = room->waiting) != NULL && fits(room, first->bytes)) {
        DL_DELETE(room->waiting, first);
        hand_out(room, first, now_ms);
        first->granted(first->user);
    }
}

struct skd_room_share *skd_room_stuck(const struct skd_room *room, uint64_t now_ms,
                                      uint64_t still_ms)
{
    struct skd_room_share *holder;
    if (room->waiting == NULL)
        return NULL;
    DL_FOREACH(room->holders, holder)
    {
        if (now_ms - holder->fed_ms >= still_ms)
            return holder;
    }
    return NULL;
}
