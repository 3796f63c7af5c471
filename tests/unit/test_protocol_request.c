/* Requests as values: each method's parameters, defaults, limits and sentences; arrays from
 * buffers and from plain JSON. */
#include "request_helpers.h"

#include <math.h>

static void test_names_are_all_known(void **state)
{
    (void)state;
    static const char *const wires[] = {
#define WIRE(name, wire) wire,
        SKD_REQUESTS(WIRE)
#undef WIRE
    };
    assert_int_equal(sizeof wires / sizeof wires[0], SKD_REQUEST_METHOD_COUNT);
    for (int i = 0; i < SKD_REQUEST_METHOD_COUNT; i++) {
        struct skd_request request;
        struct skd_error error;
        enum skd_status status = decode_with(&request, &error, wires[i], "{}", "", NULL, 0);
        assert_string_equal(skd_request_method_name((enum skd_request_method)i), wires[i]);
        /* Whatever is missing in {}, the method is found. */
        assert_int_equal(request.method, i);
        assert_true(status == SKD_OK || status == SKD_BAD_PARAMS);
        skd_request_finish(&request);
    }
}

static void test_stroke_defaults(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "stroke.apply",
                            "{\"session\":\"a\",\"pose\":\"rest\",\"vertices\":[5,0,4294967295],"
                            "\"positions\":[[1,2,3],[0.1,-0.0,1e-40],[3.4028234e38,1e2,7]],"
                            "\"colour\":\"unknown members are ignored\"}"),
                     SKD_OK);
    const struct skd_stroke_params *stroke = &request.params.stroke;
    const uint32_t *vertices = stroke->vertices.data;
    const float *positions = stroke->positions.data;
    assert_string_equal(stroke->session, "a");
    assert_string_equal(stroke->pose, "rest");
    assert_int_equal(stroke->vertices.rows, 3);
    assert_int_equal(stroke->positions.rows, 3);
    assert_int_equal(stroke->positions.count, 9);
    assert_int_equal(vertices[0], 5);
    assert_int_equal(vertices[2], UINT32_MAX);
    assert_true(positions[3] == 0.1f && signbit(positions[4]) && positions[5] == 1e-40f);
    assert_true(positions[6] == 3.4028234e38f && positions[8] == 7.0f);
    assert_true(stroke->stream);
    assert_string_equal(skd_method_words[stroke->method], "exact");
    assert_string_equal(skd_constraint_words[stroke->constraint], "simplex");
    assert_true(isnan(stroke->stiffness));
    assert_string_equal(skd_pin_words[stroke->pin], "set");
    assert_string_equal(skd_slots_words[stroke->slots], "keep");
    assert_string_equal(skd_residual_words[stroke->residual], "report");
    assert_true(stroke->guard == 0.3 && stroke->smooth == 0 && stroke->mix == 1);
    assert_null(stroke->mask.data);
    assert_true(stroke->thesis_k == 0.05);
    assert_true(stroke->thesis_h == 1.2);
    assert_int_equal(stroke->locked_bone_count, 0);
    assert_null(stroke->locked_vertices.data);
    skd_request_finish(&request);
}

static void test_stroke_options(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(
        decode(&request, "stroke.apply",
               "{\"session\":\"a\",\"pose\":\"p\",\"vertices\":[],\"positions\":[],"
               "\"stream\":false,\"method\":\"thesis\",\"constraint\":\"affine\",\"stiffness\":10,"
               "\"thesis_k\":1e-300,\"thesis_h\":0,\"locked_bones\":[\"hip\",\"\"],"
               "\"locked_vertices\":[1]}"),
        SKD_OK);
    const struct skd_stroke_params *stroke = &request.params.stroke;
    assert_false(stroke->stream);
    assert_string_equal(skd_method_words[stroke->method], "thesis");
    assert_string_equal(skd_constraint_words[stroke->constraint], "affine");
    assert_true(stroke->stiffness == 10 && stroke->thesis_k == 1e-300 && stroke->thesis_h == 0);
    assert_int_equal(stroke->locked_bone_count, 2);
    assert_string_equal(stroke->locked_bones[0], "hip");
    assert_int_equal(stroke->locked_vertices.count, 1);
    /* An empty list was given; that differs from none. */
    assert_non_null(stroke->vertices.data);
    assert_int_equal(stroke->vertices.count, 0);
    skd_request_finish(&request);
}

static void test_stroke_of_every_pose(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "stroke.apply",
                            "{\"session\":\"a\",\"pose\":\"p\",\"vertices\":[1,2],"
                            "\"positions\":[1,2,3,4,5,6],\"pin\":\"move\","
                            "\"slots\":\"evidence\",\"guard\":1000,\"smooth\":10,\"mix\":0,"
                            "\"mask\":[0,0.5],\"residual\":\"shape\"}"),
                     SKD_OK);
    const struct skd_stroke_params *stroke = &request.params.stroke;
    assert_string_equal(skd_pin_words[stroke->pin], "move");
    assert_string_equal(skd_slots_words[stroke->slots], "evidence");
    assert_string_equal(skd_residual_words[stroke->residual], "shape");
    assert_true(stroke->guard == 1000 && stroke->smooth == 10 && stroke->mix == 0);
    assert_int_equal(stroke->mask.rows, 2);
    assert_true(((const float *)stroke->mask.data)[1] == 0.5f);
    skd_request_finish(&request);
    /* The thesis's method takes what leaves it as it is. */
    assert_int_equal(decode(&request, "stroke.apply",
                            "{\"session\":\"a\",\"pose\":\"p\",\"vertices\":[],"
                            "\"positions\":[],\"method\":\"thesis\",\"slots\":\"keep\","
                            "\"guard\":0,\"smooth\":0,\"mix\":1,\"pin\":\"none\","
                            "\"residual\":\"report\"}"),
                     SKD_OK);
    assert_string_equal(skd_pin_words[request.params.stroke.pin], "none");
    skd_request_finish(&request);
}

