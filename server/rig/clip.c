/* See clip.h. */
#include "rig/clip.h"

#include "rig/matrix.h"

#include <math.h>

int skd_channel_width(const struct skd_channel *channel)
{
    return channel->path == SKD_ROTATION ? 4 : 3;
}

size_t skd_channel_step(const struct skd_channel *channel)
{
    const size_t width = (size_t)skd_channel_width(channel);
    return channel->interpolation == SKD_CUBICSPLINE ? 3 * width : width;
}

/* The last key that is not later than `time`, by bisection; the first key when all are later. */
static size_t find_key(const struct skd_channel *channel, double time)
{
    size_t low = 0, high = channel->key_count;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if ((double)channel->times[middle] <= time)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Spherical interpolation the short way round; nearly equal rotations go in a straight line, where
 * sin would cancel. */
static void slerp(const float *a, const float *b, double u, double out[4])
{
    double dot = 0;
    for (int i = 0; i < 4; i++)
        dot += (double)a[i] * (double)b[i];
    const double sign = dot < 0 ? -1 : 1;
    double from = 1 - u, to = u;
    if (dot * sign < 1 - 1e-9) {
        const double angle = acos(dot * sign);
        from = sin((1 - u) * angle) / sin(angle);
        to = sin(u * angle) / sin(angle);
    }
    for (int i = 0; i < 4; i++)
        out[i] = from * (double)a[i] + sign * to * (double)b[i];
}

/* Hermite spline through values with the in and out tangents of the file, which are per second. */
static void cubic(const float *key, const float *next, int width, double span, double u,
                  double *out)
{
    const double u2 = u * u, u3 = u2 * u;
    const float *value = key + width, *out_tangent = key + 2 * width;
    const float *next_in = next, *next_value = next + width;
    for (int i = 0; i < width; i++)
        out[i] = (2 * u3 - 3 * u2 + 1) * (double)value[i] +
                 span * (u3 - 2 * u2 + u) * (double)out_tangent[i] +
                 (3 * u2 - 2 * u3) * (double)next_value[i] + span * (u3 - u2) * (double)next_in[i];
}

void skd_channel_sample(const struct skd_channel *channel, double time, double *out)
{
    const int width = skd_channel_width(channel);
    const size_t step = skd_channel_step(channel);
    const int value = channel->interpolation == SKD_CUBICSPLINE ? width : 0;
    const size_t at = find_key(channel, time);
    const float *key = channel->values + at * step, *next = key + step;
    const double start = (double)channel->times[at];
    const double span = at + 1 < channel->key_count ? (double)channel->times[at + 1] - start : 0;
    if (channel->interpolation == SKD_STEP || !(span > 0) || !(time > start)) {
        for (int i = 0; i < width; i++)
            out[i] = (double)key[value + i];
    } else {
        const double u = (time - start) / span;
        if (channel->interpolation == SKD_CUBICSPLINE)
            cubic(key, next, width, span, u, out);
        else if (channel->path == SKD_ROTATION)
            slerp(key, next, u, out);
        else
            for (int i = 0; i < width; i++)
                out[i] = (1 - u) * (double)key[i] + u * (double)next[i];
    }
    if (channel->path == SKD_ROTATION)
        skd_quaternion_normalise(out);
}
