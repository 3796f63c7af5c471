/* See print.h. */
#include "clients/cli/print.h"

#include "clients/cli/cli.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static const double progress_first_s = 0.3, progress_again_s = 0.1;

/* null is how JSON writes a number that is not finite. 9 and 17 digits give the same bits back. */
static void print_element(const struct skd_buffer *buffer, size_t index)
{
    double value;
    switch (buffer->dtype) {
    case SKD_U8:
        printf("%" PRIu8, ((const uint8_t *)buffer->data)[index]);
        return;
    case SKD_U16:
        printf("%" PRIu16, ((const uint16_t *)buffer->data)[index]);
        return;
    case SKD_U32:
        printf("%" PRIu32, ((const uint32_t *)buffer->data)[index]);
        return;
    case SKD_I32:
        printf("%" PRId32, ((const int32_t *)buffer->data)[index]);
        return;
    case SKD_F32:
        value = (double)((const float *)buffer->data)[index];
        break;
    default:
        value = ((const double *)buffer->data)[index];
        break;
    }
    if (!isfinite(value))
        fputs("null", stdout);
    else
        printf("%.*g", buffer->dtype == SKD_F32 ? 9 : 17, value);
}

/* How many of the nested lists begin before this element, or end after it if `index` is one more.
 */
static int lists_at(const struct skd_buffer *buffer, size_t index)
{
    int lists = 0;
    size_t elements = 1;
    for (int d = buffer->dimensions - 1; d >= 0; d--) {
        elements *= (size_t)buffer->shape[d];
        lists += index % elements == 0;
    }
    return lists;
}

static void print_many(char letter, int count)
{
    for (int i = 0; i < count; i++)
        putchar(letter);
}

/* Prints the elements as nested lists. */
static void print_buffer(const struct skd_buffer *buffer)
{
    if (buffer->count == 0)
        fputs("[]", stdout);
    for (size_t i = 0; i < buffer->count; i++) {
        if (i > 0)
            putchar(',');
        print_many('[', lists_at(buffer, i));
        print_element(buffer, i);
        print_many(']', lists_at(buffer, i + 1));
    }
}

static const struct skd_buffer *buffer_of(const struct skd_message *message, const cJSON *value)
{
    const cJSON *index = cJSON_GetObjectItemCaseSensitive(value, "buffer");
    if (message == NULL || !cJSON_IsNumber(index) || index->next != NULL || index->prev != index ||
        index->valueint < 0 || index->valueint >= message->buffer_count)
        return NULL;
    return &message->buffers[index->valueint];
}

static void print_text(const cJSON *value)
{
    char *text = cJSON_PrintUnformatted(value);
    fputs(text != NULL ? text : "null", stdout);
    cJSON_free(text);
}

static void print_value(const struct skd_message *message, const cJSON *value)
{
    const struct skd_buffer *buffer = cJSON_IsObject(value) ? buffer_of(message, value) : NULL;
    if (buffer != NULL) {
        print_buffer(buffer);
        return;
    }
    if (!cJSON_IsObject(value) && !cJSON_IsArray(value)) {
        print_text(value);
        return;
    }
    bool is_object = cJSON_IsObject(value);
    putchar(is_object ? '{' : '[');
    for (const cJSON *item = value->child; item != NULL; item = item->next) {
        if (item != value->child)
            putchar(',');
        if (is_object) {
            cJSON name = {.type = cJSON_String, .valuestring = item->string};
            print_text(&name);
            putchar(':');
        }
        print_value(message, item);
    }
    putchar(is_object ? '}' : ']');
}

void skd_print_json(const struct skd_message *message, const cJSON *value)
{
    print_value(message, value);
    putchar('\n');
    fflush(stdout);
}

void skd_print_own_json(cJSON *value)
{
    skd_print_json(NULL, value);
    cJSON_Delete(value);
}

void skd_print_raw_written(const char *path, size_t vertices)
{
    if (!skd_cli.json)
        return;
    cJSON *json = cJSON_CreateObject();
    cJSON_AddStringToObject(json, "raw", path);
    cJSON_AddNumberToObject(json, "vertices", (double)vertices);
    skd_print_own_json(json);
}

