/* The methods: what each takes, and what its parameters must have to do with each other. See
 * request.h. A new parameter is a new row; only what ties several members together is code. */
#include "protocol/request.h"

#include "base/utf8.h"
#include "protocol/request_fields.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { QUOTED_BYTES = 80 };

static const char *const reduce_words[] = {"refuse", "largest", NULL};

_Static_assert(sizeof(enum skd_reduce) == sizeof(int), "read as a word");

/* Offsets count from the union, where each params struct begins. */
#define AT(type, member) .offset = offsetof(struct skd_##type##_params, member)
#define GIVEN(type, member) .given_offset = offsetof(struct skd_##type##_params, member)

#define SESSION(type)                                                                              \
    {                                                                                              \
        .name = "session", .kind = SKD_FIELD_SESSION, .is_required = true, .low = 1,               \
        .high = SKD_SESSION_NAME_BYTES_MAX, AT(type, session)                                      \
    }
#define POSE(type)                                                                                 \
    {                                                                                              \
        .name = "pose", .kind = SKD_FIELD_TEXT, .is_required = true, .low = 1,                     \
        .high = SKD_POSE_NAME_BYTES_MAX, AT(type, pose)                                            \
    }
#define VERTICES(type)                                                                             \
    {                                                                                              \
        .name = "vertices", .kind = SKD_FIELD_ARRAY, .dtype = SKD_U32, AT(type, vertices),         \
        GIVEN(type, vertices_given)                                                                \
    }
#define ARRAY(type, wire, member, element, width)                                                  \
    {                                                                                              \
        .name = wire, .kind = SKD_FIELD_ARRAY, .dtype = element, .row_width = width,               \
        AT(type, member)                                                                           \
    }
#define REQUIRED_ARRAY(type, wire, member, element, width)                                         \
    {                                                                                              \
        .name = wire, .kind = SKD_FIELD_ARRAY, .is_required = true, .dtype = element,              \
        .row_width = width, AT(type, member)                                                       \
    }
#define WORD(type, wire, member, list, first)                                                      \
    {                                                                                              \
        .name = wire, .kind = SKD_FIELD_WORD, .words = list, .fallback = first, AT(type, member)   \
    }
#define END                                                                                        \
    {                                                                                              \
        .name = NULL                                                                               \
    }

static const struct skd_field no_fields[] = {END};

static const struct skd_field protocol_fields[] = {
    {.name = "min",
     .kind = SKD_FIELD_WHOLE,
     .is_required = true,
     .low = 0,
     .high = INT_MAX,
     AT(hello, protocol_min)},
    {.name = "max",
     .kind = SKD_FIELD_WHOLE,
     .is_required = true,
     .low = 0,
     .high = INT_MAX,
     AT(hello, protocol_max)},
    END,
};

static const struct skd_field client_fields[] = {
    {.name = "name",
     .kind = SKD_FIELD_TEXT,
     .high = SKD_CLIENT_NAME_BYTES_MAX,
     AT(hello, client_name)},
    {.name = "version",
     .kind = SKD_FIELD_TEXT,
     .high = SKD_CLIENT_NAME_BYTES_MAX,
     AT(hello, client_version)},
    END,
};

static const struct skd_field hello_fields[] = {
    {.name = "protocol", .kind = SKD_FIELD_OBJECT, .is_required = true, .members = protocol_fields},
    {.name = "client", .kind = SKD_FIELD_OBJECT, .members = client_fields},
    END,
};

static const struct skd_field cancel_fields[] = {
    {.name = "id", .kind = SKD_FIELD_ID, .is_required = true, AT(cancel, target)},
    END,
};

static const struct skd_field bone_fields[] = {
    {.name = "names",
     .kind = SKD_FIELD_NAMES,
     AT(session_create, bone_names),
     .count_offset = offsetof(struct skd_session_create_params, bone_name_count)},
    REQUIRED_ARRAY(session_create, "parents", bone_parents, SKD_I32, 0),
    REQUIRED_ARRAY(session_create, "binds", bone_binds, SKD_F64, 16),
    END,
};

static const struct skd_field session_create_fields[] = {
    {.name = "name",
     .kind = SKD_FIELD_SESSION,
     .low = 1,
     .high = SKD_SESSION_NAME_BYTES_MAX,
     AT(session_create, name)},
    {.name = "file",
     .kind = SKD_FIELD_PATH,
     .low = 1,
     .high = SKD_PATH_BYTES_MAX,
     AT(session_create, file)},
    {.name = "influences",
     .kind = SKD_FIELD_WHOLE,
     .low = 4,
     .high = 8,
     .fallback = 4,
     AT(session_create, influences)},
    WORD(session_create, "fill", fill, skd_fill_words, 2),
    WORD(session_create, "reduce", reduce, reduce_words, SKD_REDUCE_REFUSE),
    ARRAY(session_create, "positions", positions, SKD_F32, 3),
    ARRAY(session_create, "triangles", triangles, SKD_U32, 3),
    {.name = "bones", .kind = SKD_FIELD_OBJECT, .members = bone_fields},
    ARRAY(session_create, "influence_offsets", influence_offsets, SKD_U32, 0),
    ARRAY(session_create, "influence_joints", influence_joints, SKD_U16, 0),
    ARRAY(session_create, "influence_weights", influence_weights, SKD_F32, 0),
    END,
};

