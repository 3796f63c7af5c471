/* See author.h. */
#include "protocol/author.h"

#include <stdio.h>

const char *skd_author_text(const struct skd_author *author, char text[SKD_AUTHOR_TEXT_BYTES])
{
    const char *client = author->client[0] != '\0' ? author->client : "another tool";
    if (author->user[0] != '\0')
        (void)snprintf(text, SKD_AUTHOR_TEXT_BYTES, "%s (%s)", author->user, client);
    else
        (void)snprintf(text, SKD_AUTHOR_TEXT_BYTES, "%s", client);
    return text;
}
