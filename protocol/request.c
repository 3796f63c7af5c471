/* The methods: what each takes, and what its parameters must have to do with each other. See
 * request.h. A new parameter is a new row; what ties several members together is in
 * request_checks.c. */
#include "protocol/request.h"

#include "base/utf8.h"
#include "protocol/request_checks.h"
#include "protocol/request_fields.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { QUOTED_BYTES = 80 };

#define SKD_SEQUENCE_MAX 9007199254740992.0 /* 2^53 */

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

#define HISTORY_BYTES(type)                                                                        \
    {                                                                                              \
        .name = "history_bytes", .kind = SKD_FIELD_COUNTER,                                        \
        .low = (double)SKD_HISTORY_BYTES_LEAST, .high = (double)SKD_HISTORY_BYTES_LIMIT,           \
        AT(type, history_bytes)                                                                    \
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
    {.name = "id",
     .kind = SKD_FIELD_SESSION,
     .low = 1,
     .high = SKD_CLIENT_ID_BYTES_MAX,
     AT(hello, client_id)},
    {.name = "user", .kind = SKD_FIELD_TEXT, .high = SKD_USER_BYTES_MAX, AT(hello, client_user)},
    END,
};

static const struct skd_field hello_fields[] = {
    {.name = "protocol", .kind = SKD_FIELD_OBJECT, .is_required = true, .members = protocol_fields},
    {.name = "client", .kind = SKD_FIELD_OBJECT, .members = client_fields},
    {.name = "token",
     .kind = SKD_FIELD_TEXT,
     .low = SKD_TOKEN_DIGITS,
     .high = SKD_TOKEN_DIGITS,
     AT(hello, token)},
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
    WORD(session_create, "reduce", reduce, skd_reduce_words, SKD_REDUCE_REFUSE),
    WORD(session_create, "durability", durability, skd_durability_words, 0),
    HISTORY_BYTES(session_create),
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
    {.name = "instance",
     .kind = SKD_FIELD_TEXT,
     .high = SKD_CLIENT_ID_BYTES_MAX,
     AT(session, instance)},
    END,
};

/* What a member is called for which a session's file, or what becomes of it, is told. */
#define KEEP_SESSION(required)                                                                     \
    {                                                                                              \
        .name = "session", .kind = SKD_FIELD_SESSION, .is_required = required, .low = 1,           \
        .high = SKD_SESSION_NAME_BYTES_MAX, AT(session_keep, session)                              \
    }
#define KEEP_PATH(required)                                                                        \
    {                                                                                              \
        .name = "path", .kind = SKD_FIELD_PATH, .is_required = required, .low = 1,                 \
        .high = SKD_PATH_BYTES_MAX, AT(session_keep, path)                                         \
    }
#define KEEP_NAME(wire, member, required)                                                          \
    {                                                                                              \
        .name = wire, .kind = SKD_FIELD_SESSION, .is_required = required, .low = 1,                \
        .high = SKD_SESSION_NAME_BYTES_MAX, AT(session_keep, member)                               \
    }
static const struct skd_field session_set_fields[] = {
    KEEP_SESSION(true),
    WORD(session_keep, "durability", durability, skd_durability_words, -1),
    HISTORY_BYTES(session_keep),
    END,
};

static const struct skd_field session_save_fields[] = {KEEP_SESSION(true), KEEP_PATH(true), END};

static const struct skd_field session_open_fields[] = {
    KEEP_PATH(false),
    KEEP_NAME("closed", closed, false),
    KEEP_NAME("name", name, false),
    END,
};

static const struct skd_field session_fork_fields[] = {
    KEEP_SESSION(true),
    KEEP_NAME("name", name, true),
    END,
};

static const struct skd_field session_delete_fields[] = {KEEP_SESSION(true), END};

static const struct skd_field session_verify_fields[] = {
    KEEP_SESSION(false),
    KEEP_PATH(false),
    END,
};

static const struct skd_field session_claim_fields[] = {
    SESSION(session_claim),
    {.name = "bones",
     .kind = SKD_FIELD_NAMES,
     AT(session_claim, bones),
     .count_offset = offsetof(struct skd_session_claim_params, bone_count)},
    ARRAY(session_claim, "vertices", vertices, SKD_U32, 0),
    END,
};

