/* What the parameters of one request must have to do with each other. See request_checks.h. */
#include "protocol/request_checks.h"

#include <math.h>
#include <string.h>

enum skd_status skd_check_hello(struct skd_request *request, struct skd_error *error)
{
    struct skd_hello_params *hello = &request->params.hello;
    if (hello->client_name == NULL)
        hello->client_name = "";
    if (hello->client_user == NULL)
        hello->client_user = "";
    if (hello->client_version == NULL)
        hello->client_version = "";
    if (hello->protocol_min > hello->protocol_max)
        return skd_fail(error, SKD_BAD_PARAMS, "hello: protocol.min is %d and protocol.max %d",
                        hello->protocol_min, hello->protocol_max);
    return SKD_OK;
}

/* The arrays of a rig: all of them, and of lengths that go together. */
static enum skd_status check_rig_arrays(const struct skd_session_create_params *rig,
                                        struct skd_error *error)
{
    const struct {
        const char *name;
        const struct skd_array *array;
    } needed[] = {
        {"positions", &rig->positions},
        {"triangles", &rig->triangles},
        {"bones", &rig->bone_parents},
        {"influence_offsets", &rig->influence_offsets},
        {"influence_joints", &rig->influence_joints},
        {"influence_weights", &rig->influence_weights},
    };
    for (size_t i = 0; i < sizeof needed / sizeof needed[0]; i++)
        if (needed[i].array->data == NULL)
            return skd_fail(error, SKD_BAD_PARAMS,
                            "session.create: %s is missing; give file, or positions, triangles, "
                            "bones and influence_offsets, _joints, _weights",
                            needed[i].name);
    if (rig->influence_offsets.rows != rig->positions.rows + 1)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "session.create: influence_offsets has %zu numbers but positions has %zu "
                        "rows; send one offset a vertex and the end",
                        rig->influence_offsets.rows, rig->positions.rows);
    if (rig->influence_joints.rows != rig->influence_weights.rows)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "session.create: influence_joints has %zu numbers but influence_weights "
                        "has %zu; send one joint a weight",
                        rig->influence_joints.rows, rig->influence_weights.rows);
    if (rig->bone_parents.rows != rig->bone_binds.rows)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "session.create: bones.parents has %zu numbers but bones.binds has %zu "
                        "matrices; send one of each a bone",
                        rig->bone_parents.rows, rig->bone_binds.rows);
    if (rig->bone_names != NULL && rig->bone_name_count != rig->bone_parents.rows)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "session.create: bones.names has %zu names but bones.parents has %zu "
                        "numbers; send one of each a bone, or no names",
                        rig->bone_name_count, rig->bone_parents.rows);
    return SKD_OK;
}

enum skd_status skd_check_session_create(struct skd_request *request, struct skd_error *error)
{
    const struct skd_session_create_params *rig = &request->params.session_create;
    bool has_array = rig->positions.data != NULL || rig->triangles.data != NULL ||
                     rig->bone_parents.data != NULL || rig->influence_offsets.data != NULL ||
                     rig->influence_joints.data != NULL || rig->influence_weights.data != NULL;
    if (rig->influences != 4 && rig->influences != 8)
        return skd_fail(error, SKD_BAD_PARAMS, "session.create: influences is %d; it is 4 or 8",
                        rig->influences);
    if (rig->file == NULL)
        return check_rig_arrays(rig, error);
    if (has_array)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "session.create: there is a file and there are arrays; give one of them");
    return SKD_OK;
}

enum skd_status skd_check_session_save(struct skd_request *request, struct skd_error *error)
{
    static const char ending[] = ".skind";
    const char *path = request->params.session_keep.path;
    size_t length = strlen(path), tail = sizeof ending - 1;
    if (length <= tail || strcmp(path + length - tail, ending) != 0)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "session.save: the path must end in .skind, as a saved session's does");
    return SKD_OK;
}

/* Exactly one of two members. */
static enum skd_status need_one(const struct skd_request *request, const char *a, const char *b,
                                const char *names, struct skd_error *error)
{
    if ((a != NULL) != (b != NULL))
        return SKD_OK;
    return skd_fail(error, SKD_BAD_PARAMS, "%s: give either %s", request->message.method, names);
}

enum skd_status skd_check_session_open(struct skd_request *request, struct skd_error *error)
{
    const struct skd_session_keep_params *params = &request->params.session_keep;
    return need_one(request, params->path, params->closed, "path or closed", error);
}

enum skd_status skd_check_session_verify(struct skd_request *request, struct skd_error *error)
{
    const struct skd_session_keep_params *params = &request->params.session_keep;
    return need_one(request, params->session, params->path, "session or path", error);
}

enum skd_status skd_check_pose_set(struct skd_request *request, struct skd_error *error)
{
    const struct skd_pose_set_params *pose = &request->params.pose_set;
    bool has_clip = pose->clip != NULL;
    bool has_time = !isnan(pose->time);
    bool has_bend = !isnan(pose->bend);
    bool has_matrices = pose->matrices.data != NULL;
    if (has_clip != has_time || has_clip + has_bend + has_matrices != 1)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "pose.set: give one of clip and time, bend, or matrices");
    return SKD_OK;
}

