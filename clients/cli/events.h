/* What a session's notifications are on stdout: a sentence each, or a JSON object.
 *
 * Thread: one.
 */
#ifndef SKD_CLI_EVENTS_H
#define SKD_CLI_EVENTS_H

#include "protocol/message.h"

/* Prints one notification. As JSON: {"event": the method, then its params}, with the number of rows
 * in place of each array where they are left out. */
void skd_event_print(const struct skd_message *notification, bool with_arrays);

/* Prints that a session is attached: `result` is what session.attach answered. */
void skd_event_print_attached(const cJSON *result);

/* Prints the digest of all weights at a revision. */
void skd_event_print_digest(const char *session, const char *instance, double revision,
                            const char *digest);

#endif
