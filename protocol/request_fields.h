/* Tables that say what a method's parameters are, and the one function that reads by them.
 *
 * Stage: request. Thread: any. Private to the protocol library: request.c holds the tables.
 * A row says a member's name, kind and range, and where in the params struct its value goes.
 */
#ifndef SKD_PROTOCOL_REQUEST_FIELDS_H
#define SKD_PROTOCOL_REQUEST_FIELDS_H

#include "protocol/request.h"

enum skd_field_kind {
    SKD_FIELD_TEXT,    /* const char *: low to high bytes */
    SKD_FIELD_SESSION, /* const char *: a session's name, [A-Za-z0-9_-][A-Za-z0-9._-]* */
    SKD_FIELD_PATH,    /* const char *: absolute */
    SKD_FIELD_FLAG,    /* bool */
    SKD_FIELD_WHOLE,   /* int: low to high */
    SKD_FIELD_COUNTER, /* uint64_t: 0 to 2^53 */
    SKD_FIELD_NUMBER,  /* double: finite, low to high */
    SKD_FIELD_WORD,    /* int: index into words */
    SKD_FIELD_ID,      /* struct skd_request_id */
    SKD_FIELD_ARRAY,   /* struct skd_array of dtype, in rows of row_width (0: flat) */
    SKD_FIELD_NAMES,   /* const char **, owned by the request; its length at count_offset, low to
                          high (high 0: as many as JSON can hold) */
    SKD_FIELD_OBJECT   /* members, read into the same struct */
};

/* A row_width: as many as a session has influences, which is not known yet. The rows are of 4 or of
 * 8 numbers; a flat list has rows of one. */
#define SKD_ROW_OF_SLOTS SIZE_MAX

struct skd_field {
    const char *name;
    enum skd_field_kind kind;
    bool is_required;
    size_t offset;       /* of the value in the params struct */
    size_t given_offset; /* of a bool that tells whether the member was there; 0: none */
    size_t count_offset; /* NAMES */
    double low;
    double high;
    double fallback; /* FLAG, WHOLE, NUMBER, WORD: the value of a member that is not there */
    const char *const *words; /* WORD; ends with NULL */
    enum skd_dtype dtype;
    size_t row_width;
    const struct skd_field *members; /* OBJECT; ends with a row without name */
};

/* Reads the members of `object` (NULL: none) into request->params, which is zero before. `fields`
 * ends with a row without name. Errors: SKD_BAD_PARAMS, SKD_NOT_FINITE, SKD_NO_MEMORY, each naming
 * the method and the member. */
SKD_MUST_CHECK enum skd_status skd_fields_read(struct skd_request *request, const cJSON *object,
                                               const struct skd_field *fields,
                                               struct skd_error *error);

#endif