static void test_pins(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "pins.solve", "{\"session\":\"a\",\"pose\":\"p\"}"), SKD_OK);
    assert_false(request.params.stroke.vertices_given);
    assert_true(isnan(request.params.stroke.stiffness) && request.params.stroke.stream);
    assert_true(request.params.stroke.guard == 0.3 && request.params.stroke.mix == 1);
    assert_string_equal(skd_pin_words[request.params.stroke.pin], "none");
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "pins.weigh",
                            "{\"session\":\"a\",\"pose\":\"p\",\"weight\":1000,\"vertices\":[]}"),
                     SKD_OK);
    assert_true(request.params.pins.weight == 1000 && request.params.pins.vertices_given);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "pins.clear", "{\"session\":\"a\"}"), SKD_OK);
    assert_null(request.params.pins.pose);
    assert_false(request.params.pins.vertices_given);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "shapes.get", "{\"session\":\"a\",\"pose\":\"p\"}"), SKD_OK);
    assert_string_equal(request.params.pins.pose, "p");
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "pins.list", "{\"session\":\"a\"}"), SKD_OK);
    assert_string_equal(request.params.session.session, "a");
    skd_request_finish(&request);
}

static void test_guard(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "guard.set", "{\"session\":\"a\"}"), SKD_OK);
    const struct skd_guard_set_params *guard = &request.params.guard_set;
    assert_true(guard->poses == NULL && guard->clips == NULL && guard->matrices.data == NULL);
    assert_int_equal(guard->count, 8);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "guard.set",
                            "{\"session\":\"a\",\"poses\":[],\"clips\":[\"walk\",\"run\"],"
                            "\"matrices\":[],\"count\":64}"),
                     SKD_OK);
    assert_true(guard->poses != NULL && guard->pose_count == 0);
    assert_int_equal(guard->clip_count, 2);
    assert_string_equal(guard->clips[1], "run");
    assert_non_null(guard->matrices.data);
    assert_int_equal(guard->count, 64);
    skd_request_finish(&request);
}

static void test_edits(void **state)
{
    (void)state;
    struct skd_request request;
    const struct skd_weights_edit_params *edit = &request.params.weights_edit;
    assert_int_equal(decode(&request, "weights.mirror", "{\"session\":\"a\"}"), SKD_OK);
    assert_string_equal(skd_axis_words[edit->axis], "x");
    assert_string_equal(skd_side_words[edit->from], "+");
    assert_true(edit->origin == 0 && edit->tolerance == 1e-3 && !edit->vertices_given);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "weights.mirror",
                            "{\"session\":\"a\",\"axis\":\"z\",\"from\":\"-\",\"origin\":-2.5,"
                            "\"tolerance\":0,\"vertices\":[7]}"),
                     SKD_OK);
    assert_int_equal(edit->axis, 2);
    assert_string_equal(skd_side_words[edit->from], "-");
    assert_true(edit->origin == -2.5 && edit->tolerance == 0 && edit->vertices.rows == 1);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "weights.prune", "{\"session\":\"a\"}"), SKD_OK);
    assert_true(edit->below == 0.01);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "weights.reduce", "{\"session\":\"a\",\"influences\":1}"),
                     SKD_OK);
    assert_true(edit->influences == 1 && edit->by == SKD_REDUCE_BY_POSES && edit->poses == NULL);
    skd_request_finish(&request);
    assert_int_equal(
        decode(&request, "weights.reduce", "{\"session\":\"a\",\"influences\":8,\"by\":\"size\"}"),
        SKD_OK);
    assert_int_equal(edit->by, SKD_REDUCE_BY_SIZE);
    skd_request_finish(&request);
}

static void test_refit(void **state)
{
    (void)state;
    struct skd_request request;
    const struct skd_stroke_params *refit = &request.params.stroke;
    assert_int_equal(decode(&request, "session.refit",
                            "{\"session\":\"a\",\"poses\":[\"p\",\"q\"],"
                            "\"positions\":[1,2,3,4,5,6]}"),
                     SKD_OK);
    assert_int_equal(refit->pose_count, 2);
    assert_string_equal(refit->poses[1], "q");
    assert_int_equal(refit->positions.rows, 2);
    assert_string_equal(skd_slots_words[refit->slots], "evidence");
    assert_int_equal(refit->rounds, 3);
    assert_true(isnan(refit->stiffness) && refit->guard == 0 && refit->mix == 1);
    skd_request_finish(&request);
    /* One name more than a refit may have. */
    static char params[8 * SKD_TARGET_POSES_MAX + 256];
    for (int count = SKD_TARGET_POSES_MAX; count <= SKD_TARGET_POSES_MAX + 1; count++) {
        int used =
            snprintf(params, sizeof params, "{\"session\":\"a\",\"positions\":[],\"poses\":[\"p\"");
        for (int i = 1; i < count; i++)
            used += snprintf(params + used, sizeof params - (size_t)used, ",\"p\"");
        (void)snprintf(params + used, sizeof params - (size_t)used, "]}");
        assert_int_equal(decode(&request, "session.refit", params),
                         count <= SKD_TARGET_POSES_MAX ? SKD_OK : SKD_BAD_PARAMS);
        skd_request_finish(&request);
    }
}

