/* See pc2.h. Samples are read one by one, so that a long cache takes no more memory than what is
 * wanted of it. */
#include "clients/cli/pc2.h"

#include "protocol/limits.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HEADER_BYTES = 32 };

static uint32_t read_u32(const unsigned char *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
           (uint32_t)bytes[3] << 24;
}

static float read_f32(const unsigned char *bytes)
{
    uint32_t bits = read_u32(bytes);
    float number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

/* An i32 that counts something. */
static bool read_count(const unsigned char *bytes, size_t *count)
{
    *count = read_u32(bytes);
    return *count >= 1 && *count <= INT32_MAX;
}

static enum skd_status read_header(FILE *stream, const char *path,
                                   const struct skd_pc2_wanted *wanted, struct skd_pc2 *cache,
                                   struct skd_error *error)
{
    unsigned char header[HEADER_BYTES];
    if (fread(header, 1, sizeof header, stream) != sizeof header ||
        memcmp(header, "POINTCACHE2", 12) != 0)
        return skd_fail(error, SKD_BAD_PARAMS, "%s is no PC2 point cache", path);
    if (read_u32(header + 12) != 1)
        return skd_fail(error, SKD_BAD_PARAMS, "%s is a point cache of version %u; 1 is known",
                        path, read_u32(header + 12));
    cache->rate = (double)read_f32(header + 24);
    if (!read_count(header + 16, &cache->points) || !read_count(header + 28, &cache->samples))
        return skd_fail(error, SKD_BAD_PARAMS, "%s holds no points, or no samples", path);
    if (!isfinite(read_f32(header + 20)) || !(isfinite(cache->rate) && cache->rate > 0))
        return skd_fail(error, SKD_BAD_PARAMS, "%s has a start or a rate that cannot be", path);
    if (cache->points != wanted->points)
        return skd_fail(error, SKD_COUNT_MISMATCH,
                        "%s has %zu points, but the session %zu vertices; skinctl info tells how "
                        "they are counted",
                        path, cache->points, wanted->points);
    cache->step = wanted->step;
    cache->count = (cache->samples - 1) / wanted->step + 1;
    if (cache->count > wanted->count_most)
        return skd_fail(error, SKD_TOO_LARGE,
                        "%s has %zu samples, and %zu can be refitted at once; take every n-th of "
                        "them with --step",
                        path, cache->count, wanted->count_most);
    return SKD_OK;
}

/* The next sample's points; a whole one is read also where it is passed over. */
static enum skd_status read_sample(FILE *stream, const char *path, size_t number, size_t points,
                                   float *positions, struct skd_error *error)
{
    if (fread(positions, 3 * sizeof *positions, points, stream) != points) {
        if (ferror(stream))
            return skd_fail(error, SKD_FILE_IO, "cannot read %s: %s", path, strerror(errno));
        return skd_fail(error, SKD_BAD_PARAMS, "%s is cut short: sample %zu is not whole", path,
                        number);
    }
    for (size_t i = 0; i < 3 * points; i++) {
        positions[i] = read_f32((const unsigned char *)&positions[i]);
        if (!isfinite(positions[i]))
            return skd_fail(error, SKD_NOT_FINITE, "%s: point %zu of sample %zu is not finite",
                            path, i / 3, number);
    }
    return SKD_OK;
}

static enum skd_status read_samples(FILE *stream, const char *path, struct skd_pc2 *cache,
                                    struct skd_error *error)
{
    const size_t numbers = 3 * cache->points;
    /* One sample more than is kept: those passed over land behind the last. */
    const bool is_passing = cache->step > 1;
    enum skd_status status = SKD_OK;
    cache->positions = malloc((cache->count + is_passing) * numbers * sizeof *cache->positions);
    if (cache->positions == NULL)
        return skd_fail_memory(error, path);
    for (size_t i = 0; status == SKD_OK && i < cache->samples; i++) {
        size_t place = i % cache->step == 0 ? i / cache->step : cache->count;
        status =
            read_sample(stream, path, i, cache->points, cache->positions + place * numbers, error);
    }
    if (status == SKD_OK && fgetc(stream) != EOF)
        status = skd_fail(error, SKD_BAD_PARAMS, "%s is longer than the %zu samples that it says",
                          path, cache->samples);
    return status;
}

enum skd_status skd_pc2_read(const char *path, const struct skd_pc2_wanted *wanted,
                             struct skd_pc2 *cache, struct skd_error *error)
{
    const bool is_stdin = strcmp(path, "-") == 0;
    const char *name = is_stdin ? "the point cache" : path;
    FILE *stream = is_stdin ? stdin : fopen(path, "rbe");
    *cache = (struct skd_pc2){0};
    if (stream == NULL)
        return skd_fail(error, SKD_NO_FILE, "cannot open %s: %s", path, strerror(errno));
    enum skd_status status = read_header(stream, name, wanted, cache, error);
    if (status == SKD_OK)
        status = read_samples(stream, name, cache, error);
    if (!is_stdin)
        fclose(stream);
    return status;
}

void skd_pc2_finish(struct skd_pc2 *cache)
{
    free(cache->positions);
    *cache = (struct skd_pc2){0};
}