static const struct skd_field history_fields[] = {
    SESSION(session),
    {.name = "own", .kind = SKD_FIELD_FLAG, AT(session, own)},
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
    SESSION(shown),
    POSE(shown),
    VERTICES(shown),
    END,
};

static const struct skd_field weights_get_fields[] = {
    SESSION(shown),
    VERTICES(shown),
    END,
};

static const struct skd_field weights_set_fields[] = {
    SESSION(weights_set),
    REQUIRED_ARRAY(weights_set, "vertices", vertices, SKD_U32, 0),
    REQUIRED_ARRAY(weights_set, "weights", weights, SKD_F32, SKD_ROW_OF_SLOTS),
    ARRAY(weights_set, "joints", joints, SKD_U16, SKD_ROW_OF_SLOTS),
    ARRAY(weights_set, "rest", rest, SKD_F32, 3),
    {.name = "shape",
     .kind = SKD_FIELD_TEXT,
     .low = 1,
     .high = SKD_POSE_NAME_BYTES_MAX,
     AT(weights_set, shape)},
    ARRAY(weights_set, "offsets", offsets, SKD_F32, 3),
    END,
};

/* What every solve of targets takes, however they came to be. */
#define SOLVE_FIELDS                                                                               \
    {.name = "stream", .kind = SKD_FIELD_FLAG, .fallback = true, AT(stroke, stream)},              \
        WORD(stroke, "constraint", constraint, skd_constraint_words, 0), STIFFNESS,                \
        WORD(stroke, "slots", slots, skd_slots_words, SKD_WORD_KEEP),                              \
        {.name = "guard",                                                                          \
         .kind = SKD_FIELD_NUMBER,                                                                 \
         .high = SKD_GUARD_MAX,                                                                    \
         .fallback = 0.3,                                                                          \
         AT(stroke, guard),                                                                        \
         GIVEN(stroke, guard_given)},                                                              \
        {.name = "smooth", .kind = SKD_FIELD_NUMBER, .high = SKD_SMOOTH_MAX, AT(stroke, smooth)},  \
        WORD(stroke, "residual", residual, skd_residual_words, SKD_WORD_REPORT),                   \
        {.name = "locked_bones",                                                                   \
         .kind = SKD_FIELD_NAMES,                                                                  \
         AT(stroke, locked_bones),                                                                 \
         .count_offset = offsetof(struct skd_stroke_params, locked_bone_count)},                   \
        ARRAY(stroke, "locked_vertices", locked_vertices, SKD_U32, 0)
#define STIFFNESS                                                                                  \
    {                                                                                              \
        .name = "stiffness", .kind = SKD_FIELD_NUMBER, .high = SKD_STIFFNESS_MAX, .fallback = NAN, \
        AT(stroke, stiffness)                                                                      \
    }

static const struct skd_field stroke_fields[] = {
    SESSION(stroke),
    POSE(stroke),
    REQUIRED_ARRAY(stroke, "vertices", vertices, SKD_U32, 0),
    REQUIRED_ARRAY(stroke, "positions", positions, SKD_F32, 3),
    ARRAY(stroke, "mask", mask, SKD_F32, 0),
    {.name = "mix", .kind = SKD_FIELD_NUMBER, .high = 1, .fallback = 1, AT(stroke, mix)},
    WORD(stroke, "pin", pin, skd_pin_words, SKD_WORD_SET),
    WORD(stroke, "method", method, skd_method_words, 0),
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
    SOLVE_FIELDS,
    END,
};

static const struct skd_field pins_solve_fields[] = {
    SESSION(stroke), POSE(stroke), VERTICES(stroke), SOLVE_FIELDS, END,
};

static const struct skd_field refit_fields[] = {
    SESSION(stroke),
    {.name = "poses",
     .kind = SKD_FIELD_NAMES,
     .is_required = true,
     .low = 1,
     .high = SKD_TARGET_POSES_MAX,
     AT(stroke, poses),
     .count_offset = offsetof(struct skd_stroke_params, pose_count)},
    REQUIRED_ARRAY(stroke, "positions", positions, SKD_F32, 3),
    STIFFNESS,
    WORD(stroke, "slots", slots, skd_slots_words, SKD_WORD_EVIDENCE),
    {.name = "rounds",
     .kind = SKD_FIELD_WHOLE,
     .low = 1,
     .high = SKD_REFIT_ROUNDS_MAX,
     .fallback = 3,
     AT(stroke, rounds)},
    END,
};