#define STROKE "\"session\":\"a\",\"pose\":\"p\",\"vertices\":[1],\"positions\":[[1,2,3]]"
#define RIG                                                                                        \
    "\"positions\":[0,0,0],\"triangles\":[],\"bones\":{\"parents\":[-1],\"binds\":"                \
    "[[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]]},\"influence_offsets\":[0,1],"                         \
    "\"influence_joints\":[0],\"influence_weights\":[1]"

#define SET "\"session\":\"a\",\"vertices\":[1],\"weights\":[[1,0,0,0]]"

/* What is refused, with which code, and words that the sentence must hold. */
static const struct refusal refused[] = {
    {"nosuch", "{}", SKD_UNKNOWN_METHOD, "\"nosuch\""},
    {"Ping", "{}", SKD_UNKNOWN_METHOD, "\"Ping\""},
    {"hello", "{}", SKD_BAD_PARAMS, "hello: protocol is missing"},
    {"hello", "{\"protocol\":1}", SKD_BAD_PARAMS, "protocol is not an object"},
    {"hello", "{\"protocol\":{\"min\":1}}", SKD_BAD_PARAMS, "max is missing"},
    {"hello", "{\"protocol\":{\"min\":2,\"max\":1}}", SKD_BAD_PARAMS, "protocol.min is 2"},
    {"hello", "{\"protocol\":{\"min\":1.5,\"max\":2}}", SKD_BAD_PARAMS, "min is not a whole"},
    {"hello", "{\"protocol\":{\"min\":-1,\"max\":2}}", SKD_BAD_PARAMS, "min is -1"},
    {"hello", "{\"protocol\":{\"min\":1,\"max\":3e9}}", SKD_BAD_PARAMS, "max is 3e+09"},
    {"hello", "{\"protocol\":{\"min\":1,\"max\":1},\"client\":{\"name\":4}}", SKD_BAD_PARAMS,
     "name is not a string"},
    {"cancel", "{}", SKD_BAD_PARAMS, "cancel: id is missing"},
    {"cancel", "{\"id\":1.5}", SKD_BAD_PARAMS, "id is not the id of a request"},
    {"session.create", "{}", SKD_BAD_PARAMS, "positions is missing; give file, or"},
    {"session.create", "{\"file\":\"a.glb\"}", SKD_BAD_PARAMS, "file is not an absolute path"},
    {"session.create", "{\"file\":\"\"}", SKD_BAD_PARAMS, "file has 0 bytes"},
    {"session.create", "{\"file\":\"/a\",\"influences\":5}", SKD_BAD_PARAMS, "it is 4 or 8"},
    {"session.create", "{\"file\":\"/a\",\"influences\":16}", SKD_BAD_PARAMS, "it may be 4 to 8"},
    {"session.create", "{\"file\":\"/a\",\"fill\":\"all\"}", SKD_BAD_PARAMS,
     "fill is not one of hop, infect, neighbours, none"},
    {"session.create", "{\"file\":\"/a\",\"reduce\":true}", SKD_BAD_PARAMS,
     "reduce is not one of refuse, largest, posed"},
    {"session.create", "{\"file\":\"/a\",\"name\":\"a/b\"}", SKD_BAD_PARAMS, "name is \"a/b\""},
    {"session.create", "{\"file\":\"/a\",\"name\":\".a\"}", SKD_BAD_PARAMS, "does not begin"},
    {"session.create", "{\"file\":\"/a\",\"name\":\"\"}", SKD_BAD_PARAMS, "name has 0 bytes"},
    {"session.create", "{\"file\":\"/a\",\"positions\":[]}", SKD_BAD_PARAMS, "give one of them"},
    {"session.create", "{\"file\":\"/a\"," RIG "}", SKD_BAD_PARAMS, "give one of them"},
    {"session.create", "{\"positions\":[0,0,0]}", SKD_BAD_PARAMS, "triangles is missing"},
    {"session.create", "{\"bones\":{\"parents\":[]}}", SKD_BAD_PARAMS, "binds is missing"},
    {"session.create", "{\"bones\":[]}", SKD_BAD_PARAMS, "bones is not an object"},
    {"session.info", "{}", SKD_BAD_PARAMS, "session.info: session is missing"},
    {"session.info", "{\"session\":7}", SKD_BAD_PARAMS, "session is not a string"},
    {"session.attach", "{\"session\":\"a\",\"revision\":-1}", SKD_BAD_PARAMS,
     "revision is -1; it must not be below 0"},
    {"session.attach", "{\"session\":\"a\",\"revision\":0.5}", SKD_BAD_PARAMS, "whole number"},
    {"session.export", "{\"session\":\"a\",\"path\":\"b\"}", SKD_BAD_PARAMS, "begin it with '/'"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"\",\"clip\":\"c\",\"time\":0}", SKD_BAD_PARAMS,
     "pose has 0 bytes"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"p\"}", SKD_BAD_PARAMS, "clip and time"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"p\",\"clip\":\"c\"}", SKD_BAD_PARAMS, "clip and"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"p\",\"time\":1}", SKD_BAD_PARAMS, "clip and"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"p\",\"time\":1,\"matrices\":[]}", SKD_BAD_PARAMS,
     "clip and"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"p\",\"clip\":\"c\",\"time\":1,\"matrices\":[]}",
     SKD_BAD_PARAMS, "give one of"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"p\",\"clip\":\"c\",\"time\":1e999}", SKD_NOT_FINITE,
     "time is not finite"},
    {"pose.set", "{\"session\":\"a\",\"pose\":\"p\",\"matrices\":[1,2,3]}", SKD_BAD_PARAMS,
     "rows of 16 numbers"},
    {"pose.evaluate", "{\"session\":\"a\",\"pose\":\"p\",\"vertices\":7}", SKD_BAD_PARAMS,
     "vertices is not a flat list"},
    {"stroke.apply", "{\"session\":\"a\",\"pose\":\"p\",\"vertices\":[1]}", SKD_BAD_PARAMS,
     "stroke.apply: positions is missing"},
    {"stroke.apply",
     "{\"session\":\"a\",\"pose\":\"p\",\"vertices\":[1,2],\"positions\":[[1,2,3]]}",
     SKD_COUNT_MISMATCH,
     "stroke.apply: positions has 1 rows but vertices has 2; send one position a vertex"},
    {"stroke.apply", "{" STROKE ",\"stream\":1}", SKD_BAD_PARAMS, "neither true nor false"},
    {"stroke.apply", "{" STROKE ",\"method\":\"magic\"}", SKD_BAD_PARAMS, "exact, thesis"},
    {"stroke.apply", "{" STROKE ",\"constraint\":0}", SKD_BAD_PARAMS, "simplex, affine"},
    {"stroke.apply", "{" STROKE ",\"stiffness\":-0.001}", SKD_BAD_PARAMS, "it may be 0 to 10"},
    {"stroke.apply", "{" STROKE ",\"stiffness\":10.001}", SKD_BAD_PARAMS, "stiffness is 10.001"},
    {"stroke.apply", "{" STROKE ",\"stiffness\":1e999}", SKD_NOT_FINITE, "stiffness"},
    {"stroke.apply", "{" STROKE ",\"stiffness\":null}", SKD_BAD_PARAMS, "not a number"},
    {"stroke.apply", "{" STROKE ",\"thesis_k\":0}", SKD_BAD_PARAMS, "must be above 0"},
    {"stroke.apply", "{" STROKE ",\"thesis_h\":-1}", SKD_BAD_PARAMS, "must not be below 0"},
    {"stroke.apply", "{" STROKE ",\"locked_bones\":\"hip\"}", SKD_BAD_PARAMS, "list of strings"},
    {"stroke.apply", "{" STROKE ",\"locked_bones\":[1]}", SKD_BAD_PARAMS, "list of strings"},
    {"stroke.apply", "{" STROKE ",\"locked_vertices\":[[1]]}", SKD_BAD_PARAMS, "flat list"},
    {"stroke.apply", "{" STROKE ",\"pin\":\"keep\"}", SKD_BAD_PARAMS, "set, move, none"},
    {"stroke.apply", "{" STROKE ",\"slots\":\"all\"}", SKD_BAD_PARAMS, "keep, evidence"},
    {"stroke.apply", "{" STROKE ",\"residual\":1}", SKD_BAD_PARAMS, "report, rest, shape"},
    {"stroke.apply", "{" STROKE ",\"guard\":1001}", SKD_BAD_PARAMS, "it may be 0 to 1000"},
    {"stroke.apply", "{" STROKE ",\"smooth\":-1}", SKD_BAD_PARAMS, "smooth is -1"},
    {"stroke.apply", "{" STROKE ",\"mix\":1.5}", SKD_BAD_PARAMS, "it may be 0 to 1"},
    {"stroke.apply", "{" STROKE ",\"mask\":[1,1]}", SKD_COUNT_MISMATCH,
     "mask has 2 numbers but vertices has 1; send one a vertex, or no mask"},
    {"stroke.apply", "{" STROKE ",\"mask\":[]}", SKD_COUNT_MISMATCH, "mask has 0 numbers"},
    {"stroke.apply", "{" STROKE ",\"method\":\"thesis\",\"pin\":\"move\"}", SKD_UNSUPPORTED,
     "knows no pin \"move\"; use the method \"exact\""},
    {"stroke.apply", "{" STROKE ",\"method\":\"thesis\",\"slots\":\"evidence\"}", SKD_UNSUPPORTED,
     "knows no slots"},
    {"stroke.apply", "{" STROKE ",\"method\":\"thesis\",\"guard\":0.3}", SKD_UNSUPPORTED,
     "knows no guard"},
    {"stroke.apply", "{" STROKE ",\"method\":\"thesis\",\"smooth\":0.1}", SKD_UNSUPPORTED,
     "knows no smooth"},
    {"stroke.apply", "{" STROKE ",\"method\":\"thesis\",\"mix\":0.1}", SKD_UNSUPPORTED,
     "knows no mix"},
    {"stroke.apply", "{" STROKE ",\"method\":\"thesis\",\"mask\":[1]}", SKD_UNSUPPORTED,
     "knows no mask"},
    {"stroke.apply", "{" STROKE ",\"method\":\"thesis\",\"residual\":\"rest\"}", SKD_UNSUPPORTED,
     "knows no residual"},
    {"weights.set", "{" SET ",\"joints\":[[1,2,3,4],[1,2,3,4]]}", SKD_COUNT_MISMATCH,
     "joints has 8 numbers but weights has 4"},
    {"weights.set", "{" SET ",\"joints\":[1,2,3]}", SKD_COUNT_MISMATCH, "joints has 3"},
    {"weights.set", "{" SET ",\"rest\":[]}", SKD_COUNT_MISMATCH, "rest has 0 rows"},
    {"weights.set", "{" SET ",\"shape\":\"p\"}", SKD_BAD_PARAMS, "shape and offsets go together"},
    {"weights.set", "{" SET ",\"offsets\":[1,2,3]}", SKD_BAD_PARAMS, "go together"},
    {"weights.set", "{" SET ",\"shape\":\"p\",\"offsets\":[1,2,3,4,5,6]}", SKD_COUNT_MISMATCH,
     "offsets has 2 rows"},
    {"pins.weigh", "{\"session\":\"a\",\"pose\":\"p\"}", SKD_BAD_PARAMS, "weight is missing"},
    {"pins.weigh", "{\"session\":\"a\",\"pose\":\"p\",\"weight\":-1}", SKD_BAD_PARAMS,
     "it may be 0 to 1000"},
    {"pins.get", "{\"session\":\"a\"}", SKD_BAD_PARAMS, "pins.get: pose is missing"},
    {"pins.clear", "{\"session\":\"a\",\"pose\":\"\"}", SKD_BAD_PARAMS, "pose has 0 bytes"},
    {"guard.set", "{\"session\":\"a\",\"count\":65}", SKD_BAD_PARAMS, "it may be 1 to 64"},
    {"guard.set", "{\"session\":\"a\",\"clips\":\"walk\"}", SKD_BAD_PARAMS, "list of strings"},
    {"session.refit", "{\"session\":\"a\",\"poses\":[],\"positions\":[]}", SKD_BAD_PARAMS,
     "poses has 0 names; it may have 1 to 256"},
    {"session.refit", "{\"session\":\"a\",\"poses\":[\"p\",\"q\"],\"positions\":[1,2,3]}",
     SKD_COUNT_MISMATCH,
     "positions has 1 rows for 2 poses; send one position a vertex for each pose"},
    {"session.refit", "{\"session\":\"a\",\"poses\":[\"p\"],\"positions\":[],\"rounds\":17}",
     SKD_BAD_PARAMS, "it may be 1 to 16"},
    {"weights.mirror", "{\"session\":\"a\",\"axis\":0}", SKD_BAD_PARAMS, "x, y, z"},
    {"weights.mirror", "{\"session\":\"a\",\"from\":\"left\"}", SKD_BAD_PARAMS, "not one of +, -"},
    {"weights.prune", "{\"session\":\"a\",\"below\":2}", SKD_BAD_PARAMS, "it may be 0 to 1"},
    {"weights.reduce", "{\"session\":\"a\"}", SKD_BAD_PARAMS, "influences is missing"},
    {"weights.reduce", "{\"session\":\"a\",\"influences\":9}", SKD_BAD_PARAMS, "it may be 1 to 8"},
    {"weights.reduce", "{\"session\":\"a\",\"influences\":4,\"by\":\"size\",\"poses\":[\"p\"]}",
     SKD_BAD_PARAMS, "poses have no say when it goes by \"size\""},
};

