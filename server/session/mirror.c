/* See mirror.h. */
#include "session/mirror.h"

#include "session/bits.h"
#include "session/bone_pairs.h"
#include "session/nearest.h"
#include "session/row_edit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What is this share of the tolerance away from the plane is on it. */
static const double PLANE_PER_TOLERANCE = 0.01;

/* A bone that begins farther than this share of the mesh's size from the plane has a side. */
static const double OFF_PLANE_PER_SIZE = 0.01;

/* Weights that differ by no more are equal. */
static const float ROUNDING = 2e-7F;

struct mirror {
    struct skd_session *session;
    const struct skd_mirror_input *input;
    double tolerance; /* scene units of bind space */
    struct skd_bone_pairs pairs;
    /* The vertices that are read, one of each ring, a tree for each skin. */
    size_t *firsts;           /* [skins + 1] where each skin's tree begins */
    struct skd_point *points; /* [firsts[skins]] */
    uint8_t *axes;
    struct skd_rows rows; /* what is written */
};

/* The diagonal of the rest positions' bounding box, in bind space as they are. */
static double measure_rest(const struct skd_mesh *mesh)
{
    double square = 0;
    for (size_t axis = 0; axis < 3; axis++) {
        double least = INFINITY, most = -INFINITY;
        for (size_t v = 0; v < mesh->vertex_count; v++) {
            least = fmin(least, (double)mesh->rest[3 * v + axis]);
            most = fmax(most, (double)mesh->rest[3 * v + axis]);
        }
        square += (most - least) * (most - least);
    }
    return sqrt(square);
}

/* Pairs the bones. One that its name gives no side and that begins off the plane is not its own
 * mirror image either: rigs without names have only such. */
static enum skd_status pair_bones(struct mirror *mirror, double size, struct skd_error *error)
{
    const struct skd_skeleton *skeleton = &mirror->session->rig->skeleton;
    const struct skd_mirror_input *input = mirror->input;
    enum skd_status status = skd_bone_pairs_build(skeleton, &mirror->pairs, error);
    for (int bone = 0; bone < skeleton->bone_count && status == SKD_OK; bone++) {
        double off = (double)skeleton->heads[3 * bone + input->axis] - input->origin;
        if (mirror->pairs.partners[bone] == bone && fabs(off) > OFF_PLANE_PER_SIZE * size)
            mirror->pairs.unpaired[bone] = 1;
    }
    return status;
}

/* How far a vertex lies on the side that is read; below 0 on the other. */
static double side_of(const struct mirror *mirror, uint32_t vertex)
{
    const struct skd_mirror_input *input = mirror->input;
    const float *rest = mirror->session->rig->mesh.rest + 3 * (size_t)vertex;
    double side = (double)rest[input->axis] - input->origin;
    return input->from_negative ? -side : side;
}

static bool is_read(const struct mirror *mirror, uint32_t vertex)
{
    return side_of(mirror, vertex) > PLANE_PER_TOLERANCE * mirror->tolerance;
}

/* Marks the ring of a vertex; true for the vertex that stands for it. */
static bool stands_for_ring(const struct skd_mesh *mesh, uint8_t *walked, uint32_t vertex)
{
    uint32_t twin = vertex;
    if (skd_bits_has(walked, vertex))
        return false;
    while (!skd_bits_take(walked, twin))
        twin = mesh->twins != NULL ? mesh->twins[twin] : twin;
    return true;
}

/* The vertices that are read, sorted by skin, then each skin's into a tree. */
static enum skd_status plant(struct mirror *mirror, struct skd_error *error)
{
    const struct skd_rig *rig = mirror->session->rig;
    const struct skd_mesh *mesh = &rig->mesh;
    size_t skins = (size_t)rig->skin_count, bytes = skd_bits_bytes(mesh->vertex_count), count = 0;
    uint8_t *walked = calloc(bytes, 1);
    size_t *ends = calloc(skins + 1, sizeof *ends);
    mirror->firsts = calloc(skins + 1, sizeof *mirror->firsts);
    if (walked == NULL || ends == NULL || mirror->firsts == NULL)
        goto fail;
    for (uint32_t v = 0; v < mesh->vertex_count; v++)
        if (stands_for_ring(mesh, walked, v) && is_read(mirror, v))
            mirror->firsts[mesh->skins[v] + 1]++;
    for (size_t skin = 0; skin < skins; skin++) {
        mirror->firsts[skin + 1] += mirror->firsts[skin];
        ends[skin] = mirror->firsts[skin];
    }
    count = mirror->firsts[skins];
    mirror->points = malloc(count * sizeof *mirror->points + 1);
    mirror->axes = malloc(count + 1);
    if (mirror->points == NULL || mirror->axes == NULL)
        goto fail;
    memset(walked, 0, bytes);
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        if (!stands_for_ring(mesh, walked, v) || !is_read(mirror, v))
            continue;
        struct skd_point *point = &mirror->points[ends[mesh->skins[v]]++];
        memcpy(point->at, mesh->rest + 3 * (size_t)v, sizeof point->at);
        point->vertex = v;
    }
    for (size_t skin = 0; skin < skins; skin++) {
        size_t first = mirror->firsts[skin];
        skd_nearest_build(mirror->firsts[skin + 1] - first, mirror->points + first,
                          mirror->axes + first);
    }
    free(walked);
    free(ends);
    return SKD_OK;
