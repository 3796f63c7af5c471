/* See events.h. */
#include "clients/cli/events.h"

#include "clients/cli/cli.h"
#include "clients/cli/print.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NAMES_SHOWN = 8 }; /* of a claim's bones */

/* Rows of an array of a message, which may be a buffer or written out; 0: none is there. */
static size_t count_rows(const struct skd_message *message, const cJSON *array)
{
    const cJSON *index = cJSON_GetObjectItemCaseSensitive(array, "buffer");
    if (cJSON_IsArray(array))
        return (size_t)cJSON_GetArraySize(array);
    if (!cJSON_IsNumber(index) || index->valueint < 0 || index->valueint >= message->buffer_count)
        return 0;
    const struct skd_buffer *buffer = &message->buffers[index->valueint];
    return buffer->dimensions > 0 ? (size_t)buffer->shape[0] : 0;
}

/* The members of session.update and session.claims that are arrays of numbers. */
static bool is_array(const cJSON *member)
{
    static const char *const names[] = {"vertices", "weights", "joints", "rest", "offsets"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        if (strcmp(member->string, names[i]) == 0)
            return true;
    }
    return false;
}

static cJSON *begin_event(const char *event)
{
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "event", event);
    return json;
}

static void print_as_json(const struct skd_message *message, bool with_arrays)
{
    cJSON *json = begin_event(message->method);
    const cJSON *member;
    cJSON_ArrayForEach(member, message->params)
    {
        if (with_arrays || !is_array(member))
            cJSON_AddItemToObject(json, member->string, cJSON_Duplicate(member, true));
        else
            cJSON_AddNumberToObject(json, member->string, (double)count_rows(message, member));
    }
    skd_print_json(message, json);
    cJSON_Delete(json);
}

/* "stroke by blender", for a whole update or one of its changes. */
static void print_change(const cJSON *change)
{
    char client[SKD_AUTHOR_TEXT_BYTES];
    printf("%s by %s", skd_json_text(change, "cause"), skd_person_text(change, client));
}

static void print_update(const struct skd_message *update)
{
    const cJSON *params = update->params, *change;
    const cJSON *changes = cJSON_GetObjectItemCaseSensitive(params, "changes");
    double since = skd_json_number(params, "since"), revision = skd_json_number(params, "revision");
    char count[SKD_COUNT_TEXT_BYTES];
    if (revision > since + 1)
        printf("revisions %.0f to %.0f: ", since + 1, revision);
    else
        printf("revision %.0f: ", revision);
    if (changes == NULL)
        print_change(params);
    cJSON_ArrayForEach(change, changes)
    {
        if (change != changes->child)
            fputs(", ", stdout);
        print_change(change);
    }
    if (cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(params, "resync")))
        puts("; too much to be told");
    else
        printf("; %s vertices\n",
               skd_count_text(
                   (double)count_rows(update, cJSON_GetObjectItemCaseSensitive(params, "vertices")),
                   count));
}

static void print_presence(const cJSON *present)
{
    const cJSON *item;
    char person[SKD_AUTHOR_TEXT_BYTES];
    fputs("here:", stdout);
    cJSON_ArrayForEach(item, present)
        printf("%s %s", item != present->child ? "," : "", skd_person_text(item, person));
    puts(cJSON_GetArraySize(present) == 0 ? " nobody" : "");
}

static void print_claims(const struct skd_message *claims)
{
    const cJSON *bones = cJSON_GetObjectItemCaseSensitive(claims->params, "bones"), *bone;
    size_t vertices =
        count_rows(claims, cJSON_GetObjectItemCaseSensitive(claims->params, "vertices"));
    int count = cJSON_GetArraySize(bones), shown = 0;
    char person[SKD_AUTHOR_TEXT_BYTES];
    printf("%s claims%s", skd_person_text(claims->params, person),
           count == 0 && vertices == 0 ? " nothing any more" : "");
    cJSON_ArrayForEach(bone, bones)
    {
        if (shown++ == NAMES_SHOWN)
            break;
        printf("%s %s", shown > 1 ? "," : "", bone->valuestring);
    }
    if (count > NAMES_SHOWN)
        printf(" and %d more bones", count - NAMES_SHOWN);
    if (vertices > 0)
        printf("%s %zu vertices", count > 0 ? " and" : "", vertices);
    putchar('\n');
}

static void print_as_text(const struct skd_message *message)
{
    const cJSON *params = message->params;
    if (strcmp(message->method, "session.update") == 0)
        print_update(message);
    else if (strcmp(message->method, "session.presence") == 0)
        print_presence(cJSON_GetObjectItemCaseSensitive(params, "present"));
    else if (strcmp(message->method, "session.claims") == 0)
        print_claims(message);
    else if (strcmp(message->method, "session.closed") == 0)
        printf("closed: %s\n", skd_json_text(params, "reason"));
    else if (strcmp(message->method, "journal.suspended") == 0)
        printf("not kept on the disk for now: %s\n", skd_json_text(params, "reason"));
    else if (strcmp(message->method, "journal.resumed") == 0)
        puts("kept on the disk again");
    fflush(stdout);
}

void skd_event_print(const struct skd_message *notification, bool with_arrays)
{
    if (skd_cli.json)
        print_as_json(notification, with_arrays);
    else
        print_as_text(notification);
}

void skd_event_print_attached(const cJSON *result)
{
    if (!skd_cli.json) {
        print_presence(cJSON_GetObjectItemCaseSensitive(result, "present"));
        fflush(stdout);
        return;
    }
    cJSON *json = begin_event("session.attach");
    const cJSON *member;
    cJSON_ArrayForEach(member, result)
        cJSON_AddItemToObject(json, member->string, cJSON_Duplicate(member, true));
    skd_print_own_json(json);
}

void skd_event_print_digest(const char *session, const char *instance, double revision,
                            const char *digest)
{
    if (!skd_cli.json) {
        printf("revision %.0f: digest %s\n", revision, digest);
        fflush(stdout);
        return;
    }
    cJSON *json = begin_event("digest");
    cJSON_AddStringToObject(json, "session", session);
    cJSON_AddStringToObject(json, "instance", instance);
    cJSON_AddNumberToObject(json, "revision", revision);
    cJSON_AddStringToObject(json, "digest", digest);
    skd_print_own_json(json);
}