double skd_json_number(const cJSON *object, const char *name)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, name);
    return cJSON_IsNumber(item) ? item->valuedouble : 0;
}

const char *skd_json_text(const cJSON *object, const char *name)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, name);
    return cJSON_IsString(item) ? item->valuestring : "";
}

const char *skd_count_text(double count, char text[SKD_COUNT_TEXT_BYTES])
{
    char digits[SKD_COUNT_TEXT_BYTES];
    int length = snprintf(digits, sizeof digits / 2, "%.0f", count);
    int used = 0;
    for (int i = 0; i < length && i < (int)sizeof digits / 2 - 1; i++) {
        if (i > 0 && digits[i - 1] != '-' && (length - i) % 3 == 0)
            text[used++] = ',';
        text[used++] = digits[i];
    }
    text[used] = '\0';
    return text;
}

const char *skd_bytes_text(double bytes, char text[SKD_COUNT_TEXT_BYTES])
{
    static const char *const units[] = {"bytes", "KiB", "MiB", "GiB"};
    size_t unit = 0;
    for (; bytes >= 1024 && unit < 3; unit++)
        bytes /= 1024;
    (void)snprintf(text, SKD_COUNT_TEXT_BYTES, "%.*f %s", unit > 0 && bytes < 10 ? 1 : 0, bytes,
                   units[unit]);
    return text;
}

const char *skd_time_text(double seconds, char text[SKD_TIME_TEXT_BYTES])
{
    const time_t whole = (time_t)seconds;
    struct tm local;
    if (localtime_r(&whole, &local) == NULL ||
        strftime(text, SKD_TIME_TEXT_BYTES, "%Y-%m-%d %H:%M", &local) == 0)
        text[0] = '\0';
    return text;
}

/* Names come out of files and from other tools: what could steer a terminal is not passed on. */
static void make_printable(char *text)
{
    for (char *letter = text; *letter != '\0'; letter++) {
        if ((unsigned char)*letter < ' ' || *letter == 0x7F)
            *letter = '?';
    }
}

const char *skd_person_text(const cJSON *presence, char text[SKD_AUTHOR_TEXT_BYTES])
{
    struct skd_author author;
    (void)snprintf(author.client, sizeof author.client, "%s", skd_json_text(presence, "client"));
    (void)snprintf(author.user, sizeof author.user, "%s", skd_json_text(presence, "user"));
    (void)skd_author_text(&author, text);
    make_printable(text);
    return text;
}

void skd_print_exported(const cJSON *result)
{
    char bytes[SKD_COUNT_TEXT_BYTES];
    printf("wrote %s: %s, revision %.0f, largest rounding of a weight %.2g\n",
           skd_json_text(result, "path"), skd_bytes_text(skd_json_number(result, "bytes"), bytes),
           skd_json_number(result, "revision"), skd_json_number(result, "largest_rounding"));
}

void skd_print_step(const cJSON *result)
{
    char vertices[SKD_COUNT_TEXT_BYTES];
    printf("revision %.0f: %s vertices changed; %.0f steps to undo, %.0f to redo\n",
           skd_json_number(result, "revision"),
           skd_count_text(skd_json_number(result, "vertices"), vertices),
           skd_json_number(result, "undo_steps"), skd_json_number(result, "redo_steps"));
}

static char *copy_printable(const char *text)
{
    char *copy = strdup(text);
    if (copy != NULL)
        make_printable(copy);
    return copy;
}

void skd_table_add(struct skd_table *table, const char *const *cells)
{
    size_t columns = (size_t)table->columns, first = table->rows * columns;
    char **longer = realloc(table->cells, (first + columns) * sizeof *longer);
    if (longer == NULL)
        return;
    table->cells = longer;
    for (size_t i = 0; i < columns; i++)
        longer[first + i] = copy_printable(cells[i]);
    table->rows++;
}

/* Columns of a terminal that a UTF-8 text takes: its characters. */
static int width_of(const char *text)
{
    int width = 0;
    for (; text != NULL && *text != '\0'; text++)
        width += (*text & 0xC0) != 0x80;
    return width;
}