static const struct skd_field session_fields[] = {SESSION(session), END};

static const struct skd_field attach_fields[] = {
    SESSION(session),
    {.name = "revision",
     .kind = SKD_FIELD_COUNTER,
     .high = 9007199254740992.0,
     AT(session, revision),
     GIVEN(session, has_revision)},
    END,
};

static const struct skd_field export_fields[] = {
    SESSION(session),
    {.name = "path",
     .kind = SKD_FIELD_PATH,
     .is_required = true,
     .low = 1,
     .high = SKD_PATH_BYTES_MAX,
     AT(session, path)},
    END,
};

static const struct skd_field pose_set_fields[] = {
    SESSION(pose_set),
    POSE(pose_set),
    {.name = "clip", .kind = SKD_FIELD_TEXT, .high = SKD_JSON_BYTES_MAX, AT(pose_set, clip)},
    {.name = "time",
     .kind = SKD_FIELD_NUMBER,
     .low = -DBL_MAX,
     .high = DBL_MAX,
     .fallback = NAN,
     AT(pose_set, time)},
    {.name = "bend",
     .kind = SKD_FIELD_NUMBER,
     .low = -180,
     .high = 180,
     .fallback = NAN,
     AT(pose_set, bend)},
    {.name = "seed", .kind = SKD_FIELD_WHOLE, .low = 0, .high = INT_MAX, AT(pose_set, seed)},
    ARRAY(pose_set, "matrices", matrices, SKD_F64, 16),
    END,
};

static const struct skd_field pose_evaluate_fields[] = {
    SESSION(pose_evaluate),
    POSE(pose_evaluate),
    VERTICES(pose_evaluate),
    END,
};

static const struct skd_field weights_get_fields[] = {
    SESSION(weights_get),
    VERTICES(weights_get),
    END,
};

static const struct skd_field weights_set_fields[] = {
    SESSION(weights_set),
    REQUIRED_ARRAY(weights_set, "vertices", vertices, SKD_U32, 0),
    REQUIRED_ARRAY(weights_set, "weights", weights, SKD_F32, SKD_ROW_OF_SLOTS),
    END,
};

static const struct skd_field stroke_fields[] = {
    SESSION(stroke),
    POSE(stroke),
    REQUIRED_ARRAY(stroke, "vertices", vertices, SKD_U32, 0),
    REQUIRED_ARRAY(stroke, "positions", positions, SKD_F32, 3),
    {.name = "stream", .kind = SKD_FIELD_FLAG, .fallback = true, AT(stroke, stream)},
    WORD(stroke, "method", method, skd_method_words, 0),
    WORD(stroke, "constraint", constraint, skd_constraint_words, 0),
    {.name = "stiffness",
     .kind = SKD_FIELD_NUMBER,
     .low = 0,
     .high = 10,
     .fallback = 0.008,
     AT(stroke, stiffness)},
    {.name = "thesis_k",
     .kind = SKD_FIELD_NUMBER,
     .low = DBL_TRUE_MIN,
     .high = DBL_MAX,
     .fallback = 0.05,
     AT(stroke, thesis_k)},
    {.name = "thesis_h",
     .kind = SKD_FIELD_NUMBER,
     .low = 0,
     .high = DBL_MAX,
     .fallback = 1.2,
     AT(stroke, thesis_h)},
    {.name = "locked_bones",
     .kind = SKD_FIELD_NAMES,
     AT(stroke, locked_bones),
     .count_offset = offsetof(struct skd_stroke_params, locked_bone_count)},
    ARRAY(stroke, "locked_vertices", locked_vertices, SKD_U32, 0),
    END,
};

static enum skd_status check_hello(struct skd_request *request, struct skd_error *error)
{
    struct skd_hello_params *hello = &request->params.hello;
    if (hello->client_name == NULL)
        hello->client_name = "";
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

static enum skd_status check_session_create(struct skd_request *request, struct skd_error *error)
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

static enum skd_status check_pose_set(struct skd_request *request, struct skd_error *error)
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

static enum skd_status check_stroke(struct skd_request *request, struct skd_error *error)
{
    const struct skd_stroke_params *stroke = &request->params.stroke;
    if (stroke->positions.rows != stroke->vertices.rows)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "stroke.apply: positions has %zu rows but vertices has %zu; send one "
                        "position a vertex",
                        stroke->positions.rows, stroke->vertices.rows);
    return SKD_OK;
}

