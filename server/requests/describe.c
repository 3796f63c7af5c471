/* See describe.h. */
#include "requests/describe.h"

#include "base/log.h"
#include "requests/keeping.h"
#include "requests/listeners.h"
#include "requests/presence.h"

#include <stdio.h>
#include <stdlib.h>

static void add_counts(cJSON *object, const struct skd_session *session, uint64_t revision)
{
    cJSON_AddStringToObject(object, "session", session->name);
    cJSON_AddStringToObject(object, "instance", session->instance);
    cJSON_AddNumberToObject(object, "revision", (double)revision);
    cJSON_AddNumberToObject(object, "vertices", (double)session->rig->mesh.vertex_count);
    cJSON_AddNumberToObject(object, "influences", session->slot_count);
    cJSON_AddStringToObject(object, "durability", skd_durability_words[session->durability]);
}

static void add_use(cJSON *object, const struct skd_live *live)
{
    cJSON_AddStringToObject(object, "journal", skd_keeping_word(live));
    cJSON_AddNumberToObject(object, "attached", skd_listener_count(live));
    cJSON_AddBoolToObject(object, "busy", live->running != NULL);
}

static void add_notes(cJSON *object, const struct skd_rig *rig)
{
    cJSON *notes = cJSON_AddArrayToObject(object, "notes");
    for (int i = 0; i < SKD_NOTE_COUNT; i++) {
        char text[SKD_ERROR_TEXT_BYTES];
        if (rig->notes[i] == 0)
            continue;
        skd_note_text((enum skd_note)i, rig->notes[i], text, sizeof text);
        cJSON *note = cJSON_CreateObject();
        cJSON_AddStringToObject(note, "name", skd_note_name((enum skd_note)i));
        cJSON_AddNumberToObject(note, "count", (double)rig->notes[i]);
        cJSON_AddStringToObject(note, "text", text);
        cJSON_AddItemToArray(notes, note);
    }
}

cJSON *skd_describe_briefly(const struct skd_live *live)
{
    cJSON *object = cJSON_CreateObject();
    add_counts(object, live->session, live->durable_revision);
    cJSON_AddNumberToObject(object, "bones", live->session->rig->skeleton.bone_count);
    add_use(object, live);
    return object;
}

cJSON *skd_describe_created(const struct skd_session *session)
{
    const struct skd_slots_report *slots = &session->slots;
    cJSON *object = cJSON_CreateObject();
    add_counts(object, session, session->revision);
    cJSON_AddNumberToObject(object, "bones", session->rig->skeleton.bone_count);
    cJSON_AddNumberToObject(object, "triangles", (double)session->rig->mesh.triangle_count);
    cJSON_AddNumberToObject(object, "clips", (double)session->rig->nodes.clip_count);
    cJSON_AddNumberToObject(object, "length", session->rig->length);
    add_notes(object, session->rig);
    cJSON *report = cJSON_AddObjectToObject(object, "slots");
    cJSON_AddNumberToObject(report, "reduced", (double)slots->reduced_count);
    cJSON_AddNumberToObject(report, "filled", (double)slots->filled_count);
    cJSON_AddNumberToObject(report, "empty", (double)slots->empty_count);
    cJSON_AddNumberToObject(report, "largest_cut", (double)slots->largest_cut);
    cJSON *moved = cJSON_AddObjectToObject(report, "moved");
    cJSON_AddNumberToObject(moved, "poses", session->reduction.pose_count);
    cJSON_AddNumberToObject(moved, "mean", session->reduction.mean);
    cJSON_AddNumberToObject(moved, "max", session->reduction.max);
    return object;
}

static void add_bones(cJSON *object, const struct skd_skeleton *skeleton)
{
    cJSON *bones = cJSON_AddArrayToObject(object, "bones");
    for (int i = 0; i < skeleton->bone_count; i++) {
        cJSON *bone = cJSON_CreateObject();
        cJSON_AddStringToObject(bone, "name", skeleton->names[i]);
        cJSON_AddNumberToObject(bone, "parent", skeleton->parents[i]);
        cJSON_AddNumberToObject(bone, "skin", skeleton->skins[i]);
        cJSON_AddItemToArray(bones, bone);
    }
}

static void add_clips(cJSON *object, const struct skd_nodes *nodes)
{
    cJSON *clips = cJSON_AddArrayToObject(object, "clips");
    for (size_t i = 0; i < nodes->clip_count; i++) {
        cJSON *clip = cJSON_CreateObject();
        cJSON_AddStringToObject(clip, "name", nodes->clips[i].name);
        cJSON_AddNumberToObject(clip, "duration", nodes->clips[i].duration);
        cJSON_AddItemToArray(clips, clip);
    }
}

