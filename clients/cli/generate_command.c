/* skinctl generate: the project's own character, of any size. No daemon is needed.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/generate/generate.h"
#include "clients/cli/print.h"

#include <stdio.h>
#include <sys/stat.h>

static struct {
    int vertices;
    int bones;
} options = {.vertices = 10000, .bones = SKD_GENERATE_DEFAULT_BONES};

static const struct poptOption generate_options[] = {
    {"vertices", 'n', POPT_ARG_INT, &options.vertices, 0,
     "how many vertices, 1000 to 5000000 (default: 10000)", "N"},
    {"bones", 'b', POPT_ARG_INT, &options.bones, 0, "how many bones, 20 to 250 (default: 53)", "B"},
    POPT_TABLEEND,
};

static void show_progress(double fraction, void *user)
{
    skd_progress_set(user, fraction);
}

static void print_generated(const char *path)
{
    char vertices[SKD_COUNT_TEXT_BYTES], bytes[SKD_COUNT_TEXT_BYTES];
    struct stat info = {0};
    (void)stat(path, &info);
    if (!skd_cli.json) {
        printf("wrote %s: %s vertices, %d bones, %s\n", path,
               skd_count_text(options.vertices, vertices), options.bones,
               skd_bytes_text((double)info.st_size, bytes));
        return;
    }
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "path", path);
    cJSON_AddNumberToObject(json, "vertices", options.vertices);
    cJSON_AddNumberToObject(json, "bones", options.bones);
    cJSON_AddNumberToObject(json, "bytes", (double)info.st_size);
    skd_print_own_json(json);
}

static int run_generate(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_progress progress;
    (void)count;
    if (options.vertices < SKD_GENERATE_MIN_VERTICES ||
        options.vertices > SKD_GENERATE_MAX_VERTICES)
        return skd_cli_usage(error, "--vertices takes %d to %d, not %d", SKD_GENERATE_MIN_VERTICES,
                             SKD_GENERATE_MAX_VERTICES, options.vertices);
    if (options.bones < SKD_GENERATE_MIN_BONES || options.bones > SKD_GENERATE_MAX_BONES)
        return skd_cli_usage(error, "--bones takes %d to %d, not %d", SKD_GENERATE_MIN_BONES,
                             SKD_GENERATE_MAX_BONES, options.bones);
    skd_progress_begin(&progress, "generating");
    const struct skd_generate_options wanted = {.vertex_count = (uint32_t)options.vertices,
                                                .bone_count = (uint16_t)options.bones,
                                                .progress = show_progress,
                                                .user = &progress};
    enum skd_status status = skd_generate_humanoid(&wanted, arguments[0], error);
    skd_progress_end(&progress);
    if (status == SKD_OK)
        print_generated(arguments[0]);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_generate = {
    .group = SKD_GROUP_SCRIPTS,
    .name = "generate",
    .arguments = "FILE.glb",
    .least = 1,
    .most = 1,
    .summary = "write a humanoid with a smooth skin, fingers and clips",
    .options = generate_options,
    .details = "The same arguments give the same bytes.\n",
    .examples = "  skinctl generate body.glb\n"
                "  skinctl generate --vertices 1000000 --bones 120 large.glb\n",
    .run = run_generate,
};