static const struct skd_field layer_fields[] = {SESSION(pins), POSE(pins), END};

static const struct skd_field pins_weigh_fields[] = {
    SESSION(pins),
    POSE(pins),
    {.name = "weight",
     .kind = SKD_FIELD_NUMBER,
     .is_required = true,
     .high = SKD_PIN_WEIGHT_MAX,
     AT(pins, weight)},
    VERTICES(pins),
    END,
};

static const struct skd_field pins_clear_fields[] = {
    SESSION(pins),
    {.name = "pose",
     .kind = SKD_FIELD_TEXT,
     .low = 1,
     .high = SKD_POSE_NAME_BYTES_MAX,
     AT(pins, pose)},
    VERTICES(pins),
    END,
};

static const struct skd_field guard_set_fields[] = {
    SESSION(guard_set),
    {.name = "poses",
     .kind = SKD_FIELD_NAMES,
     .high = SKD_GUARD_NAMES_MAX,
     AT(guard_set, poses),
     .count_offset = offsetof(struct skd_guard_set_params, pose_count)},
    {.name = "clips",
     .kind = SKD_FIELD_NAMES,
     .high = SKD_GUARD_NAMES_MAX,
     AT(guard_set, clips),
     .count_offset = offsetof(struct skd_guard_set_params, clip_count)},
    ARRAY(guard_set, "matrices", matrices, SKD_F64, 16),
    {.name = "count",
     .kind = SKD_FIELD_WHOLE,
     .low = 1,
     .high = SKD_GUARD_COUNT_MAX,
     .fallback = 8,
     AT(guard_set, count)},
    END,
};

static const struct skd_field weights_mirror_fields[] = {
    SESSION(weights_edit),
    WORD(weights_edit, "axis", axis, skd_axis_words, 0),
    WORD(weights_edit, "from", from, skd_side_words, 0),
    {.name = "origin",
     .kind = SKD_FIELD_NUMBER,
     .low = -DBL_MAX,
     .high = DBL_MAX,
     AT(weights_edit, origin)},
    {.name = "tolerance",
     .kind = SKD_FIELD_NUMBER,
     .high = 1,
     .fallback = 1e-3,
     AT(weights_edit, tolerance)},
    VERTICES(weights_edit),
    END,
};

static const struct skd_field weights_prune_fields[] = {
    SESSION(weights_edit),
    {.name = "below",
     .kind = SKD_FIELD_NUMBER,
     .high = 1,
     .fallback = 0.01,
     AT(weights_edit, below)},
    VERTICES(weights_edit),
    END,
};

static const struct skd_field weights_reduce_fields[] = {
    SESSION(weights_edit),
    {.name = "influences",
     .kind = SKD_FIELD_WHOLE,
     .is_required = true,
     .low = 1,
     .high = 8,
     AT(weights_edit, influences)},
    WORD(weights_edit, "by", by, skd_reduce_by_words, SKD_REDUCE_BY_POSES),
    {.name = "poses",
     .kind = SKD_FIELD_NAMES,
     .low = 1,
     .high = SKD_POSES_MAX,
     AT(weights_edit, poses),
     .count_offset = offsetof(struct skd_weights_edit_params, pose_count)},
    VERTICES(weights_edit),
    END,
};

