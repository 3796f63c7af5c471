/* What a client knows of a session: its info, and, once asked for, its mesh and weights.
 *
 * Thread: one. Owns the messages that the arrays lie in; borrows the link.
 */
#ifndef SKD_CLI_MODEL_H
#define SKD_CLI_MODEL_H

#include "clients/cli/brush.h"
#include "clients/cli/link.h"

/* An array of an answer, with whatever holds its memory. */
struct skd_fetched {
    struct skd_message message;
    struct skd_array array;
    void *owned;
};
void skd_fetched_finish(struct skd_fetched *fetched);

struct skd_model {
    struct skd_link *link;
    char session[SKD_SESSION_NAME_BYTES_MAX + 1];
    struct skd_message info; /* session.info; never changes but for the poses */
    size_t vertex_count;
    size_t bone_count;
    double length;
    /* Empty until skd_model_fetch_*. */
    struct skd_fetched rest;
    struct skd_array triangles; /* lies in rest.message */
    void *triangles_owned;
    struct skd_fetched weights; /* as they were when they were fetched */
    struct skd_array joints;    /* lies in weights.message */
    size_t slots;               /* of a vertex in both */
    size_t weight_rows;         /* vertices in both */
    void *joints_owned;
};

/* Asks for session.info. Close *model in any case; the link stays the caller's to close. */
SKD_MUST_CHECK enum skd_status skd_model_open(struct skd_model *model, struct skd_link *link,
                                              const char *session, struct skd_error *error);
void skd_model_close(struct skd_model *model);

/* As skd_link_call, and also when the daemon dies on the way: then it is started again, and asked
 * again. So only for what changes nothing, or comes to the same when it is done twice, or has a
 * sequence. Errors: SKD_DAMAGED when the session came back without its last changes. */
SKD_MUST_CHECK enum skd_status skd_model_call(struct skd_model *model, const char *method,
                                              cJSON *body, const struct skd_array_out *arrays,
                                              int array_count, struct skd_message *answer,
                                              struct skd_error *error);

/* A change of a session that is made once, whatever happens to the connection meanwhile: numbered,
 * and sent again when the daemon dies on the way. */
SKD_MUST_CHECK enum skd_status skd_change_call(struct skd_link *link, const char *session,
                                               const char *method, cJSON *body,
                                               const struct skd_array_out *arrays, int array_count,
                                               struct skd_message *answer, struct skd_error *error);

/* Numbers a request that must not be done twice: no two of this terminal's have the same. */
void skd_add_sequence(cJSON *body);

/* Each asks once; the weights are of the vertices named, or of all (vertices NULL).
 * Errors: the daemon's; SKD_INTERNAL when it sends arrays of other sizes. */
SKD_MUST_CHECK enum skd_status skd_model_fetch_mesh(struct skd_model *model,
                                                    struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_model_fetch_weights(struct skd_model *model,
                                                       const uint32_t *vertices, size_t count,
                                                       struct skd_error *error);
/* The weights that were fetched. */
struct skd_weights skd_model_weights(const struct skd_model *model);

/* The index of a bone, and its parent's; SKD_NO_BONE. */
SKD_MUST_CHECK enum skd_status skd_model_find_bone(const struct skd_model *model, const char *name,
                                                   int *bone, int *parent, struct skd_error *error);
bool skd_model_has_pose(const struct skd_model *model, const char *pose);
bool skd_model_has_clip(const struct skd_model *model, const char *clip);

/* Posed positions [n][3]: of the vertices named, or of all (vertices NULL). Finish *positions in
 * any case. */
SKD_MUST_CHECK enum skd_status skd_model_evaluate(struct skd_model *model, const char *pose,
                                                  const uint32_t *vertices, size_t count,
                                                  struct skd_fetched *positions,
                                                  struct skd_error *error);

/* A request's body with its session. */
cJSON *skd_session_body(const char *session);

/* Where a session's export goes when nobody says: "/a/knight.glb" gives "knight-skind.glb" in the
 * current folder. Errors: SKD_BAD_PARAMS for a session that is not from a file. */
SKD_MUST_CHECK enum skd_status skd_default_output(const struct skd_model *model,
                                                  char path[SKD_PATH_BYTES_MAX],
                                                  struct skd_error *error);

/* session.export to an absolute path; finish *answer in any case. */
SKD_MUST_CHECK enum skd_status skd_session_export(struct skd_model *model, const char *path,
                                                  struct skd_message *answer,
                                                  struct skd_error *error);

#endif
