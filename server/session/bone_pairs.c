/* See bone_pairs.h. */
#include "session/bone_pairs.h"

#include <stdlib.h>
#include <string.h>

enum { SIDES_MAX = 8 }; /* of one name; more are not looked at */

/* What the two sides are called. The last is Japanese, as MikuMikuDance's bones are. */
static const char *const words[][2] = {
    {"left", "right"}, {"Left", "Right"}, {"LEFT", "RIGHT"},
    {"l", "r"},        {"L", "R"},        {"\xe5\xb7\xa6", "\xe5\x8f\xb3"},
};
enum { WORD_LOWER, WORD_CAPITAL, WORD_UPPER, LETTER_LOWER, LETTER_UPPER, WORD_JAPANESE, WORDS };

/* A place in a name that says a side. */
struct side {
    size_t at;
    int word;
    int which;   /* 0 left, 1 right */
    bool surely; /* else it may be chance, as in "bright" */
};

/* The bones sorted by skin and name. */
struct index {
    const struct skd_skeleton *skeleton;
    uint16_t *bones; /* [bones] */
};

static bool is_lower(char c)
{
    return c >= 'a' && c <= 'z';
}

static bool is_upper(char c)
{
    return c >= 'A' && c <= 'Z';
}

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static bool is_letter(char c)
{
    return is_lower(c) || is_upper(c);
}

/* Whether what stands around a word lets it be a word of its own. */
static bool stands_alone(int word, char before, char after)
{
    switch (word) {
    case WORD_LOWER:
        return !is_letter(before) && !is_lower(after);
    case WORD_CAPITAL:
        return !is_lower(after);
    case WORD_UPPER:
        return !is_upper(before) && !is_upper(after);
    case WORD_JAPANESE:
        return true;
    default:
        return !is_letter(before) && !is_digit(before) && !is_letter(after) && !is_digit(after);
    }
}

/* Whether it may be one, if the other side's name is there: "lShldr", "armL", "leftarm". */
static bool may_stand(int word, char before, char after)
{
    switch (word) {
    case LETTER_LOWER:
        return !is_letter(before) && !is_lower(after);
    case LETTER_UPPER:
        return !is_upper(before) && !is_lower(after);
    default:
        return true;
    }
}

static int find_sides(const char *name, struct side sides[SIDES_MAX])
{
    int count = 0;
    for (size_t at = 0; name[at] != '\0' && count < SIDES_MAX; at++) {
        for (int word = 0; word < WORDS && count < SIDES_MAX; word++) {
            for (int which = 0; which < 2 && count < SIDES_MAX; which++) {
                size_t length = strlen(words[word][which]);
                if (strncmp(name + at, words[word][which], length) != 0)
                    continue;
                char before = at > 0 ? name[at - 1] : '\0', after = name[at + length];
                bool surely = stands_alone(word, before, after);
                if (surely || may_stand(word, before, after))
                    sides[count++] = (struct side){at, word, which, surely};
            }
        }
    }
    return count;
}

/* The name with some of its sides turned round: the sure ones (`only` < 0), or that one. */
static void turn_round(const char *name, const struct side *sides, int count, int only, char *out)
{
    size_t from = 0, used = 0;
    for (int i = 0; i < count; i++) {
        const struct side *side = &sides[i];
        if ((only < 0 ? !side->surely : i != only) || side->at < from)
            continue;
        const char *other = words[side->word][1 - side->which];
        memcpy(out + used, name + from, side->at - from);
        used += side->at - from;
        memcpy(out + used, other, strlen(other));
        used += strlen(other);
        from = side->at + strlen(words[side->word][side->which]);
    }
    memcpy(out + used, name + from, strlen(name + from) + 1);
}

static int compare_names(const struct skd_skeleton *skeleton, uint16_t bone, uint16_t skin,
                         const char *name)
{
    if (skeleton->skins[bone] != skin)
        return skeleton->skins[bone] < skin ? -1 : 1;
    return strcmp(skeleton->names[bone], name);
}

