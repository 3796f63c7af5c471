/* See stroke.h. */
#include "session/stroke.h"

#include <stdio.h>

const char *skd_stroke_warning_name(enum skd_stroke_warning warning)
{
    static const char *const names[] = {
#define SKD_WARNING_NAME(name, wire, text) wire,
        SKD_STROKE_WARNINGS(SKD_WARNING_NAME)
#undef SKD_WARNING_NAME
    };
    return names[warning];
}

void skd_stroke_warning_text(enum skd_stroke_warning warning, size_t count, char *text,
                             size_t text_bytes)
{
    switch (warning) {
#define SKD_WARNING_TEXT(name, wire, sentence)                                                     \
    case SKD_WARNING_##name:                                                                       \
        (void)snprintf(text, text_bytes, sentence, count);                                         \
        return;
        SKD_STROKE_WARNINGS(SKD_WARNING_TEXT)
#undef SKD_WARNING_TEXT
    case SKD_WARNING_COUNT:
        break;
    }
    SKD_ASSERT(false); /* a warning of skd_stroke_warning */
}