static void print_row(const struct skd_table *table, const char *const *cells, const int *widths,
                      int indent)
{
    printf("%*s", indent, "");
    for (int i = 0; i < table->columns; i++) {
        const char *cell = cells[i] != NULL ? cells[i] : "";
        int padding = widths[i] - width_of(cell);
        bool is_last = i + 1 == table->columns;
        if (table->is_number[i])
            printf("%*s%s", padding, "", cell);
        else
            printf("%s%*s", cell, is_last ? 0 : padding, "");
        fputs(is_last ? "\n" : "  ", stdout);
    }
}

void skd_table_print(struct skd_table *table, int indent)
{
    int widths[SKD_COLUMNS_MAX] = {0};
    size_t count = table->rows * (size_t)table->columns;
    for (int i = 0; i < table->columns; i++)
        widths[i] = width_of(table->titles[i]);
    for (size_t i = 0; i < count; i++) {
        int *width = &widths[i % (size_t)table->columns];
        if (width_of(table->cells[i]) > *width)
            *width = width_of(table->cells[i]);
    }
    print_row(table, table->titles, widths, indent);
    for (size_t row = 0; row < table->rows; row++)
        print_row(table, (const char *const *)table->cells + row * (size_t)table->columns, widths,
                  indent);
    for (size_t i = 0; i < count; i++)
        free(table->cells[i]);
    free(table->cells);
    table->cells = NULL;
    table->rows = 0;
}

void skd_print_sessions(const cJSON *sessions)
{
    static const char *const counts[] = {"revision", "vertices", "bones", "influences", "attached"};
    struct skd_table table = {
        .columns = 8,
        .titles = {"session", "revision", "vertices", "bones", "influences", "here", "durability",
                   "journal"},
        .is_number = {[1] = true, [2] = true, [3] = true, [4] = true, [5] = true}};
    const cJSON *item;
    cJSON_ArrayForEach(item, sessions)
    {
        char texts[5][SKD_COUNT_TEXT_BYTES];
        const char *cells[8] = {
            skd_json_text(item, "session"), [6] = skd_json_text(item, "durability"),
            skd_json_text(item, "journal")};
        for (int i = 0; i < 5; i++)
            cells[i + 1] = skd_count_text(skd_json_number(item, counts[i]), texts[i]);
        skd_table_add(&table, cells);
    }
    if (table.rows > 0)
        skd_table_print(&table, 0);
    else
        puts("no rig session is open");
}

void skd_print_present(const cJSON *present)
{
    struct skd_table table = {.columns = 4, .titles = {"here", "version", "since", "claims"}};
    const cJSON *item;
    cJSON_ArrayForEach(item, present)
    {
        const cJSON *claim = cJSON_GetObjectItemCaseSensitive(item, "claim");
        double vertices = skd_json_number(claim, "vertices");
        int bones = cJSON_GetArraySize(cJSON_GetObjectItemCaseSensitive(claim, "bones"));
        char person[SKD_AUTHOR_TEXT_BYTES], since[SKD_TIME_TEXT_BYTES], claims[64] = "";
        if (bones > 0 || vertices > 0)
            (void)snprintf(claims, sizeof claims, "%d bones, %.0f vertices", bones, vertices);
        skd_table_add(&table, (const char *const[]){
                                  skd_person_text(item, person), skd_json_text(item, "version"),
                                  skd_time_text(skd_json_number(item, "since"), since), claims});
    }
    if (table.rows > 0)
        skd_table_print(&table, 0);
    else
        puts("nobody is here");
}

double skd_clock_s(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void skd_progress_begin(struct skd_progress *progress, const char *what)
{
    *progress = (struct skd_progress){
        .what = what, .begun_s = skd_clock_s(), .is_silent = skd_cli.quiet || !isatty(2)};
}

void skd_progress_set(struct skd_progress *progress, double fraction)
{
    double now = skd_clock_s();
    if (progress->is_silent || now - progress->begun_s < progress_first_s ||
        now - progress->shown_s < progress_again_s)
        return;
    fprintf(stderr, "\r%s %3.0f %%\033[K", progress->what, 100 * fraction);
    progress->shown_s = now;
}

void skd_progress_end(struct skd_progress *progress)
{
    if (progress->shown_s > 0)
        fputs("\r\033[K", stderr);
    progress->shown_s = 0;
}