/* Whether the rows are as wide as this session's is asked when the session is at hand. */
static enum skd_status check_weights_set(struct skd_request *request, struct skd_error *error)
{
    const struct skd_weights_set_params *set = &request->params.weights_set;
    const size_t rows = set->vertices.rows, count = set->weights.count;
    bool is_flat = set->weights.rows == count;
    bool fits = is_flat ? count == 4 * rows || count == 8 * rows : set->weights.rows == rows;
    if (fits)
        return SKD_OK;
    return skd_fail(error, SKD_COUNT_MISMATCH,
                    "weights.set: weights has %zu %s but vertices has %zu; send one row a vertex",
                    set->weights.rows, is_flat ? "numbers" : "rows", rows);
}

static const struct {
    const struct skd_field *fields;
    enum skd_status (*check)(struct skd_request *request, struct skd_error *error);
} methods[SKD_REQUEST_METHOD_COUNT] = {
    [SKD_REQUEST_HELLO] = {hello_fields, check_hello},
    [SKD_REQUEST_PING] = {no_fields, NULL},
    [SKD_REQUEST_CANCEL] = {cancel_fields, NULL},
    [SKD_REQUEST_SESSION_CREATE] = {session_create_fields, check_session_create},
    [SKD_REQUEST_SESSION_LIST] = {no_fields, NULL},
    [SKD_REQUEST_SESSION_INFO] = {session_fields, NULL},
    [SKD_REQUEST_SESSION_ATTACH] = {attach_fields, NULL},
    [SKD_REQUEST_SESSION_DETACH] = {session_fields, NULL},
    [SKD_REQUEST_SESSION_CLOSE] = {session_fields, NULL},
    [SKD_REQUEST_SESSION_EXPORT] = {export_fields, NULL},
    [SKD_REQUEST_MESH_GET] = {session_fields, NULL},
    [SKD_REQUEST_POSE_SET] = {pose_set_fields, check_pose_set},
    [SKD_REQUEST_POSE_EVALUATE] = {pose_evaluate_fields, NULL},
    [SKD_REQUEST_STROKE_APPLY] = {stroke_fields, check_stroke},
    [SKD_REQUEST_WEIGHTS_GET] = {weights_get_fields, NULL},
    [SKD_REQUEST_WEIGHTS_SET] = {weights_set_fields, check_weights_set},
    [SKD_REQUEST_HISTORY_UNDO] = {session_fields, NULL},
    [SKD_REQUEST_HISTORY_REDO] = {session_fields, NULL},
    [SKD_REQUEST_STATS] = {no_fields, NULL},
    [SKD_REQUEST_SHUTDOWN] = {no_fields, NULL},
};

static enum skd_status find_method(struct skd_request *request, struct skd_error *error)
{
    const char *name = request->message.method;
    if (name == NULL)
        return skd_fail(error, SKD_BAD_REQUEST, "this is an answer, and nothing was asked");
    for (int i = 0; i < SKD_REQUEST_METHOD_COUNT; i++)
        if (strcmp(name, skd_request_method_name((enum skd_request_method)i)) == 0) {
            request->method = (enum skd_request_method)i;
            return SKD_OK;
        }
    return skd_fail(error, SKD_UNKNOWN_METHOD, "there is no method \"%.*s\"",
                    skd_utf8_quote(name, QUOTED_BYTES), name);
}

enum skd_status skd_request_decode(struct skd_frame *frame, struct skd_request *request,
                                   struct skd_error *error)
{
    *request = (struct skd_request){.method = SKD_REQUEST_METHOD_COUNT};
    enum skd_status status = skd_message_parse(frame, &request->message, error);
    if (status == SKD_OK)
        status = find_method(request, error);
    if (status != SKD_OK)
        return status;
    bool is_notification = request->message.id.kind == SKD_ID_NONE;
    if (is_notification != (request->method == SKD_REQUEST_CANCEL))
        return skd_fail(error, SKD_BAD_REQUEST,
                        is_notification ? "%s: the id is missing; every request gets an answer"
                                        : "%s is a notification; leave its id out",
                        request->message.method);
    status =
        skd_fields_read(request, request->message.params, methods[request->method].fields, error);
    if (status == SKD_OK && methods[request->method].check != NULL)
        status = methods[request->method].check(request, error);
    return status;
}

void skd_request_finish(struct skd_request *request)
{
    for (int i = 0; i < request->owned_count; i++)
        free(request->owned[i]);
    skd_message_finish(&request->message);
    *request = (struct skd_request){.method = SKD_REQUEST_METHOD_COUNT};
}
