/* See outgoing.h. */
#include "net/outgoing.h"

#include <stdlib.h>

struct skd_outgoing *skd_outgoing_create(struct skd_encoded *encoded, void (*release)(void *owner),
                                         void *owner)
{
    struct skd_outgoing *outgoing = malloc(sizeof *outgoing);
    if (outgoing == NULL) {
        skd_encoded_finish(encoded);
        if (release != NULL)
            release(owner);
        return NULL;
    }
    *outgoing = (struct skd_outgoing){1, *encoded, release, owner};
    *encoded = (struct skd_encoded){0};
    return outgoing;
}

struct skd_outgoing *skd_outgoing_hold(struct skd_outgoing *outgoing)
{
    outgoing->references++;
    return outgoing;
}

void skd_outgoing_release(struct skd_outgoing *outgoing)
{
    if (outgoing == NULL || --outgoing->references > 0)
        return;
    skd_encoded_finish(&outgoing->encoded);
    if (outgoing->release != NULL)
        outgoing->release(outgoing->owner);
    free(outgoing);
}
