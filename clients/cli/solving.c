/* See solving.h. */
#include "clients/cli/solving.h"

#include "clients/cli/values.h"

#include <math.h>

static struct {
    char *method;
    char *constraint;
    double stiffness;
    char *pin;
    char *slots;
    double guard;
    double smooth;
    double mix;
    char *residual;
    char **lock_bones;
} options = {
    .stiffness = (double)NAN, .guard = (double)NAN, .smooth = (double)NAN, .mix = (double)NAN};

const struct poptOption skd_solving_options[] = {
    {"slots", 0, POPT_ARG_STRING, &options.slots, 0,
     "keep (default) a vertex's bones, or choose them by the evidence of all pinned poses", "RULE"},
    {"stiffness", 'k', POPT_ARG_DOUBLE, &options.stiffness, 0,
     "how hard weights hold on to what they were, 0 to 10 (default: chosen from the data)", "K"},
    {"guard", 'g', POPT_ARG_DOUBLE, &options.guard, 0,
     "how much the session's guard poses count, 0 to 1000 (default: 0.3)", "L"},
    {"smooth", 0, POPT_ARG_DOUBLE, &options.smooth, 0,
     "how much neighbours are to change alike, 0 to 10 (default: 0)", "M"},
    {"residual", 0, POPT_ARG_STRING, &options.residual, 0,
     "what weights cannot reach: report (default) it, move the rest, or make a corrective shape",
     "RULE"},
    {"constraint", 0, POPT_ARG_STRING, &options.constraint, 0,
     "simplex (default: no negative weights) or affine", "KIND"},
    {"lock-bone", 'l', POPT_ARG_ARGV, &options.lock_bones, 0,
     "leave this bone's weights alone; may be repeated", "NAME"},
    POPT_TABLEEND,
};

const struct poptOption skd_sculpt_options[] = {
    {"method", 0, POPT_ARG_STRING, &options.method, 0, "exact (default) or thesis", "METHOD"},
    {"pin", 0, POPT_ARG_STRING, &options.pin, 0,
     "set (default) the vertices' pins in this pose, move them, or none: leave them alone", "RULE"},
    {"mix", 0, POPT_ARG_DOUBLE, &options.mix, 0,
     "how far to go from the surface to the targets, 0 to 1 (default: 1)", "SHARE"},
    POPT_TABLEEND,
};

static bool put_text(char **member, char *text)
{
    if (text != NULL)
        *member = text;
    return text != NULL;
}

static bool put_number(double **member, double *number)
{
    if (!isnan(*number))
        *member = number;
    return !isnan(*number);
}

bool skd_solving_apply(struct skd_script_stroke *stroke)
{
    bool is_said = put_text(&stroke->method, options.method);
    is_said |= put_text(&stroke->constraint, options.constraint);
    is_said |= put_text(&stroke->pin, options.pin);
    is_said |= put_text(&stroke->slots, options.slots);
    is_said |= put_text(&stroke->residual, options.residual);
    is_said |= put_number(&stroke->stiffness, &options.stiffness);
    is_said |= put_number(&stroke->guard, &options.guard);
    is_said |= put_number(&stroke->smooth, &options.smooth);
    is_said |= put_number(&stroke->mix, &options.mix);
    if (options.lock_bones != NULL) {
        stroke->lock_bones = options.lock_bones;
        stroke->lock_bones_count = skd_count_texts(options.lock_bones);
    }
    return is_said || options.lock_bones != NULL;
}
