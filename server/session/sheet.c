/* See sheet.h. */
#include "session/sheet.h"

#include <stdlib.h>
#include <string.h>

enum { PAGE_ROWS = 1024 };

void skd_sheets_init(struct skd_sheets *sheets, int width, float blank, size_t vertex_count,
                     size_t bone_count)
{
    *sheets = (struct skd_sheets){
        .width = width, .blank = blank, .vertex_count = vertex_count, .bone_count = bone_count};
}

static size_t page_bytes(const struct skd_sheets *sheets)
{
    return PAGE_ROWS * (size_t)sheets->width * sizeof(float);
}

static void destroy(struct skd_sheet *sheet)
{
    for (size_t i = 0; i < sheet->page_count; i++)
        free(sheet->pages[i]);
    free(sheet->pages);
    skd_pose_release(sheet->pose);
    free(sheet);
}

void skd_sheets_finish(struct skd_sheets *sheets)
{
    for (size_t i = 0; i < sheets->count; i++)
        destroy(sheets->items[i]);
    free(sheets->items);
    sheets->items = NULL;
    sheets->count = sheets->capacity = 0;
}

void skd_sheets_drop_idle(struct skd_sheets *sheets)
{
    size_t kept = 0;
    for (size_t i = 0; i < sheets->count; i++) {
        struct skd_sheet *sheet = sheets->items[i];
        if (sheet->used == 0 && !sheet->is_kept) {
            destroy(sheet);
            continue;
        }
        sheet->is_kept = false;
        sheets->items[kept++] = sheet;
    }
    sheets->count = kept;
}

size_t skd_sheets_bytes(const struct skd_sheets *sheets)
{
    size_t bytes = sheets->capacity * sizeof *sheets->items;
    for (size_t i = 0; i < sheets->count; i++) {
        const struct skd_sheet *sheet = sheets->items[i];
        bytes += sizeof *sheet + sheet->page_count * sizeof *sheet->pages;
        for (size_t page = 0; page < sheet->page_count; page++)
            bytes += sheet->pages[page] != NULL ? page_bytes(sheets) : 0;
    }
    return bytes;
}

struct skd_sheet *skd_sheets_find(const struct skd_sheets *sheets, const struct skd_pose *pose)
{
    size_t bytes = sheets->bone_count * SKD_MATRIX_SIZE * sizeof(double);
    for (size_t i = 0; i < sheets->count; i++) {
        struct skd_sheet *sheet = sheets->items[i];
        if (strcmp(sheet->pose->name, pose->name) == 0 &&
            memcmp(sheet->pose->matrices, pose->matrices, bytes) == 0)
            return sheet;
    }
    return NULL;
}

static size_t count_used(const struct skd_sheets *sheets)
{
    size_t used = 0;
    for (size_t i = 0; i < sheets->count; i++)
        used += sheets->items[i]->used > 0;
    return used;
}

static enum skd_status make_room(struct skd_sheets *sheets, struct skd_error *error)
{
    if (sheets->count < sheets->capacity)
        return SKD_OK;
    size_t capacity = sheets->capacity == 0 ? 16 : sheets->capacity * 2;
    struct skd_sheet **items = realloc(sheets->items, capacity * sizeof *items);
    if (items == NULL)
        return skd_fail_memory(error, "another pose's targets");
    sheets->items = items;
    sheets->capacity = capacity;
    return SKD_OK;
}

/* Which of two poses' sheets stands first: by name, and of one name by matrices. The order in which
 * strokes add poses up decides last bits, so it must not depend on what was tried before. */
static bool stands_before(const struct skd_sheets *sheets, const struct skd_pose *a,
                          const struct skd_pose *b)
{
    int names = strcmp(a->name, b->name);
    return names != 0 ? names < 0
                      : memcmp(a->matrices, b->matrices,
                               sheets->bone_count * SKD_MATRIX_SIZE * sizeof(double)) < 0;
}

static struct skd_sheet *add(struct skd_sheets *sheets, struct skd_pose *pose)
{
    struct skd_sheet *sheet = calloc(1, sizeof *sheet);
    if (sheet == NULL)
        return NULL;
    sheet->width = sheets->width;
    sheet->page_count = (sheets->vertex_count + PAGE_ROWS - 1) / PAGE_ROWS;
    sheet->pages = calloc(sheet->page_count + 1, sizeof *sheet->pages);
    if (sheet->pages == NULL) {
        free(sheet);
        return NULL;
    }
    sheet->pose = skd_pose_hold(pose);
    size_t place = sheets->count++;
    for (; place > 0 && stands_before(sheets, pose, sheets->items[place - 1]->pose); place--)
        sheets->items[place] = sheets->items[place - 1];
    sheets->items[place] = sheet;
    return sheet;
}

