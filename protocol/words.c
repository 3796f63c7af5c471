/* The words that both sides spell the same: methods and choices. See request.h. */
#include "protocol/request.h"

const char *const skd_method_words[] = {"exact", "thesis", NULL};
const char *const skd_constraint_words[] = {"simplex", "affine", NULL};
const char *const skd_fill_words[] = {"hop", "infect", "neighbours", "none", NULL};

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
