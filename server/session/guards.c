/* See guards.h. */
#include "session/guards.h"

#include <stdlib.h>

enum skd_status skd_guards_factor(const struct skd_samples *poses, struct skd_guard **result,
                                  struct skd_error *error)
{
    const double *matrices[SKD_GUARD_POSES_MAX];
    if (poses->bone_count > SKD_GUARD_BONES_MAX)
        return skd_fail(error, SKD_UNSUPPORTED,
                        "the rig has %d bones, and poses are compared for rigs of up to %d",
                        poses->bone_count, SKD_GUARD_BONES_MAX);
    SKD_ASSERT(poses->count >= 1 && poses->count <= SKD_GUARD_POSES_MAX);
    struct skd_guard *factors = malloc(skd_guard_bytes(poses->bone_count));
    if (factors == NULL)
        return skd_fail_memory(error, "the factors of the bone pairs");
    for (size_t i = 0; i < poses->count; i++)
        matrices[i] = skd_samples_matrices(poses, i);
    skd_guard_build(poses->bone_count, (int)poses->count, matrices, factors);
    *result = factors;
    return SKD_OK;
}

void skd_guards_finish(struct skd_guards *guards)
{
    free(guards->factors);
    skd_samples_finish(&guards->poses);
    *guards = (struct skd_guards){0};
}

size_t skd_guards_bytes(const struct skd_guards *guards)
{
    if (guards->factors == NULL)
        return 0;
    size_t bones = (size_t)guards->poses.bone_count;
    return skd_guard_bytes(guards->poses.bone_count) +
           guards->poses.capacity *
               (sizeof *guards->poses.items + bones * SKD_MATRIX_SIZE * sizeof(double));
}
