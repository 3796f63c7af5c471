/* See repeats.h. */
#include "requests/repeats.h"

#include "session/remembered.h"

bool skd_repeat_answered(struct skd_call *call)
{
    uint64_t sequence = call->request.sequence;
    const char *text;
    struct skd_error error;
    if (sequence == 0)
        return false;
    switch (
        skd_remembered_find(&call->live->session->remembered, call->author.id, sequence, &text)) {
    case SKD_SEQUENCE_NEW:
        if (skd_remembered_reserve(&call->live->session->remembered, call->author.id, &error) ==
            SKD_OK)
            return false;
        skd_call_fail(call, &error);
        return true;
    case SKD_SEQUENCE_STALE:
        (void)skd_fail(&error, SKD_STALE_SEQUENCE,
                       "sequence %llu is older than the last %d of this client, so nobody knows "
                       "whether it was done",
                       (unsigned long long)sequence, SKD_REMEMBERED_ANSWERS_MAX);
        skd_call_fail(call, &error);
        return true;
    case SKD_SEQUENCE_REPEATED:
        break;
    }
    cJSON *body = cJSON_Parse(text);
    cJSON_AddTrueToObject(body, "repeated");
    call->status = skd_encode_answer(call->mode, &call->request.message.id, body, NULL, 0,
                                     &call->encoded, &call->error);
    skd_call_finish(call); /* once it is durable */
    return true;
}

void skd_repeats_remember(struct skd_call *call)
{
    if (call->answer != NULL)
        skd_remembered_put(&call->live->session->remembered, call->author.id,
                           call->request.sequence, call->revision, call->answer);
    call->answer = NULL;
}
