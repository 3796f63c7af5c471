/* A claim: the bones and vertices that a tool says it works on.
 *
 * Stage: rig session. Made and looked at by workers, kept by the loop, which alone counts its
 * references. It belongs to a connection in a session and goes with it; it never changes once it is
 * made.
 */
#ifndef SKD_REQUESTS_CLAIM_H
#define SKD_REQUESTS_CLAIM_H

#include "requests/state.h"

/* What all claims of a session may take together. */
#define SKD_CLAIM_BYTES_MAX ((size_t)64 << 20)

struct skd_claim {
    int references; /* the loop's */
    size_t bytes;
    int bone_count;
    uint16_t *bones;  /* [bone_count] rising */
    uint8_t *is_bone; /* [bones of the rig] */
    size_t vertex_count;
    uint32_t *vertices; /* [vertex_count] rising */
    uint8_t *bits;      /* the same, a bit a vertex of the rig; NULL where there are none */
};

/* What the params name. *claim is set, and to be released, also where this fails (NULL: no memory).
 * A worker; the rig never changes, so this needs no turn. Errors: SKD_NO_BONE, what
 * skd_session_check_vertices says, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_claim_create(const struct skd_session *session,
                                                const struct skd_session_claim_params *params,
                                                struct skd_claim **claim, struct skd_error *error);
struct skd_claim *skd_claim_hold(struct skd_claim *claim);
void skd_claim_release(void *claim); /* NULL is fine */

/* Takes a listener's claim away. */
void skd_claim_drop(struct skd_live *live, struct skd_listener_of_session *listener);

/* Whether it names the vertex, or the bone (SKD_SLOT_EMPTY: none). */
bool skd_claim_covers(const struct skd_claim *claim, uint32_t vertex, uint16_t bone);

/* {bones, vertices} of a listener's claim, or of none; and `bones: [name]` alone. */
cJSON *skd_claim_describe(const struct skd_live *live,
                          const struct skd_listener_of_session *listener);
void skd_claim_add_bones(cJSON *object, const struct skd_live *live, const struct skd_claim *claim);

#endif
