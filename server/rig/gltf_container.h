/* A glTF file taken apart: its JSON, and the bytes of its buffers wherever they lie.
 *
 *      .glb    [header 12][JSON chunk 8 + n][BIN chunk 8 + m][chunks unknown to us]
 *      .gltf   JSON; buffers in data URIs or in files beside it
 *
 * Stage: rig session and export. Thread: a worker. Owns all that it points to.
 */
#ifndef SKD_RIG_GLTF_CONTAINER_H
#define SKD_RIG_GLTF_CONTAINER_H

#include "rig/gltf_document.h"
#include "rig/gltf_source.h"
#include "rig/json_text.h"

#include <cjson/cJSON.h>

enum skd_buffer_storage { SKD_BUFFER_CHUNK, SKD_BUFFER_DATA_URI, SKD_BUFFER_FILE };

struct skd_gltf_buffer {
    enum skd_buffer_storage storage;
    uint8_t *bytes;
    size_t size; /* byteLength; the storage may hold more */
    size_t stored;
    const char *uri; /* borrowed from buffer_list, NULL for the chunk */
    bool is_owned;   /* bytes are the container's, not a part of `file` */
};

struct skd_gltf_container {
    bool is_glb;
    uint8_t *file;
    size_t file_bytes;
    size_t json_offset; /* of the JSON text in file */
    size_t json_bytes;  /* with the GLB's padding */
    uint8_t *bin;       /* GLB: contents of the BIN chunk in file, or NULL */
    size_t bin_bytes;
    size_t chunks_end;    /* GLB: where chunks after BIN begin */
    size_t glb_bytes;     /* GLB: as its header says */
    struct skd_json json; /* the root object, in file */
    cJSON *buffer_list;   /* "buffers" */
    size_t buffer_count;
    struct skd_gltf_buffer *buffers;
    const struct skd_gltf_document *document; /* the source's */
};

/* Reads the source's files. The first time it opens the external ones, later it checks that
 * nothing has changed. Refuses what skind cannot read: other versions than 2, Draco, meshopt.
 * Errors: SKD_NOT_GLTF, SKD_UNSUPPORTED, SKD_BAD_RIG, SKD_NO_FILE, SKD_FILE_IO,
 * SKD_SOURCE_CHANGED, SKD_TOO_LARGE, SKD_NO_MEMORY. */
SKD_MUST_CHECK enum skd_status skd_gltf_container_read(struct skd_gltf_source *source,
                                                       struct skd_gltf_container *container,
                                                       struct skd_error *error);
void skd_gltf_container_finish(struct skd_gltf_container *container);

#endif
