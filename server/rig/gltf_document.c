/* See gltf_document.h: the memory of a document, a list of zeroed blocks. */
#include "rig/gltf_document.h"

#include <stdalign.h>
#include <stdlib.h>

struct skd_gltf_block {
    struct skd_gltf_block *next;
    size_t size;
    alignas(max_align_t) unsigned char bytes[];
};

void *skd_gltf_document_alloc(struct skd_gltf_document *document, size_t count, size_t bytes)
{
    size_t total = 0;
    if (__builtin_mul_overflow(count, bytes, &total) ||
        __builtin_add_overflow(total, sizeof(struct skd_gltf_block), &total))
        return NULL;
    struct skd_gltf_block *block = calloc(1, total);
    if (block == NULL)
        return NULL;
    block->next = document->blocks;
    block->size = total;
    document->blocks = block;
    return block->bytes;
}

size_t skd_gltf_document_bytes(const struct skd_gltf_document *document)
{
    size_t bytes = document != NULL ? sizeof *document : 0;
    for (const struct skd_gltf_block *block = document != NULL ? document->blocks : NULL;
         block != NULL; block = block->next)
        bytes += block->size;
    return bytes;
}

void skd_gltf_document_destroy(struct skd_gltf_document *document)
{
    if (document == NULL)
        return;
    for (struct skd_gltf_block *block = document->blocks; block != NULL;) {
        struct skd_gltf_block *next = block->next;
        free(block);
        block = next;
    }
    free(document);
}
