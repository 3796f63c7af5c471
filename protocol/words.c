/* See words.h. */
#include "protocol/words.h"

#include "base/error.h"

#include <stddef.h>

const char *const skd_method_words[] = {"exact", "thesis", NULL};
const char *const skd_constraint_words[] = {"simplex", "affine", NULL};
const char *const skd_fill_words[] = {"hop", "infect", "neighbours", "none", NULL};
const char *const skd_reduce_words[] = {"refuse", "largest", "posed", NULL};
const char *const skd_pin_words[] = {"set", "move", "none", NULL};
const char *const skd_slots_words[] = {"keep", "evidence", NULL};
const char *const skd_residual_words[] = {"report", "rest", "shape", NULL};
const char *const skd_reduce_by_words[] = {"poses", "size", NULL};
const char *const skd_durability_words[] = {"full", "second", "off", NULL};
const char *const skd_axis_words[] = {"x", "y", "z", NULL};
const char *const skd_side_words[] = {"+", "-", NULL};

static const char *const method_names[SKD_REQUEST_METHOD_COUNT] = {
#define SKD_REQUEST_NAME(name, wire) [SKD_REQUEST_##name] = wire,
    SKD_REQUESTS(SKD_REQUEST_NAME)
#undef SKD_REQUEST_NAME
};

const char *skd_request_method_name(enum skd_request_method method)
{
    SKD_ASSERT((unsigned)method < SKD_REQUEST_METHOD_COUNT);
    return method_names[method];
}