static void test_what_is_refused(void **state)
{
    (void)state;
    check_refused(refused, sizeof refused / sizeof *refused);
}

/* Replaces `from` by `to` in RIG and decodes. */
static enum skd_status decode_rig(const char *from, const char *to)
{
    struct skd_request request;
    struct skd_error error;
    char params[1024];
    static const char rig[] = "{" RIG "}";
    const char *at = strstr(rig, from);
    assert_non_null(at);
    (void)snprintf(params, sizeof params, "%.*s%s%s", (int)(at - rig), rig, to, at + strlen(from));
    enum skd_status status = decode_with(&request, &error, "session.create", params, "", NULL, 0);
    skd_request_finish(&request);
    return status;
}

static void test_rig_arrays(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "session.create",
                            "{\"influences\":8,\"fill\":\"none\"," RIG ",\"reduce\":\"largest\"}"),
                     SKD_OK);
    const struct skd_session_create_params *rig = &request.params.session_create;
    assert_null(rig->name);
    assert_null(rig->file);
    assert_null(rig->bone_names);
    assert_int_equal(rig->influences, 8);
    assert_string_equal(skd_fill_words[rig->fill], "none");
    assert_int_equal(rig->reduce, SKD_REDUCE_LARGEST);
    assert_int_equal(rig->positions.rows, 1);
    assert_int_equal(((const int32_t *)rig->bone_parents.data)[0], -1);
    assert_int_equal(rig->bone_binds.rows, 1);
    assert_true(((const double *)rig->bone_binds.data)[15] == 1);
    skd_request_finish(&request);

    assert_int_equal(
        decode(&request, "session.create", "{\"file\":\"/a b.glb\",\"name\":\"A-z.0_\"}"), SKD_OK);
    assert_string_equal(request.params.session_create.file, "/a b.glb");
    assert_string_equal(request.params.session_create.name, "A-z.0_");
    assert_int_equal(request.params.session_create.influences, 4);
    assert_string_equal(skd_fill_words[request.params.session_create.fill], "neighbours");
    assert_int_equal(request.params.session_create.reduce, SKD_REDUCE_REFUSE);
    skd_request_finish(&request);

    assert_int_equal(decode_rig("[0,1]", "[0,1]"), SKD_OK);
    assert_int_equal(decode_rig("[0,1]", "[0]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_rig("[0,1]", "[0,1,1]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_rig("\"influence_weights\":[1]", "\"influence_weights\":[]"),
                     SKD_COUNT_MISMATCH);
    assert_int_equal(decode_rig("[-1]", "[-1,0]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_rig("[-1]", "[-1],\"names\":[\"hip\"]"), SKD_OK);
    assert_int_equal(decode_rig("[-1]", "[-1],\"names\":[]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_rig("[-1]", "[-1],\"names\":[\"hip\",\"knee\"]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_rig("\"influence_joints\":[0]", "\"influence_joints\":[65535]"),
                     SKD_OK);
    assert_int_equal(decode_rig("\"influence_joints\":[0]", "\"influence_joints\":[65536]"),
                     SKD_BAD_PARAMS);
    /* A matrix may be written as its rows, and then wholly so. */
    static const char flat[] = "[[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]]";
    assert_int_equal(decode_rig(flat, "[[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]"), SKD_OK);
    assert_int_equal(decode_rig(flat, "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]"), SKD_OK);
    assert_int_equal(decode_rig(flat, "[[[1,0,0,0],0,1,0,0,[0,0,1,0],[0,0,0,1]]]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_rig(flat, "[[[1,0,0],[0,0,1,0,0],[0,0,1,0],[0,0,0,1]]]"),
                     SKD_BAD_PARAMS);
}

/* positions as plain JSON. */
static enum skd_status decode_positions(const char *positions, size_t *rows)
{
    struct skd_request request;
    struct skd_error error;
    char params[512];
    (void)snprintf(params, sizeof params, "{\"positions\":%s,\"triangles\":[]}", positions);
    enum skd_status status = decode_with(&request, &error, "session.create", params, "", NULL, 0);
    *rows = request.params.session_create.positions.rows;
    /* What follows positions is missing in any case. */
    if (status == SKD_BAD_PARAMS && strstr(error.text, "bones is missing") != NULL)
        status = SKD_OK;
    skd_request_finish(&request);
    return status;
}

static enum skd_status decode_set(const char *vertices, const char *weights)
{
    struct skd_request request;
    char params[256];
    (void)snprintf(params, sizeof params, "{\"session\":\"a\",\"vertices\":%s,\"weights\":%s}",
                   vertices, weights);
    enum skd_status status = decode(&request, "weights.set", params);
    skd_request_finish(&request);
    return status;
}

/* Rows of 4 or of 8, which only the session can tell apart where the list is flat. */
static void test_rows_of_slots(void **state)
{
    (void)state;
    assert_int_equal(decode_set("[3]", "[[0,1,0,0]]"), SKD_OK);
    assert_int_equal(decode_set("[3]", "[[0,1,0,0,0,0,0,0]]"), SKD_OK);
    assert_int_equal(decode_set("[3]", "[0,1,0,0]"), SKD_OK);
    assert_int_equal(decode_set("[3]", "[0,1,0,0,0,0,0,0]"), SKD_OK);
    assert_int_equal(decode_set("[3,4]", "[0,1,0,0,0,0,0,1]"), SKD_OK);
    assert_int_equal(decode_set("[]", "[]"), SKD_OK);
    assert_int_equal(decode_set("[3,4]", "[0,1,0,0]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set("[3]", "[0,1,0,0,0]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set("[3]", "[]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set("[]", "[0,1,0,0]"), SKD_COUNT_MISMATCH);
    /* One row of 8 is not two of 4. */
    assert_int_equal(decode_set("[3,4]", "[[0,1,0,0,0,0,0,1]]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set("[3]", "[[0,1,0]]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_set("[3]", "[[]]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_set("[3,4]", "[[0,1,0,0],[0,1,0,0,0,0,0,0]]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_set("[3]", "{\"buffer\":0}"), SKD_BAD_PARAMS);
    assert_int_equal(decode_set("[3]", "[[0,1,0,1e39]]"), SKD_NOT_FINITE);
}

static void test_arrays_as_json(void **state)
{
    (void)state;
    size_t rows;
    assert_int_equal(decode_positions("[]", &rows), SKD_OK);
    assert_int_equal(rows, 0);
    assert_int_equal(decode_positions("[1,2,3,4,5,6]", &rows), SKD_OK);
    assert_int_equal(rows, 2);
    assert_int_equal(decode_positions("[[1,2,3],[4,5,6],[7,8,9]]", &rows), SKD_OK);
    assert_int_equal(rows, 3);
    assert_int_equal(decode_positions("[1,2,3,4]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[[1,2,3],4,5,6]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[1,2,[3]]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[[1,2]]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[[1,2,3,4],[5,6]]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[[1,2,3],[4,5,6,7]]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[[[1],2,3]]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[{\"x\":1,\"y\":2,\"z\":3}]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("{\"x\":[1,2,3]}", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("\"abc\"", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("null", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[1,2,\"3\"]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[1,2,true]", &rows), SKD_BAD_PARAMS);
    assert_int_equal(decode_positions("[1,2,null]", &rows), SKD_NOT_FINITE);
    assert_int_equal(decode_positions("[1,2,1e39]", &rows), SKD_NOT_FINITE);
    assert_int_equal(decode_positions("[1,2,-1e999]", &rows), SKD_NOT_FINITE);
    assert_int_equal(decode_positions("{\"buffer\":0}", &rows), SKD_BAD_PARAMS);
}

static enum skd_status decode_vertices(const char *vertices)
{
    struct skd_request request;
    struct skd_error error;
    char params[256];
    (void)snprintf(params, sizeof params, "{\"session\":\"a\",\"vertices\":%s}", vertices);
    enum skd_status status = decode_with(&request, &error, "weights.get", params, "", NULL, 0);
    if (status == SKD_OK)
        assert_true(request.params.shown.vertices_given);
    skd_request_finish(&request);
    return status;
}

static void test_whole_numbers_as_json(void **state)
{
    (void)state;
    assert_int_equal(decode_vertices("[0,4294967295,-0.0,1e3]"), SKD_OK);
    assert_int_equal(decode_vertices("[]"), SKD_OK);
    assert_int_equal(decode_vertices("[4294967296]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_vertices("[-1]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_vertices("[0.5]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_vertices("[1e999]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_vertices("[null]"), SKD_BAD_PARAMS);
    struct skd_request request;
    assert_int_equal(decode(&request, "weights.get", "{\"session\":\"a\"}"), SKD_OK);
    assert_false(request.params.shown.vertices_given);
    skd_request_finish(&request);
}

/* weights.get with vertices, and pose.set with matrices, out of a tail of 256 bytes. */
static enum skd_status decode_buffer(const char *method, const char *params, const char *dtype,
                                     const char *shape, struct skd_request *request)
{
    unsigned char tail[256];
    struct skd_error error;
    char members[128];
    for (size_t i = 0; i < sizeof tail; i++)
        tail[i] = (unsigned char)i;
    (void)snprintf(members, sizeof members,
                   ",\"buffers\":[{\"dtype\":\"%s\",\"shape\":%s,\"offset\":0}]", dtype, shape);
    return decode_with(request, &error, method, params, members, tail, sizeof tail);
}

static void check_vertices(const char *index, const char *dtype, const char *shape,
                           enum skd_status expected)
{
    struct skd_request request;
    char params[64];
    (void)snprintf(params, sizeof params, "{\"session\":\"a\",\"vertices\":{\"buffer\":%s}}",
                   index);
    assert_int_equal(decode_buffer("weights.get", params, dtype, shape, &request), expected);
    if (expected == SKD_OK) {
        /* No copy: the data lies in the frame's tail. */
        assert_ptr_equal(request.params.shown.vertices.data, request.message.frame.tail);
        assert_int_equal(request.owned_count, 0);
    }
    skd_request_finish(&request);
}

static void check_matrices(const char *shape, enum skd_status expected, size_t rows)
{
    struct skd_request request;
    static const char params[] = "{\"session\":\"a\",\"pose\":\"p\",\"matrices\":{\"buffer\":0}}";
    assert_int_equal(decode_buffer("pose.set", params, "f64", shape, &request), expected);
    if (expected == SKD_OK)
        assert_int_equal(request.params.pose_set.matrices.rows, rows);
    skd_request_finish(&request);
}

static void test_arrays_as_buffers(void **state)
{
    (void)state;
    check_vertices("0", "u32", "[64]", SKD_OK);
    check_vertices("0", "i32", "[64]", SKD_BAD_PARAMS);
    check_vertices("0", "f32", "[64]", SKD_BAD_PARAMS);
    check_vertices("0", "u8", "[64]", SKD_BAD_PARAMS);
    check_vertices("0", "u32", "[64,1]", SKD_BAD_PARAMS);
    check_vertices("1", "u32", "[64]", SKD_BAD_PARAMS);
    check_vertices("-1", "u32", "[64]", SKD_BAD_PARAMS);
    check_vertices("0.5", "u32", "[64]", SKD_BAD_PARAMS);
    check_vertices("1e300", "u32", "[64]", SKD_BAD_PARAMS);
    check_vertices("\"0\"", "u32", "[64]", SKD_BAD_PARAMS);
    check_matrices("[2,4,4]", SKD_OK, 2);
    check_matrices("[2,16]", SKD_OK, 2);
    check_matrices("[32]", SKD_OK, 2);
    check_matrices("[0,4,4]", SKD_OK, 0);
    check_matrices("[1,2,8]", SKD_OK, 1);
    check_matrices("[31]", SKD_BAD_PARAMS, 0);
    check_matrices("[4,4]", SKD_BAD_PARAMS, 0);
    check_matrices("[16,1]", SKD_BAD_PARAMS, 0);
    /* No elements, but rows that a reader would believe. */
    check_matrices("[1000000,0]", SKD_BAD_PARAMS, 0);
    check_matrices("[1000000,0,4]", SKD_BAD_PARAMS, 0);
}

static enum skd_status decode_set_buffer(const char *shape)
{
    struct skd_request request;
    static const char params[] =
        "{\"session\":\"a\",\"vertices\":[1,2],\"weights\":{\"buffer\":0}}";
    enum skd_status status = decode_buffer("weights.set", params, "f32", shape, &request);
    skd_request_finish(&request);
    return status;
}

static void test_buffers_of_slots(void **state)
{
    (void)state;
    assert_int_equal(decode_set_buffer("[2,4]"), SKD_OK);
    assert_int_equal(decode_set_buffer("[2,8]"), SKD_OK);
    assert_int_equal(decode_set_buffer("[8]"), SKD_OK);
    assert_int_equal(decode_set_buffer("[16]"), SKD_OK);
    assert_int_equal(decode_set_buffer("[12]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set_buffer("[4,4]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set_buffer("[1,8]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set_buffer("[0,4]"), SKD_COUNT_MISMATCH);
    assert_int_equal(decode_set_buffer("[8,1]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_set_buffer("[2,0]"), SKD_BAD_PARAMS);
    assert_int_equal(decode_set_buffer("[1,2,4]"), SKD_BAD_PARAMS);
}

static void test_lengths_of_strings(void **state)
{
    (void)state;
    check_text_limit("session.info", "\"session\":", 'a', "", SKD_SESSION_NAME_BYTES_MAX);
    check_text_limit("pose.evaluate", "\"session\":\"a\",\"pose\":", 'a', "",
                     SKD_POSE_NAME_BYTES_MAX);
    check_text_limit("session.create", "\"file\":", '/', "", SKD_PATH_BYTES_MAX);
    check_text_limit("session.export", "\"session\":\"a\",\"path\":", '/', "", SKD_PATH_BYTES_MAX);
    check_text_limit("hello", "\"protocol\":{\"min\":1,\"max\":1},\"client\":{\"name\":", 'a', "}",
                     SKD_CLIENT_NAME_BYTES_MAX);
}

static void test_hello_and_cancel(void **state)
{
    (void)state;
    struct skd_request request;
    assert_int_equal(decode(&request, "hello", "{\"protocol\":{\"min\":1,\"max\":3}}"), SKD_OK);
    assert_int_equal(request.params.hello.protocol_min, 1);
    assert_int_equal(request.params.hello.protocol_max, 3);
    assert_string_equal(request.params.hello.client_name, "");
    assert_string_equal(request.params.hello.client_version, "");
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "hello",
                            "{\"protocol\":{\"min\":1,\"max\":1},"
                            "\"client\":{\"name\":\"Bl\\u00e9nder\",\"version\":\"3.4\"}}"),
                     SKD_OK);
    assert_string_equal(request.params.hello.client_name, "Bl\xC3\xA9nder");
    assert_string_equal(request.params.hello.client_version, "3.4");
    assert_string_equal(request.params.hello.client_user, "");
    assert_true(request.params.hello.client_id == NULL && request.params.hello.token == NULL);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "cancel", "{\"id\":\"stroke 5\"}"), SKD_OK);
    assert_int_equal(request.message.id.kind, SKD_ID_NONE);
    assert_string_equal(request.params.cancel.target.text, "stroke 5");
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "session.attach", "{\"session\":\"a\",\"revision\":12}"),
                     SKD_OK);
    assert_true(request.params.session.has_revision && request.params.session.revision == 12);
    assert_null(request.params.session.instance);
    skd_request_finish(&request);
    assert_int_equal(decode(&request, "session.attach", "{\"session\":\"a\"}"), SKD_OK);
    assert_false(request.params.session.has_revision);
    skd_request_finish(&request);
}

static void test_who_is_answered(void **state)
{
    (void)state;
    static const char *const bad[] = {
        "{\"jsonrpc\":\"2.0\",\"method\":\"ping\"}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"cancel\",\"params\":{\"id\":1}}",
        "{\"jsonrpc\":\"2.0\",\"id\":1,\"result\":{}}",
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct skd_frame frame = frame_of(bad[i], strlen(bad[i]), NULL, 0);
        struct skd_request request;
        struct skd_error error;
        assert_int_equal(skd_request_decode(&frame, &request, &error), SKD_BAD_REQUEST);
        skd_request_finish(&request);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_names_are_all_known),
        cmocka_unit_test(test_stroke_defaults),
        cmocka_unit_test(test_stroke_options),
        cmocka_unit_test(test_what_is_refused),
        cmocka_unit_test(test_rig_arrays),
        cmocka_unit_test(test_rows_of_slots),
        cmocka_unit_test(test_arrays_as_json),
        cmocka_unit_test(test_whole_numbers_as_json),
        cmocka_unit_test(test_arrays_as_buffers),
        cmocka_unit_test(test_buffers_of_slots),
        cmocka_unit_test(test_lengths_of_strings),
        cmocka_unit_test(test_hello_and_cancel),
        cmocka_unit_test(test_who_is_answered),
        cmocka_unit_test(test_stroke_of_every_pose),
        cmocka_unit_test(test_pins),
        cmocka_unit_test(test_guard),
        cmocka_unit_test(test_edits),
        cmocka_unit_test(test_refit),
    };
    return cmocka_run_group_tests_name("protocol_request", tests, NULL, NULL);
}
