/* Where a glTF rig came from: what an export needs to write the same file with other weights.
 *
 * Stage: rig session (made), export (read). Thread: immutable after import; files are read with
 * pread, so several may.
 * Owns open file descriptors and not the bytes: a million-vertex file is not kept in memory, and
 * the file may be renamed, replaced or unlinked meanwhile. A file that was written into is noticed
 * by its digest.
 */
#ifndef SKD_RIG_GLTF_SOURCE_H
#define SKD_RIG_GLTF_SOURCE_H

#include "base/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Files of more bytes are refused, and so are glTF files with more buffers in files. */
#define SKD_FILE_BYTES_MAX ((size_t)UINT32_MAX)
enum { SKD_GLTF_FILES_MAX = 64 };

/* A file that was read once. */
struct skd_gltf_file {
    char *path; /* as opened, for messages */
    int fd;     /* -1: this buffer is not a file */
    size_t bytes;
    bool is_read;
    uint64_t digest[2]; /* XXH3, 128 bits */
};

struct skd_gltf_document;

struct skd_gltf_source {
    char *path;    /* of the main file, as given */
    int folder_fd; /* its folder */
    struct skd_gltf_file main;
    bool is_known;                   /* what its files are: no others are opened any more */
    size_t external_count;           /* buffers of the file */
    struct skd_gltf_file *externals; /* [external_count] */
    /* What the main file's JSON says; NULL until it was read. That of a rig image has no more than
     * an export needs: views, accessors, primitives, and the meshes of nodes. */
    struct skd_gltf_document *document;
    /* Joint numbers of the file <-> bones of the rig, in which a joint that stands twice is one. */
    int skin_count;
    uint32_t *skin_joints;   /* [skins + 1] first joint of each skin in bone_of_joint */
    uint16_t *bone_of_joint; /* [all joints] */
    uint16_t *joint_of_bone; /* [bones] within its skin */
};

/* Opens the file and its folder; reads nothing.
 * Errors: SKD_NO_FILE, SKD_FILE_IO, SKD_NOT_GLTF (a folder, a device), SKD_TOO_LARGE,
 * SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status
skd_gltf_source_open(const char *path, struct skd_gltf_source **source, struct skd_error *error);
/* Opens a file beside it. */
SKD_MUST_CHECK enum skd_status skd_gltf_file_open(int folder_fd, const char *path,
                                                  struct skd_gltf_file *file,
                                                  struct skd_error *error);
void skd_gltf_file_close(struct skd_gltf_file *file);

/* Reads a whole file into *bytes, the caller's to free, with a 0 byte behind the last. The first
 * read notes the digest, later ones fail with SKD_SOURCE_CHANGED when it is another.
 * Errors: SKD_FILE_IO, SKD_SOURCE_CHANGED, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_file_read(struct skd_gltf_file *file, uint8_t **bytes,
                                                  struct skd_error *error);

/* Makes room for the files of `count` buffers, none of them open; false: no memory. */
SKD_MUST_CHECK bool skd_gltf_source_expect(struct skd_gltf_source *source, size_t count);

/* A source of `external_count` buffers, known but for its members, with no file open; NULL: no
 * memory. */
struct skd_gltf_source *skd_gltf_source_known(size_t external_count);

/* For a source that came without open files (rig_image.h): opens its folder and its files again,
 * by path. What is in them is not looked at: the digests tell when they are read.
 * Errors: those of skd_gltf_source_open; SKD_SOURCE_CHANGED when a size is another. */
SKD_MUST_CHECK enum skd_status skd_gltf_source_reopen(struct skd_gltf_source *source,
                                                      struct skd_error *error);

/* The same with a copy of a file that was kept elsewhere: `number` is 0 for the main file, i + 1
 * for externals[i]; it becomes that of fd, which is taken over, also on failure. The folder is
 * opened if it is there; without it, an export that needs what lies beside the file says so.
 * Errors: SKD_SOURCE_CHANGED when fd is not a file of the size that it should have. */
SKD_MUST_CHECK enum skd_status skd_gltf_source_restore(struct skd_gltf_source *source,
                                                       size_t number, int fd,
                                                       struct skd_error *error);

size_t skd_gltf_source_bytes(const struct skd_gltf_source *source);
void skd_gltf_source_destroy(struct skd_gltf_source *source); /* NULL is fine */

#endif