/* The thesis's method solves one target from the weights that are there, and knows no more. */
static enum skd_status check_thesis(const struct skd_stroke_params *stroke, struct skd_error *error)
{
    const struct {
        const char *name;
        bool is_asked;
    } options[] = {
        {"pin \"move\"", stroke->pin == SKD_WORD_MOVE},
        {"slots \"evidence\"", stroke->slots == SKD_WORD_EVIDENCE},
        {"guard", stroke->guard_given && stroke->guard > 0},
        {"smooth", stroke->smooth > 0},
        {"mix", stroke->mix < 1},
        {"mask", stroke->mask.data != NULL},
        {"residual", stroke->residual != SKD_WORD_REPORT},
    };
    for (size_t i = 0; i < sizeof options / sizeof options[0]; i++)
        if (options[i].is_asked)
            return skd_fail(error, SKD_UNSUPPORTED,
                            "stroke.apply: the method \"thesis\" knows no %s; use the method "
                            "\"exact\"",
                            options[i].name);
    return SKD_OK;
}

enum skd_status skd_check_stroke(struct skd_request *request, struct skd_error *error)
{
    const struct skd_stroke_params *stroke = &request->params.stroke;
    if (stroke->positions.rows != stroke->vertices.rows)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "stroke.apply: positions has %zu rows but vertices has %zu; send one "
                        "position a vertex",
                        stroke->positions.rows, stroke->vertices.rows);
    if (stroke->mask.data != NULL && stroke->mask.rows != stroke->vertices.rows)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "stroke.apply: mask has %zu numbers but vertices has %zu; send one a "
                        "vertex, or no mask",
                        stroke->mask.rows, stroke->vertices.rows);
    return strcmp(skd_method_words[stroke->method], "thesis") == 0 ? check_thesis(stroke, error)
                                                                   : SKD_OK;
}

enum skd_status skd_check_pins_solve(struct skd_request *request, struct skd_error *error)
{
    (void)error;
    request->params.stroke.pin = SKD_WORD_NONE;
    request->params.stroke.mix = 1;
    return SKD_OK;
}

/* How many vertices a pose has, the session knows. */
enum skd_status skd_check_refit(struct skd_request *request, struct skd_error *error)
{
    struct skd_stroke_params *refit = &request->params.stroke;
    refit->pin = SKD_WORD_NONE;
    refit->mix = 1;
    if (refit->positions.rows % refit->pose_count != 0)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "session.refit: positions has %zu rows for %zu poses; send one position a "
                        "vertex for each pose",
                        refit->positions.rows, refit->pose_count);
    return SKD_OK;
}

/* What a row of weights may come with: one a vertex too. */
static enum skd_status check_set_more(const struct skd_weights_set_params *set,
                                      struct skd_error *error)
{
    const struct {
        const char *name;
        const struct skd_array *array;
    } more[] = {{"rest", &set->rest}, {"offsets", &set->offsets}};
    if (set->joints.data != NULL && set->joints.count != set->weights.count)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "weights.set: joints has %zu numbers but weights has %zu; send one joint a "
                        "weight, or no joints",
                        set->joints.count, set->weights.count);
    for (size_t i = 0; i < sizeof more / sizeof more[0]; i++)
        if (more[i].array->data != NULL && more[i].array->rows != set->vertices.rows)
            return skd_fail(error, SKD_COUNT_MISMATCH,
                            "weights.set: %s has %zu rows but vertices has %zu; send one a vertex",
                            more[i].name, more[i].array->rows, set->vertices.rows);
    if ((set->shape != NULL) != (set->offsets.data != NULL))
        return skd_fail(error, SKD_BAD_PARAMS,
                        "weights.set: shape and offsets go together; send both or none");
    return SKD_OK;
}

/* Whether the rows are as wide as this session's is asked when the session is at hand. */
enum skd_status skd_check_weights_set(struct skd_request *request, struct skd_error *error)
{
    const struct skd_weights_set_params *set = &request->params.weights_set;
    const size_t rows = set->vertices.rows, count = set->weights.count;
    bool is_flat = set->weights.rows == count;
    bool fits = is_flat ? count == 4 * rows || count == 8 * rows : set->weights.rows == rows;
    if (fits)
        return check_set_more(set, error);
    return skd_fail(error, SKD_COUNT_MISMATCH,
                    "weights.set: weights has %zu %s but vertices has %zu; send one row a vertex",
                    set->weights.rows, is_flat ? "numbers" : "rows", rows);
}

enum skd_status skd_check_weights_reduce(struct skd_request *request, struct skd_error *error)
{
    const struct skd_weights_edit_params *reduce = &request->params.weights_edit;
    if (reduce->by == SKD_REDUCE_BY_SIZE && reduce->poses != NULL)
        return skd_fail(error, SKD_BAD_PARAMS,
                        "weights.reduce: poses have no say when it goes by \"size\"; leave one of "
                        "them out");
    return SKD_OK;
}