/* The bone of that name and skin, or -1. */
static int find(const struct index *index, uint16_t skin, const char *name)
{
    int low = 0, high = index->skeleton->bone_count;
    while (low < high) {
        int middle = low + (high - low) / 2;
        int order = compare_names(index->skeleton, index->bones[middle], skin, name);
        if (order == 0)
            return index->bones[middle];
        if (order < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return -1;
}

/* Length of a name without a number at its end: "b_LeftFoot" of "b_LeftFoot_018". */
static size_t stem_length(const char *name)
{
    size_t length = strlen(name), end = length;
    while (end > 0 && is_digit(name[end - 1]))
        end--;
    bool numbered = end > 1 && end < length && strchr("._-", name[end - 1]) != NULL;
    return numbered ? end - 1 : length;
}

/* The only bone of that skin whose name without its number is that of `name`, or -1. */
static int find_by_stem(const struct skd_skeleton *skeleton, uint16_t skin, const char *name)
{
    size_t length = stem_length(name);
    int found = -1;
    for (int bone = 0; bone < skeleton->bone_count; bone++) {
        const char *other = skeleton->names[bone];
        if (skeleton->skins[bone] != skin || strncmp(other, name, length) != 0 ||
            stem_length(other) != length)
            continue;
        if (found >= 0)
            return -1;
        found = bone;
    }
    return found;
}

/* The other side's bone, -1 for a bone that has no side, -2 where it has one and no partner. */
static int find_partner(const struct index *index, int bone)
{
    const struct skd_skeleton *skeleton = index->skeleton;
    struct side sides[SIDES_MAX];
    char name[SKD_NAME_BYTES_MAX + 4 * SIDES_MAX];
    uint16_t skin = skeleton->skins[bone];
    int count = find_sides(skeleton->names[bone], sides), partner = -1;
    bool surely = false;
    for (int i = 0; i < count; i++)
        surely = surely || sides[i].surely;
    if (surely) {
        turn_round(skeleton->names[bone], sides, count, -1, name);
        partner = find(index, skin, name);
    }
    for (int i = count - 1; i >= 0 && partner < 0; i--) {
        turn_round(skeleton->names[bone], sides, count, i, name);
        partner = find(index, skin, name);
    }
    if (surely && partner < 0) {
        turn_round(skeleton->names[bone], sides, count, -1, name);
        partner = find_by_stem(skeleton, skin, name);
    }
    return partner < 0 && surely ? -2 : partner;
}

static int compare_bones(const void *left, const void *right, const struct skd_skeleton *skeleton)
{
    uint16_t a = *(const uint16_t *)left, b = *(const uint16_t *)right;
    return compare_names(skeleton, a, skeleton->skins[b], skeleton->names[b]);
}

/* Merge sort: the C library's has no way to hand the skeleton through. */
static void sort_bones(const struct skd_skeleton *skeleton, uint16_t *bones, uint16_t *spare,
                       int count)
{
    if (count < 2)
        return;
    int half = count / 2, left = 0, right = half, out = 0;
    sort_bones(skeleton, bones, spare, half);
    sort_bones(skeleton, bones + half, spare, count - half);
    while (left < half && right < count)
        spare[out++] = compare_bones(bones + left, bones + right, skeleton) <= 0 ? bones[left++]
                                                                                 : bones[right++];
    while (left < half)
        spare[out++] = bones[left++];
    memcpy(bones, spare, (size_t)out * sizeof *bones);
}

enum skd_status skd_bone_pairs_build(const struct skd_skeleton *skeleton,
                                     struct skd_bone_pairs *pairs, struct skd_error *error)
{
    size_t count = (size_t)skeleton->bone_count;
    struct index index = {skeleton, malloc(count * sizeof(uint16_t) + 1)};
    int *found = malloc(count * sizeof *found + 1);
    pairs->partners = malloc(count * sizeof *pairs->partners + 1);
    pairs->unpaired = calloc(count + 1, 1);
    bool enough =
        index.bones != NULL && found != NULL && pairs->partners != NULL && pairs->unpaired != NULL;
    if (enough) {
        for (size_t bone = 0; bone < count; bone++)
            index.bones[bone] = (uint16_t)bone;
        sort_bones(skeleton, index.bones, pairs->partners, skeleton->bone_count);
        for (int bone = 0; bone < skeleton->bone_count; bone++)
            found[bone] = find_partner(&index, bone);
        for (size_t bone = 0; bone < count; bone++) {
            int partner = found[bone];
            bool mutual = partner >= 0 && found[partner] == (int)bone;
            pairs->partners[bone] = (uint16_t)(mutual ? partner : (int)bone);
            pairs->unpaired[bone] = !mutual && partner != -1;
        }
    }
    free(index.bones);
    free(found);
    return enough ? SKD_OK : skd_fail_memory(error, "pairing the bones");
}

void skd_bone_pairs_finish(struct skd_bone_pairs *pairs)
{
    free(pairs->partners);
    free(pairs->unpaired);
    *pairs = (struct skd_bone_pairs){0};
}
