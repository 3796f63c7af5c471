/* Who a change is by: what a client said of itself in hello.
 *
 * Thread: any; a value, copied whole.
 */
#ifndef SKD_PROTOCOL_AUTHOR_H
#define SKD_PROTOCOL_AUTHOR_H

#include "protocol/limits.h"

struct skd_author {
    char client[SKD_CLIENT_NAME_BYTES_MAX + 1]; /* the tool, as people call it */
    char user[SKD_USER_BYTES_MAX + 1];          /* the person; "": not said */
    char id[SKD_CLIENT_ID_BYTES_MAX + 1];       /* the tool, as it is told from its like */
};

enum { SKD_AUTHOR_TEXT_BYTES = SKD_CLIENT_NAME_BYTES_MAX + SKD_USER_BYTES_MAX + 4 };

/* "anna (Blender)", or the tool alone where no person was named. Returns text. */
const char *skd_author_text(const struct skd_author *author, char text[SKD_AUTHOR_TEXT_BYTES]);

#endif