static void add_parts(cJSON *object, const struct skd_mesh *mesh)
{
    cJSON *parts = cJSON_AddArrayToObject(object, "parts");
    for (size_t i = 0; i < mesh->part_count; i++) {
        cJSON *part = cJSON_CreateObject();
        cJSON_AddStringToObject(part, "name", mesh->parts[i].name);
        cJSON_AddNumberToObject(part, "first", (double)mesh->parts[i].first_vertex);
        cJSON_AddNumberToObject(part, "count", (double)mesh->parts[i].vertex_count);
        cJSON_AddNumberToObject(part, "skin", mesh->parts[i].skin);
        cJSON_AddItemToArray(parts, part);
    }
}

static void add_history(cJSON *object, const struct skd_history *history)
{
    cJSON_AddNumberToObject(object, "undo_steps", (double)history->position);
    cJSON_AddNumberToObject(object, "redo_steps", (double)(history->count - history->position));
    cJSON_AddNumberToObject(object, "history_bytes", (double)history->bytes_max);
    cJSON_AddNumberToObject(object, "history_used", (double)history->bytes);
}

cJSON *skd_describe_wholly(const struct skd_daemon *daemon, const struct skd_live *live)
{
    const struct skd_session *session = live->session;
    const struct skd_pose *pose, *next;
    cJSON *object = cJSON_CreateObject();
    add_counts(object, session, live->durable_revision);
    add_use(object, live);
    cJSON_AddNumberToObject(object, "triangles", (double)session->rig->mesh.triangle_count);
    cJSON_AddNumberToObject(object, "length", session->rig->length);
    cJSON_AddStringToObject(object, "source", session->source);
    add_bones(object, &session->rig->skeleton);
    add_clips(object, &session->rig->nodes);
    cJSON *poses = cJSON_AddArrayToObject(object, "poses");
    HASH_ITER(hh, session->poses.by_name, pose, next)
    cJSON_AddItemToArray(poses, cJSON_CreateString(pose->name));
    add_parts(object, &session->rig->mesh);
    add_notes(object, session->rig);
    cJSON_AddNumberToObject(object, "exported", (double)session->exported);
    add_history(object, &session->history);
    cJSON_AddNumberToObject(object, "bytes", (double)skd_session_bytes(session));
    cJSON_AddNumberToObject(object, "journal_bytes",
                            live->journal != NULL ? (double)skd_journal_bytes(live->journal) : 0);
    if (session->damage[0] != '\0')
        cJSON_AddStringToObject(object, "damage", session->damage);
    cJSON_AddItemToObject(object, "present", skd_presence_describe(daemon, live));
    return object;
}

/* ---- the state folder ----------------------------------------------------------------------- */

static void add_closed(cJSON *list, const struct skd_state_file *file)
{
    if (file->session[0] == '\0')
        return; /* somebody put it there; it has no name to be opened by */
    cJSON *item = cJSON_CreateObject();
    cJSON_AddStringToObject(item, "session", file->session);
    cJSON_AddNumberToObject(item, "bytes", (double)file->bytes);
    cJSON_AddNumberToObject(item, "closed_at", (double)file->changed_s);
    cJSON_AddItemToArray(list, item);
}

static void add_damaged(cJSON *list, const struct skd_state_file *file)
{
    char text[SKD_ERROR_TEXT_BYTES];
    cJSON *item = cJSON_CreateObject();
    (void)snprintf(text, sizeof text,
                   "the file of session \"%s\" as it was found damaged; what was whole of it, if "
                   "anything, is in use",
                   file->session);
    cJSON_AddStringToObject(item, "file", file->name);
    cJSON_AddStringToObject(item, "text", text);
    cJSON_AddItemToArray(list, item);
}

static void add_part(const char *folder, enum skd_state_part part, cJSON *list,
                     void (*add)(cJSON *list, const struct skd_state_file *file))
{
    struct skd_state_files files;
    struct skd_error error;
    if (skd_state_list(folder, part, &files, &error) != SKD_OK) {
        skd_log(SKD_LOG_WARNING, "%s", error.text);
        return;
    }
    for (size_t i = 0; i < files.count && i < SKD_CLOSED_FILES_MAX; i++)
        add(list, &files.items[i]);
    free(files.items);
}

void skd_describe_folder(const struct skd_keeping *keeping, cJSON *object)
{
    cJSON *closed = cJSON_AddArrayToObject(object, "closed");
    cJSON *damaged = cJSON_AddArrayToObject(object, "damaged");
    const cJSON *file;
    add_part(keeping->folder, SKD_STATE_CLOSED, closed, add_closed);
    cJSON_ArrayForEach(file, keeping->unopened)
        cJSON_AddItemToArray(damaged, cJSON_Duplicate(file, true));
    add_part(keeping->folder, SKD_STATE_DAMAGED, damaged, add_damaged);
}