enum skd_status skd_sheets_need(struct skd_sheets *sheets, struct skd_pose *pose,
                                struct skd_sheet **result, struct skd_error *error)
{
    struct skd_sheet *sheet = skd_sheets_find(sheets, pose);
    if ((sheet == NULL || sheet->used == 0) && count_used(sheets) == SKD_TARGET_POSES_MAX)
        return skd_fail(error, SKD_TOO_LARGE,
                        "the session has targets in %d poses already; clear the pins of some",
                        SKD_TARGET_POSES_MAX);
    if (sheet == NULL) {
        enum skd_status status = make_room(sheets, error);
        if (status != SKD_OK)
            return status;
        sheet = add(sheets, pose);
    }
    *result = sheet;
    return sheet != NULL ? SKD_OK : skd_fail_memory(error, "another pose's targets");
}

enum skd_status skd_sheet_reserve(const struct skd_sheets *sheets, struct skd_sheet *sheet,
                                  const uint32_t *vertices, size_t count, struct skd_error *error)
{
    size_t numbers = PAGE_ROWS * (size_t)sheets->width;
    for (size_t i = 0; i < count; i++) {
        float **page = &sheet->pages[vertices[i] / PAGE_ROWS];
        if (*page != NULL)
            continue;
        *page = malloc(page_bytes(sheets));
        if (*page == NULL)
            return skd_fail_memory(error, "more targets");
        for (size_t k = 0; k < numbers; k++)
            (*page)[k] = sheets->blank;
    }
    return SKD_OK;
}

static bool is_blank(const struct skd_sheets *sheets, const float *row)
{
    for (int k = 0; k < sheets->width; k++) {
        if (row[k] < sheets->blank || row[k] > sheets->blank)
            return false;
    }
    return true;
}

static float *find_row(const struct skd_sheet *sheet, uint32_t vertex)
{
    float *page = sheet->pages[vertex / PAGE_ROWS];
    return page != NULL ? page + (vertex % PAGE_ROWS) * (size_t)sheet->width : NULL;
}

const float *skd_sheet_row(const struct skd_sheets *sheets, const struct skd_sheet *sheet,
                           uint32_t vertex)
{
    const float *row = find_row(sheet, vertex);
    return row != NULL && !is_blank(sheets, row) ? row : NULL;
}

void skd_sheet_list(const struct skd_sheets *sheets, const struct skd_sheet *sheet, uint32_t *out)
{
    size_t count = 0;
    for (size_t vertex = 0; vertex < sheets->vertex_count && count < sheet->used; vertex++) {
        if (skd_sheet_row(sheets, sheet, (uint32_t)vertex) != NULL)
            out[count++] = (uint32_t)vertex;
    }
}

struct skd_sheet_change *skd_sheet_change_create(struct skd_sheets *sheets, struct skd_sheet *sheet,
                                                 const uint32_t *vertices, size_t count,
                                                 struct skd_error *error)
{
    size_t row_bytes = (size_t)sheets->width * sizeof(float);
    struct skd_sheet_change *change = calloc(1, sizeof *change);
    if (change != NULL) {
        change->vertices = malloc(count * sizeof *vertices + 1);
        change->before = malloc(count * row_bytes + 1);
        change->after = malloc(count * row_bytes + 1);
    }
    if (change == NULL || change->vertices == NULL || change->before == NULL ||
        change->after == NULL) {
        (void)skd_fail_memory(error, "more targets");
        goto fail;
    }
    if (skd_sheet_reserve(sheets, sheet, vertices, count, error) != SKD_OK)
        goto fail;
    change->sheets = sheets;
    change->sheet = sheet;
    change->count = count;
    for (size_t i = 0; i < count; i++) {
        change->vertices[i] = vertices[i];
        memcpy((char *)change->before + i * row_bytes, find_row(sheet, vertices[i]), row_bytes);
    }
    memcpy(change->after, change->before, count * row_bytes);
    return change;
fail:
    skd_sheet_change_destroy(change);
    return NULL;
}

void skd_sheet_change_destroy(struct skd_sheet_change *change)
{
    while (change != NULL) {
        struct skd_sheet_change *next = change->next;
        free(change->vertices);
        free(change->before);
        free(change->after);
        free(change);
        change = next;
    }
}

void skd_sheet_change_write(struct skd_sheet_change *change, bool undo)
{
    const struct skd_sheets *sheets = change->sheets;
    size_t width = (size_t)sheets->width;
    const float *source = undo ? change->before : change->after;
    for (size_t i = 0; i < change->count; i++, source += width) {
        float *row = find_row(change->sheet, change->vertices[i]);
        change->sheet->used += (size_t)is_blank(sheets, row) - (size_t)is_blank(sheets, source);
        memcpy(row, source, width * sizeof(float));
    }
}

size_t skd_sheet_change_bytes(const struct skd_sheet_change *change)
{
    size_t bytes = 0;
    for (; change != NULL; change = change->next)
        bytes +=
            sizeof *change +
            change->count * (sizeof(uint32_t) + 2 * (size_t)change->sheets->width * sizeof(float));
    return bytes;
}
