/* Values out of the command line and out of files: numbers, vectors, lists, paths.
 *
 * Thread: one. Everything is checked here once; the errors name what was read.
 */
#ifndef SKD_CLI_VALUES_H
#define SKD_CLI_VALUES_H

#include "protocol/message.h"

/* Reads "x,y,z", three finite numbers. `what` names it in the error ("--centre"). */
SKD_MUST_CHECK enum skd_status skd_value_vector(const char *what, const char *text,
                                                double vector[3], struct skd_error *error);

/* Reads "0,0.5,1", finite numbers, into *numbers (free it). */
SKD_MUST_CHECK enum skd_status skd_value_numbers(const char *what, const char *text,
                                                 double **numbers, size_t *count,
                                                 struct skd_error *error);

/* Reads "0,5,10-20" into *indexes (free it). */
SKD_MUST_CHECK enum skd_status skd_value_indexes(const char *what, const char *text,
                                                 uint32_t **indexes, size_t *count,
                                                 struct skd_error *error);

/* The place of a word in a NULL-terminated list. The error names them all. */
SKD_MUST_CHECK enum skd_status skd_value_word(const char *what, const char *text,
                                              const char *const *words, int *index,
                                              struct skd_error *error);

/* Reads a size of history, "200M" or "2G", within the protocol's limits. */
SKD_MUST_CHECK enum skd_status skd_value_size(const char *what, const char *text, double *bytes,
                                              struct skd_error *error);

/* Texts as popt gathers them (POPT_ARG_ARGV): how many, and as a member of a request; NULL: none.
 */
unsigned skd_count_texts(char *const *texts);
void skd_add_texts(cJSON *body, const char *member, char *const *texts);

/* A growing list of vertices and where they should go. */
struct skd_targets {
    size_t count;
    size_t capacity;
    uint32_t *vertices; /* [count] */
    float *positions;   /* [count][3] */
    float *mask;        /* [count]; 1 where none was given */
    bool has_mask;
};
void skd_targets_finish(struct skd_targets *targets);

/* Adds "I=x,y,z". */
SKD_MUST_CHECK enum skd_status skd_targets_add(struct skd_targets *targets, const char *what,
                                               const char *text, struct skd_error *error);
/* Adds a text file's lines "index x y z", or "index x y z mask"; '#' begins a comment. "-" is
 * stdin. */
SKD_MUST_CHECK enum skd_status skd_targets_read(struct skd_targets *targets, const char *path,
                                                struct skd_error *error);

/* A whole file ("-": stdin) with a NUL after it; free *text. */
SKD_MUST_CHECK enum skd_status skd_file_read(const char *path, char **text, size_t *bytes,
                                             struct skd_error *error);
/* Writes a whole file. */
SKD_MUST_CHECK enum skd_status skd_file_write(const char *path, const void *data, size_t bytes,
                                              struct skd_error *error);

/* Reads strict JSON; `what` names it in the error. cJSON_Delete the tree. */
SKD_MUST_CHECK enum skd_status skd_value_json(const char *what, const char *text, size_t bytes,
                                              cJSON **tree, struct skd_error *error);

/* A path as the daemon wants it: from the current folder on when it is not absolute. */
SKD_MUST_CHECK enum skd_status
skd_path_absolute(const char *path, char absolute[SKD_PATH_BYTES_MAX], struct skd_error *error);

#endif
