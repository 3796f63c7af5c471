/* Vectors, unit quaternions and smooth ramps in float64 for the generator.
 *
 * Only + - * / and sqrt, and sines that are rounded to 2^-30, so that a last bit of libm cannot
 * reach the file.
 */
#ifndef SKD_GENERATE_GEOMETRY_H
#define SKD_GENERATE_GEOMETRY_H

#include <math.h>

struct vec3 {
    double x, y, z;
};

/* x, y, z, w as in glTF. */
struct quat {
    double x, y, z, w;
};

static inline struct vec3 vec3(double x, double y, double z)
{
    return (struct vec3){x, y, z};
}

static inline struct vec3 vec3_add(struct vec3 a, struct vec3 b)
{
    return vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}

static inline struct vec3 vec3_sub(struct vec3 a, struct vec3 b)
{
    return vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline struct vec3 vec3_scale(struct vec3 a, double s)
{
    return vec3(a.x * s, a.y * s, a.z * s);
}

/* a + b * s */
static inline struct vec3 vec3_mad(struct vec3 a, struct vec3 b, double s)
{
    return vec3(a.x + b.x * s, a.y + b.y * s, a.z + b.z * s);
}

static inline double vec3_dot(struct vec3 a, struct vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b)
{
    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static inline double vec3_length(struct vec3 a)
{
    return sqrt(vec3_dot(a, a));
}

static inline struct vec3 vec3_unit(struct vec3 a)
{
    return vec3_scale(a, 1.0 / vec3_length(a));
}

static inline struct vec3 vec3_mix(struct vec3 a, struct vec3 b, double t)
{
    return vec3_mad(vec3_scale(a, 1.0 - t), b, t);
}

static inline double clamp01(double t)
{
    return t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
}

/* 0 up to t = 0, 1 from t = 1 on, and no kink between. */
static inline double smooth_step(double t)
{
    double c = clamp01(t);
    return c * c * (3.0 - 2.0 * c);
}

static inline double sin_degrees(double degrees)
{
    return nearbyint(sin(degrees * 0.017453292519943295) * 1073741824.0) / 1073741824.0;
}

static inline double cos_degrees(double degrees)
{
    return sin_degrees(degrees + 90.0);
}

static inline struct quat quat_multiply(struct quat a, struct quat b)
{
    return (struct quat){a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                         a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                         a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
                         a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}

static inline struct quat quat_conjugate(struct quat q)
{
    return (struct quat){-q.x, -q.y, -q.z, q.w};
}

/* Length one again: a chain of products would double its rounding error at every link. */
static inline struct quat quat_normalise(struct quat q)
{
    double scale = 1.0 / sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
    return (struct quat){q.x * scale, q.y * scale, q.z * scale, q.w * scale};
}

static inline struct vec3 quat_rotate(struct quat q, struct vec3 v)
{
    struct vec3 axis = vec3(q.x, q.y, q.z);
    struct vec3 t = vec3_scale(vec3_cross(axis, v), 2.0);
    return vec3_add(vec3_mad(v, t, q.w), vec3_cross(axis, t));
}

#endif