static const struct {
    const struct skd_field *fields;
    enum skd_status (*check)(struct skd_request *request, struct skd_error *error);
} methods[SKD_REQUEST_METHOD_COUNT] = {
    [SKD_REQUEST_HELLO] = {hello_fields, skd_check_hello},
    [SKD_REQUEST_PING] = {no_fields, NULL},
    [SKD_REQUEST_CANCEL] = {cancel_fields, NULL},
    [SKD_REQUEST_SESSION_CREATE] = {session_create_fields, skd_check_session_create},
    [SKD_REQUEST_SESSION_LIST] = {no_fields, NULL},
    [SKD_REQUEST_SESSION_INFO] = {session_fields, NULL},
    [SKD_REQUEST_SESSION_ATTACH] = {attach_fields, NULL},
    [SKD_REQUEST_SESSION_DETACH] = {session_fields, NULL},
    [SKD_REQUEST_SESSION_CLOSE] = {session_fields, NULL},
    [SKD_REQUEST_SESSION_EXPORT] = {export_fields, NULL},
    [SKD_REQUEST_SESSION_SET] = {session_set_fields, NULL},
    [SKD_REQUEST_SESSION_SAVE] = {session_save_fields, skd_check_session_save},
    [SKD_REQUEST_SESSION_OPEN] = {session_open_fields, skd_check_session_open},
    [SKD_REQUEST_SESSION_FORK] = {session_fork_fields, NULL},
    [SKD_REQUEST_SESSION_DELETE] = {session_delete_fields, NULL},
    [SKD_REQUEST_SESSION_VERIFY] = {session_verify_fields, skd_check_session_verify},
    [SKD_REQUEST_SESSION_CLAIM] = {session_claim_fields, NULL},
    [SKD_REQUEST_MESH_GET] = {session_fields, NULL},
    [SKD_REQUEST_POSE_SET] = {pose_set_fields, skd_check_pose_set},
    [SKD_REQUEST_POSE_EVALUATE] = {pose_evaluate_fields, NULL},
    [SKD_REQUEST_STROKE_APPLY] = {stroke_fields, skd_check_stroke},
    [SKD_REQUEST_PINS_LIST] = {session_fields, NULL},
    [SKD_REQUEST_PINS_GET] = {layer_fields, NULL},
    [SKD_REQUEST_PINS_WEIGH] = {pins_weigh_fields, NULL},
    [SKD_REQUEST_PINS_CLEAR] = {pins_clear_fields, NULL},
    [SKD_REQUEST_PINS_SOLVE] = {pins_solve_fields, skd_check_pins_solve},
    [SKD_REQUEST_GUARD_SET] = {guard_set_fields, NULL},
    [SKD_REQUEST_GUARD_GET] = {session_fields, NULL},
    [SKD_REQUEST_SHAPES_LIST] = {session_fields, NULL},
    [SKD_REQUEST_SHAPES_GET] = {layer_fields, NULL},
    [SKD_REQUEST_SESSION_REFIT] = {refit_fields, skd_check_refit},
    [SKD_REQUEST_WEIGHTS_GET] = {weights_get_fields, NULL},
    [SKD_REQUEST_WEIGHTS_SET] = {weights_set_fields, skd_check_weights_set},
    [SKD_REQUEST_WEIGHTS_MIRROR] = {weights_mirror_fields, NULL},
    [SKD_REQUEST_WEIGHTS_PRUNE] = {weights_prune_fields, NULL},
    [SKD_REQUEST_WEIGHTS_REDUCE] = {weights_reduce_fields, skd_check_weights_reduce},
    [SKD_REQUEST_HISTORY_UNDO] = {history_fields, NULL},
    [SKD_REQUEST_HISTORY_REDO] = {history_fields, NULL},
    [SKD_REQUEST_STATS] = {no_fields, NULL},
    [SKD_REQUEST_SHUTDOWN] = {no_fields, NULL},
};

/* Whether a request changes a session by a step, and so may have a number of its own. */
static bool has_sequence(enum skd_request_method method)
{
    switch (method) {
    case SKD_REQUEST_STROKE_APPLY:
    case SKD_REQUEST_PINS_SOLVE:
    case SKD_REQUEST_SESSION_REFIT:
    case SKD_REQUEST_WEIGHTS_SET:
    case SKD_REQUEST_WEIGHTS_MIRROR:
    case SKD_REQUEST_WEIGHTS_PRUNE:
    case SKD_REQUEST_WEIGHTS_REDUCE:
    case SKD_REQUEST_PINS_WEIGH:
    case SKD_REQUEST_PINS_CLEAR:
    case SKD_REQUEST_HISTORY_UNDO:
    case SKD_REQUEST_HISTORY_REDO:
        return true;
    default:
        return false;
    }
}

static enum skd_status read_sequence(struct skd_request *request, struct skd_error *error)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(request->message.params, "sequence");
    if (item == NULL || !has_sequence(request->method))
        return SKD_OK;
    double number = cJSON_IsNumber(item) ? item->valuedouble : 0;
    if (!(number >= 1 && number <= SKD_SEQUENCE_MAX) || number != floor(number))
        return skd_fail(error, SKD_BAD_PARAMS, "%s: sequence must be a whole number from 1 to 2^53",
                        request->message.method);
    request->sequence = (uint64_t)number;
    return SKD_OK;
}

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
    status = read_sequence(request, error);
    if (status == SKD_OK)
        status = skd_fields_read(request, request->message.params, methods[request->method].fields,
                                 error);
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
