/* See values.h. */
#include "clients/cli/values.h"

#include "protocol/json_check.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { READ_BYTES = 1 << 16 };

/* A finite number at *text, which moves behind it. */
static bool read_number(const char **text, double *number)
{
    char *end;
    *number = strtod(*text, &end);
    bool is_there = end != *text && isfinite(*number);
    *text = end;
    return is_there;
}

/* An index at *text, which moves behind it. No sign, no fraction. */
static bool read_index(const char **text, uint32_t *index)
{
    char *end;
    if (**text < '0' || **text > '9')
        return false;
    errno = 0;
    unsigned long long value = strtoull(*text, &end, 10);
    *text = end;
    *index = (uint32_t)value;
    return errno == 0 && value <= UINT32_MAX;
}

static bool read_vector(const char *text, double vector[3])
{
    for (int i = 0; i < 3; i++) {
        if (!read_number(&text, &vector[i]) || *text != (i < 2 ? ',' : '\0'))
            return false;
        text++;
    }
    return true;
}

enum skd_status skd_value_vector(const char *what, const char *text, double vector[3],
                                 struct skd_error *error)
{
    if (read_vector(text, vector))
        return SKD_OK;
    return skd_fail(error, SKD_BAD_PARAMS, "%s takes three numbers as x,y,z, not \"%s\"", what,
                    text);
}

enum skd_status skd_value_numbers(const char *what, const char *text, double **numbers,
                                  size_t *count, struct skd_error *error)
{
    size_t most = 1;
    for (const char *letter = text; *letter != '\0'; letter++)
        most += *letter == ',';
    *count = 0;
    *numbers = malloc(most * sizeof **numbers);
    if (*numbers == NULL)
        return skd_fail_memory(error, what);
    for (const char *place = text;; place++) {
        if (!read_number(&place, &(*numbers)[*count]) || (*place != ',' && *place != '\0'))
            break;
        (*count)++;
        if (*place == '\0')
            return SKD_OK;
    }
    free(*numbers);
    *numbers = NULL;
    return skd_fail(error, SKD_BAD_PARAMS, "%s takes numbers as 0,0.5,1, not \"%.60s\"", what,
                    text);
}

/* Reads one "a" or "a-b". */
static bool read_range(const char **text, uint32_t *first, uint32_t *last)
{
    if (!read_index(text, first))
        return false;
    *last = *first;
    if (**text != '-')
        return true;
    (*text)++;
    return read_index(text, last) && *last >= *first;
}

enum skd_status skd_value_indexes(const char *what, const char *text, uint32_t **indexes,
                                  size_t *count, struct skd_error *error)
{
    static const size_t count_max = SKD_FRAME_BYTES_MAX / sizeof(uint32_t);
    const char *place = text;
    uint32_t *list = NULL;
    size_t used = 0;
    for (;;) {
        uint32_t first, last;
        if (!read_range(&place, &first, &last) || (*place != ',' && *place != '\0')) {
            free(list);
            return skd_fail(error, SKD_BAD_PARAMS,
                            "%s takes indexes and ranges as 0,5,10-20, not \"%.60s\"", what, text);
        }
        size_t more = (size_t)(last - first) + 1;
        uint32_t *longer =
            used + more <= count_max ? realloc(list, (used + more) * sizeof *list) : NULL;
        if (longer == NULL) {
            free(list);
            return skd_fail_memory(error, what);
        }
        list = longer;
        for (uint32_t i = 0; i < more; i++)
            list[used++] = first + i;
        if (*place == '\0')
            break;
        place++;
    }
    *indexes = list;
    *count = used;
    return SKD_OK;
}

enum skd_status skd_value_word(const char *what, const char *text, const char *const *words,
                               int *index, struct skd_error *error)
{
    char all[SKD_ERROR_TEXT_BYTES / 2] = "";
    for (*index = 0; words[*index] != NULL; (*index)++) {
        size_t used = strlen(all);
        if (strcmp(text, words[*index]) == 0)
            return SKD_OK;
        (void)snprintf(all + used, sizeof all - used, "%s%s", *index > 0 ? ", " : "",
                       words[*index]);
    }
    return skd_fail(error, SKD_BAD_PARAMS, "%s is one of %s, not \"%.60s\"", what, all, text);
}

