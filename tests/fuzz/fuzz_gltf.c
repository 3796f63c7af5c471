/* Fuzz target: a glTF file to a rig, its image, a rig again, a pose of it, and a file again
 * (rig/gltf.h, rig/rig_image.h): the way of a file into the daemon and out, in one process.
 *
 * Input: the bytes of a .glb or .gltf. What is accepted must be a whole rig: every joint, index and
 * number is looked at, every clip is sampled, and the file is written again with one row changed.
 */
#include "fuzz.h"
#include "rig_checks.h"

#include "rig/gltf.h"
#include "rig/gltf_source.h"
#include "rig/pose.h"
#include "rig/rig_image.h"

#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char folder[] = "/tmp/skind-fuzz-XXXXXX";

/* Also what an export wrote beside its target; the next input must not find it. */
static void empty_folder(void)
{
    DIR *files = opendir(folder);
    struct dirent *entry;
    SKD_ASSERT(files != NULL);
    while ((entry = readdir(files)) != NULL)
        if (entry->d_name[0] != '.')
            SKD_ASSERT(unlinkat(dirfd(files), entry->d_name, 0) == 0);
    closedir(files);
}

static void remove_folder(void)
{
    empty_folder();
    rmdir(folder);
}

static void write_file(const char *path, const uint8_t *data, size_t size)
{
    int file = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    SKD_ASSERT(file >= 0 && write(file, data, size) == (ssize_t)size);
    close(file);
}

static void sample_clips(const struct skd_rig *rig)
{
    const size_t numbers = (size_t)rig->skeleton.bone_count * SKD_MATRIX_SIZE;
    double *pose = malloc(numbers * sizeof *pose);
    struct skd_error error;
    SKD_ASSERT(pose != NULL);
    for (int clip = 0; clip < (int)rig->nodes.clip_count && clip < 4; clip++) {
        if (skd_pose_from_clip(rig, clip, rig->nodes.clips[clip].duration / 3, pose, &error) !=
            SKD_OK)
            continue;
        for (size_t i = 0; i < numbers; i++)
            SKD_ASSERT(isfinite(pose[i]));
    }
    skd_pose_bend(rig, 1, 0.5, pose);
    free(pose);
}

/* Every vertex to its heaviest bone alone: all rows change that had more. */
static void export_rigid(const struct skd_rig *rig, const struct skd_influences *influences,
                         const char *path)
{
    enum { SLOTS = 4 };
    const size_t count = rig->mesh.vertex_count;
    uint16_t *joints = malloc(count * SLOTS * sizeof *joints);
    float *weights = calloc(count * SLOTS, sizeof *weights);
    struct skd_gltf_export_report report;
    struct skd_error error = {0};
    SKD_ASSERT(joints != NULL && weights != NULL);
    for (size_t v = 0; v < count; v++) {
        for (int slot = 1; slot < SLOTS; slot++)
            joints[v * SLOTS + (size_t)slot] = SKD_SLOT_EMPTY;
        joints[v * SLOTS] = influences->joints[influences->offsets[v]];
        weights[v * SLOTS] = 1;
    }
    const struct skd_gltf_content content = {
        .slot_count = SLOTS, .joints = joints, .weights = weights};
    if (skd_gltf_export(rig, &content, path, &report, &error) != SKD_OK)
        SKD_ASSERT(error.text[0] != '\0');
    free(joints);
    free(weights);
}

struct image {
    uint8_t *bytes;
    size_t count;
};

static bool append(void *user, const void *bytes, size_t count)
{
    struct image *image = user;
    memcpy(image->bytes + image->count, bytes, count);
    image->count += count;
    return true;
}

/* As the daemon gets it. The reader may refuse nothing that the importer accepts, but for a mesh
 * whose neighbours are too many, which only it looks for. */
static enum skd_status load(const char *path, struct image *image, struct skd_rig **rig,
                            struct skd_influences *influences, struct skd_error *error)
{
    struct skd_rig *parsed;
    struct skd_influences rows;
    enum skd_status status = skd_gltf_parse(path, &parsed, &rows, error);
    if (status != SKD_OK)
        return status;
    image->bytes = malloc(skd_rig_image_bytes(parsed, &rows));
    SKD_ASSERT(image->bytes != NULL);
    const struct skd_image_sink sink = {append, image};
    SKD_ASSERT(skd_rig_image_write(parsed, &rows, &sink));
    skd_rig_destroy(parsed);
    skd_influences_finish(&rows);
    status = skd_rig_image_read(image->bytes, image->count, rig, influences, error);
    SKD_ASSERT(status == SKD_OK || status == SKD_TOO_LARGE);
    if (status == SKD_OK)
        SKD_ASSERT(skd_gltf_source_reopen((*rig)->source, error) == SKD_OK);
    return status;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char in[64], out[64];
    struct skd_rig *rig;
    struct skd_influences influences;
    struct skd_error error = {0};
    struct image image = {0};
    static bool has_folder;
    if (!has_folder) {
        SKD_ASSERT(mkdtemp(folder) != NULL);
        has_folder = atexit(remove_folder) == 0;
    }
    const char *ending = size > 0 && data[0] == 'g' ? "glb" : "gltf";
    (void)snprintf(in, sizeof in, "%s/in.%s", folder, ending);
    (void)snprintf(out, sizeof out, "%s/out.%s", folder, ending);
    write_file(in, data, size);
    if (load(in, &image, &rig, &influences, &error) != SKD_OK) {
        SKD_ASSERT(error.text[0] != '\0');
        free(image.bytes);
        return 0;
    }
    check_influences(rig, &influences);
    check_mesh(rig);
    sample_clips(rig);
    export_rigid(rig, &influences, out);
    skd_rig_destroy(rig);
    skd_influences_finish(&influences);
    free(image.bytes);
    empty_folder();
    return 0;
}
