/* A stroke script: poses and strokes as a person writes them down.
 *
 * Stage: before the wire. Thread: one. The structs mirror the YAML text member by member: what was
 * left out is NULL. All of their memory is the C library's heap.
 */
#ifndef SKD_CLI_SCRIPT_H
#define SKD_CLI_SCRIPT_H

#include "base/error.h"

#include <stddef.h>
#include <stdint.h>

/* One of: clip and time; bend and perhaps seed; matrices. */
struct skd_script_pose {
    char *name;
    char *clip;
    double *time;           /* seconds */
    double *bend;           /* degrees, of every joint */
    uint32_t *seed;         /* chooses the axes of bend; NULL: 0 */
    double (*matrices)[16]; /* [matrices_count], row by row */
    unsigned matrices_count;
};

/* Either centre or bone; move, out, or both. */
struct skd_script_brush {
    double *centre; /* [3] */
    char *bone;
    double *radius;
    char *falloff;
    double *move; /* [3] */
    double *out;
};

/* Either a brush, or vertices and positions. */
struct skd_script_stroke {
    char *pose;
    struct skd_script_brush *brush;
    uint32_t *vertices;
    unsigned vertices_count;
    float (*positions)[3];
    unsigned positions_count;
    float *mask; /* [mask_count]: how far each vertex goes, 0 to 1; goes with vertices */
    unsigned mask_count;
    char *method;
    char *constraint;
    double *stiffness;
    char *pin;
    char *slots;
    double *guard;
    double *smooth;
    double *mix;
    char *residual;
    char **lock_bones;
    unsigned lock_bones_count;
};

struct skd_script {
    struct skd_script_pose *poses;
    unsigned poses_count;
    struct skd_script_stroke *strokes;
    unsigned strokes_count;
};

/* Reads a script from YAML (or JSON, which is YAML) and checks its form: everything that can be
 * wrong without knowing the session. `path` names the text in errors, with the line where the text
 * is malformed and the pose or stroke where a value is. Destroy *script on success. */
SKD_MUST_CHECK enum skd_status skd_script_parse(const char *path, const char *text, size_t bytes,
                                                struct skd_script **script,
                                                struct skd_error *error);
void skd_script_destroy(struct skd_script *script);

/* The check of one stroke's form; `where` names it ("poses.yaml, stroke 3"). */
SKD_MUST_CHECK enum skd_status skd_script_check_stroke(const struct skd_script_stroke *stroke,
                                                       const char *where, struct skd_error *error);

/* The same for the words and numbers that say how it is solved, without its targets. */
SKD_MUST_CHECK enum skd_status skd_script_check_solving(const struct skd_script_stroke *stroke,
                                                        const char *where, struct skd_error *error);

/* The format, for --help. */
extern const char skd_script_format[];

/* What is known about the session that a script is written for. */
struct skd_script_setting {
    const char *session;
    const char *source;
    double length;
    size_t vertex_count;
};

/* Prints a script on stdout with comments that teach the format, or as one line of JSON. */
void skd_script_write(const struct skd_script *script, const struct skd_script_setting *setting);
void skd_script_write_json(const struct skd_script *script);

#endif