void skd_targets_finish(struct skd_targets *targets)
{
    free(targets->vertices);
    free(targets->positions);
    free(targets->mask);
    *targets = (struct skd_targets){0};
}

static enum skd_status grow(struct skd_targets *targets, struct skd_error *error)
{
    size_t capacity = targets->capacity > 0 ? 2 * targets->capacity : 64;
    uint32_t *vertices = realloc(targets->vertices, capacity * sizeof *vertices);
    if (vertices == NULL)
        return skd_fail_memory(error, "the targets");
    targets->vertices = vertices;
    float *positions = realloc(targets->positions, capacity * 3 * sizeof *positions);
    if (positions == NULL)
        return skd_fail_memory(error, "the targets");
    targets->positions = positions;
    float *mask = realloc(targets->mask, capacity * sizeof *mask);
    if (mask == NULL)
        return skd_fail_memory(error, "the targets");
    targets->mask = mask;
    targets->capacity = capacity;
    return SKD_OK;
}

/* mask NAN: none was given. */
static enum skd_status push(struct skd_targets *targets, uint32_t vertex, const double position[3],
                            double mask, struct skd_error *error)
{
    if (targets->count == targets->capacity) {
        enum skd_status status = grow(targets, error);
        if (status != SKD_OK)
            return status;
    }
    targets->vertices[targets->count] = vertex;
    targets->mask[targets->count] = isnan(mask) ? 1 : (float)mask;
    targets->has_mask = targets->has_mask || !isnan(mask);
    for (int i = 0; i < 3; i++)
        targets->positions[3 * targets->count + (size_t)i] = (float)position[i];
    targets->count++;
    return SKD_OK;
}

enum skd_status skd_targets_add(struct skd_targets *targets, const char *what, const char *text,
                                struct skd_error *error)
{
    const char *place = text;
    uint32_t vertex;
    double position[3];
    if (!read_index(&place, &vertex) || *place != '=' || !read_vector(place + 1, position))
        return skd_fail(error, SKD_BAD_PARAMS, "%s takes INDEX=x,y,z, not \"%s\"", what, text);
    return push(targets, vertex, position, (double)NAN, error);
}

static const char *skip_blanks(const char *text)
{
    return text + strspn(text, " \t\r");
}

static bool read_target_line(const char *line, uint32_t *vertex, double position[3], double *mask)
{
    if (!read_index(&line, vertex))
        return false;
    for (int i = 0; i < 3; i++) {
        if (!read_number(&line, &position[i]))
            return false;
    }
    *mask = (double)NAN;
    line = skip_blanks(line);
    if (*line != '\0' && !read_number(&line, mask))
        return false;
    return *skip_blanks(line) == '\0';
}

enum skd_status skd_targets_read(struct skd_targets *targets, const char *path,
                                 struct skd_error *error)
{
    char *text;
    size_t bytes;
    enum skd_status status = skd_file_read(path, &text, &bytes, error);
    if (status != SKD_OK)
        return status;
    char *rest = text;
    for (size_t number = 1; status == SKD_OK && rest != NULL; number++) {
        uint32_t vertex;
        double position[3], mask;
        char *line = strsep(&rest, "\n");
        line[strcspn(line, "#")] = '\0';
        const char *begin = skip_blanks(line);
        if (*begin == '\0')
            continue;
        if (read_target_line(begin, &vertex, position, &mask))
            status = push(targets, vertex, position, mask, error);
        else
            status =
                skd_fail(error, SKD_BAD_PARAMS,
                         "%s, line %zu: \"%.60s\" is not \"index x y z\" or \"index x y z mask\"",
                         path, number, begin);
    }
    free(text);
    return status;
}