fail:
    free(walked);
    free(ends);
    return skd_fail_memory(error, "the vertices of the other side");
}

/* Takes the rows of the scope's vertices that are not read. */
static enum skd_status take_written(struct mirror *mirror, struct skd_error *error)
{
    uint32_t *vertices;
    size_t count, kept = 0;
    enum skd_status status =
        skd_rows_list(mirror->session, &mirror->input->scope, &vertices, &count, error);
    if (status != SKD_OK)
        return status;
    for (size_t i = 0; i < count; i++)
        if (!is_read(mirror, vertices[i]))
            vertices[kept++] = vertices[i];
    return skd_rows_take(mirror->session, vertices, kept, &mirror->rows, error);
}

/* The vertex whose row is to be mirrored: one that is read, or the vertex itself where it is the
 * nearest to its own reflection. False: none is near enough. */
static bool match(const struct mirror *mirror, uint32_t vertex, uint32_t *source)
{
    const struct skd_mesh *mesh = &mirror->session->rig->mesh;
    const struct skd_mirror_input *input = mirror->input;
    size_t skin = mesh->skins[vertex], first = mirror->firsts[skin];
    double at[3], own = 2 * side_of(mirror, vertex), limit = mirror->tolerance;
    for (int axis = 0; axis < 3; axis++)
        at[axis] = (double)mesh->rest[3 * (size_t)vertex + (size_t)axis];
    at[input->axis] = 2 * input->origin - at[input->axis];
    bool itself = fabs(own) <= limit;
    double square = itself ? own * own : nextafter(limit * limit, INFINITY);
    const struct skd_point *found = NULL;
    if (fabs(own) > 2 * PLANE_PER_TOLERANCE * limit)
        found = skd_nearest_find(mirror->firsts[skin + 1] - first, mirror->points + first,
                                 mirror->axes + first, at, &square);
    *source = found != NULL ? found->vertex : vertex;
    return found != NULL || itself;
}

/* Bones with weights while they are put together. */
struct mixture {
    int count;
    uint16_t bones[2 * SKD_SLOT_COUNT_MAX];
    float weights[2 * SKD_SLOT_COUNT_MAX];
};

static void add(struct mixture *mixture, uint16_t bone, float weight)
{
    int i = 0;
    while (i < mixture->count && mixture->bones[i] != bone)
        i++;
    if (i == mixture->count) {
        mixture->bones[mixture->count++] = bone;
        mixture->weights[i] = 0;
    }
    mixture->weights[i] += weight;
}

/* The vertex's live row as its mirror image would have it, each weight times `share`. */
static void add_mirrored(const struct mirror *mirror, uint32_t vertex, float share,
                         struct mixture *mixture, uint8_t *unpaired)
{
    size_t n = (size_t)mirror->session->slot_count, at = vertex * n;
    for (size_t i = 0; i < n; i++) {
        uint16_t bone = mirror->session->joints[at + i];
        float weight = mirror->session->weights[at + i];
        if (bone == SKD_SLOT_EMPTY || (!(weight > 0) && !(weight < 0)))
            continue;
        unpaired[bone] |= mirror->pairs.unpaired[bone];
        add(mixture, mirror->pairs.partners[bone], share * weight);
    }
}

static void add_plain(const struct mirror *mirror, uint32_t vertex, float share,
                      struct mixture *mixture)
{
    size_t n = (size_t)mirror->session->slot_count, at = vertex * n;
    for (size_t i = 0; i < n; i++) {
        float weight = mirror->session->weights[at + i];
        if (weight > 0 || weight < 0)
            add(mixture, mirror->session->joints[at + i], share * weight);
    }
}

static bool is_heavier(const struct mixture *mixture, int a, int b)
{
    return mixture->weights[a] > mixture->weights[b] ||
           (mixture->weights[a] >= mixture->weights[b] && mixture->bones[a] < mixture->bones[b]);
}

/* Keeps at most `most` of a symmetric mixture, the heaviest first and a bone only with its
 * partner, so that it stays symmetric. Returns true when something went. */