static enum skd_status read_stream(FILE *stream, const char *path, char **text, size_t *bytes,
                                   struct skd_error *error)
{
    size_t used = 0, got;
    char *block = NULL;
    do {
        char *longer = used < SKD_FRAME_BYTES_MAX ? realloc(block, used + READ_BYTES + 1) : NULL;
        if (longer == NULL) {
            free(block);
            return skd_fail(error, SKD_NO_MEMORY, "%s is too large to be read", path);
        }
        block = longer;
        got = fread(block + used, 1, READ_BYTES, stream);
        used += got;
    } while (got == READ_BYTES);
    block[used] = '\0';
    if (ferror(stream)) {
        free(block);
        return skd_fail(error, SKD_FILE_IO, "cannot read %s: %s", path, strerror(errno));
    }
    *text = block;
    *bytes = used;
    return SKD_OK;
}

enum skd_status skd_file_read(const char *path, char **text, size_t *bytes, struct skd_error *error)
{
    if (strcmp(path, "-") == 0)
        return read_stream(stdin, "the standard input", text, bytes, error);
    FILE *stream = fopen(path, "rbe");
    if (stream == NULL)
        return skd_fail(error, SKD_NO_FILE, "cannot open %s: %s", path, strerror(errno));
    enum skd_status status = read_stream(stream, path, text, bytes, error);
    fclose(stream);
    return status;
}

enum skd_status skd_file_write(const char *path, const void *data, size_t bytes,
                               struct skd_error *error)
{
    FILE *stream = fopen(path, "wbe");
    if (stream == NULL)
        return skd_fail(error, SKD_FILE_IO, "cannot write %s: %s", path, strerror(errno));
    bool is_whole = fwrite(data, 1, bytes, stream) == bytes;
    if (fclose(stream) != 0 || !is_whole)
        return skd_fail(error, SKD_FILE_IO, "cannot write %s: %s", path, strerror(errno));
    return SKD_OK;
}

enum skd_status skd_value_json(const char *what, const char *text, size_t bytes, cJSON **tree,
                               struct skd_error *error)
{
    struct skd_error found;
    if (skd_json_check(text, bytes, &found) != SKD_OK)
        return skd_fail(error, found.status, "%s: %.300s", what, found.text);
    *tree = cJSON_ParseWithLength(text, bytes);
    return *tree != NULL ? SKD_OK : skd_fail_memory(error, what);
}

enum skd_status skd_path_absolute(const char *path, char absolute[SKD_PATH_BYTES_MAX],
                                  struct skd_error *error)
{
    char folder[SKD_PATH_BYTES_MAX] = "";
    int length;
    if (path[0] != '/' && getcwd(folder, sizeof folder) == NULL)
        return skd_fail(error, SKD_FILE_IO, "cannot tell the current folder: %s", strerror(errno));
    if (path[0] == '/')
        length = snprintf(absolute, SKD_PATH_BYTES_MAX, "%s", path);
    else
        length = snprintf(absolute, SKD_PATH_BYTES_MAX, "%s/%s", folder, path);
    if (length < 0 || length >= SKD_PATH_BYTES_MAX)
        return skd_fail(error, SKD_TOO_LARGE, "the path %.100s... is longer than %d bytes", path,
                        SKD_PATH_BYTES_MAX - 1);
    return SKD_OK;
}

enum skd_status skd_value_size(const char *what, const char *text, double *bytes,
                               struct skd_error *error)
{
    char *end;
    double number = strtod(text, &end);
    double unit = *end == 'K'   ? 1024.0
                  : *end == 'M' ? 1024.0 * 1024
                  : *end == 'G' ? 1024.0 * 1024 * 1024
                                : 1;
    end += unit > 1;
    *bytes = number * unit;
    if (end != text && *end == '\0' && *bytes >= (double)SKD_HISTORY_BYTES_LEAST &&
        *bytes <= (double)SKD_HISTORY_BYTES_LIMIT)
        return SKD_OK;
    return skd_fail(error, SKD_BAD_PARAMS, "%s takes a size from 1M to 16G, not \"%s\"", what,
                    text);
}

unsigned skd_count_texts(char *const *texts)
{
    unsigned count = 0;
    while (texts != NULL && texts[count] != NULL)
        count++;
    return count;
}

void skd_add_texts(cJSON *body, const char *member, char *const *texts)
{
    if (texts != NULL)
        cJSON_AddItemToObject(
            body, member,
            cJSON_CreateStringArray((const char *const *)texts, (int)skd_count_texts(texts)));
}