static bool cut_pairs(const struct skd_bone_pairs *pairs, int most, struct mixture *mixture)
{
    struct mixture kept = {0};
    bool done[2 * SKD_SLOT_COUNT_MAX] = {false};
    for (int turn = 0; turn < mixture->count; turn++) {
        int best = -1, other = -1;
        for (int i = 0; i < mixture->count; i++)
            if (!done[i] && (best < 0 || is_heavier(mixture, i, best)))
                best = i;
        if (best < 0)
            break;
        for (int i = 0; i < mixture->count; i++)
            if (i != best && mixture->bones[i] == pairs->partners[mixture->bones[best]])
                other = i;
        done[best] = true;
        if (other >= 0)
            done[other] = true;
        if (kept.count + 1 + (other >= 0) > most)
            continue;
        add(&kept, mixture->bones[best], mixture->weights[best]);
        if (other >= 0)
            add(&kept, mixture->bones[other], mixture->weights[other]);
    }
    bool cut = kept.count < mixture->count;
    *mixture = kept;
    return cut;
}

/* Weights of a cut mixture that sum to one; what a stroke left below 0 goes. */
static void scale(int n, struct mixture *mixture)
{
    for (int i = 0; i < mixture->count; i++)
        mixture->weights[i] = fmaxf(mixture->weights[i], 0);
    for (int i = mixture->count; i < n; i++) {
        mixture->bones[i] = SKD_SLOT_EMPTY;
        mixture->weights[i] = 0;
    }
    skd_row_scale(n, mixture->bones, mixture->weights);
}

/* Whether a row on the plane is its own mirror image but for rounding, and so stays as it is. */
static bool is_symmetric(const struct mirror *mirror, uint32_t vertex)
{
    size_t n = (size_t)mirror->session->slot_count, at = vertex * n;
    const uint16_t *joints = mirror->session->joints + at;
    const float *weights = mirror->session->weights + at;
    bool symmetric = true;
    for (size_t i = 0; i < n; i++) {
        float other = 0;
        for (size_t k = 0; k < n && joints[i] != SKD_SLOT_EMPTY; k++)
            if (joints[k] == mirror->pairs.partners[joints[i]])
                other = weights[k];
        symmetric = symmetric && fabsf(weights[i] - other) <= ROUNDING;
    }
    return symmetric;
}

/* Writes one row; false when nothing lies where the vertex reflects to. */
static bool write_row(const struct mirror *mirror, size_t item, uint8_t *unpaired)
{
    const struct skd_rows *rows = &mirror->rows;
    int n = rows->slot_count;
    uint32_t source, vertex = rows->vertices[item];
    struct mixture mixture = {0};
    if (!match(mirror, vertex, &source))
        return false;
    bool on_plane = source == vertex;
    if (on_plane && is_symmetric(mirror, vertex))
        return true;
    if (on_plane)
        add_plain(mirror, vertex, 0.5F, &mixture);
    add_mirrored(mirror, source, on_plane ? 0.5F : 1, &mixture, unpaired);
    if (on_plane && cut_pairs(&mirror->pairs, n, &mixture))
        scale(n, &mixture);
    skd_row_put(n, rows->joints + item * (size_t)n, rows->weights + item * (size_t)n, mixture.count,
                mixture.bones, mixture.weights);
    return true;
}

static enum skd_status write_all(const struct mirror *mirror, struct skd_mirror_report *report,
                                 struct skd_error *error)
{
    enum skd_status status = SKD_OK;
    for (size_t i = 0; i < mirror->rows.count && status == SKD_OK; i++) {
        report->unmatched += !write_row(mirror, i, report->unpaired);
        status = skd_scope_check(&mirror->input->scope, i, error);
    }
    return status;
}

enum skd_status skd_mirror_prepare(struct skd_session *session,
                                   const struct skd_mirror_input *input, struct skd_step **step,
                                   struct skd_mirror_report *report, struct skd_error *error)
{
    const struct skd_skeleton *skeleton = &session->rig->skeleton;
    struct mirror mirror = {.session = session, .input = input};
    enum skd_status status = SKD_OK;
    double size = measure_rest(&session->rig->mesh);
    mirror.tolerance = input->tolerance * size;
    *report = (struct skd_mirror_report){.unpaired = calloc((size_t)skeleton->bone_count, 1)};
    if (report->unpaired == NULL)
        status = skd_fail_memory(error, "mirroring");
    if (status == SKD_OK && (status = take_written(&mirror, error)) == SKD_OK &&
        (status = pair_bones(&mirror, size, error)) == SKD_OK &&
        (status = plant(&mirror, error)) == SKD_OK &&
        (status = write_all(&mirror, report, error)) == SKD_OK)
        status = skd_rows_step(session, &mirror.rows, step, error);
    skd_bone_pairs_finish(&mirror.pairs);
    skd_rows_finish(&mirror.rows);
    free(mirror.firsts);
    free(mirror.points);
    free(mirror.axes);
    return status;
}
