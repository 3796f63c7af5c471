/* glTF's JSON through tinygltf, flattened for the C code: the only C++ file.
 *
 * Stage: rig session and export. Thread: a worker. No exception leaves this file. Nothing is
 * checked here, only copied (see gltf_document.h).
 */
#include "rig/gltf_document.h"

#include <tiny_gltf.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <vector>

namespace
{

class flattener
{
  public:
    explicit flattener(skd_gltf_document *to) : document(to)
    {
    }

    void flatten(const tinygltf::Model &model)
    {
        flatten_each(model.bufferViews, document->views, document->view_count);
        flatten_each(model.accessors, document->accessors, document->accessor_count);
        flatten_each(model.meshes, document->meshes, document->mesh_count);
        flatten_each(model.nodes, document->nodes, document->node_count);
        flatten_each(model.skins, document->skins, document->skin_count);
        flatten_each(model.animations, document->animations, document->animation_count);
        count_uses(model);
    }

  private:
    skd_gltf_document *document;

    template <typename T> T *allocate(size_t count)
    {
        void *memory = skd_gltf_document_alloc(document, count, sizeof(T));
        if (memory == nullptr)
            throw std::bad_alloc();
        return static_cast<T *>(memory);
    }

    const char *copy(const std::string &text)
    {
        char *to = allocate<char>(text.size() + 1);
        std::memcpy(to, text.c_str(), text.size());
        return to;
    }

    int32_t *copy(const std::vector<int> &numbers)
    {
        int32_t *to = allocate<int32_t>(numbers.size());
        for (size_t i = 0; i < numbers.size(); i++)
            to[i] = numbers[i];
        return to;
    }

    static void copy(const std::vector<double> &from, double *to, size_t most, size_t &count)
    {
        count = from.size();
        for (size_t i = 0; i < count && i < most; i++)
            to[i] = from[i];
    }

    template <typename From, typename To>
    void flatten_each(const std::vector<From> &from, To *&to, size_t &count)
    {
        to = allocate<To>(from.size());
        count = from.size();
        for (size_t i = 0; i < count; i++)
            flatten_one(from[i], to[i]);
    }

    void count_use(int accessor)
    {
        if (accessor >= 0 && static_cast<size_t>(accessor) < document->accessor_count)
            document->accessors[accessor].use_count++;
    }

    void count_uses(const tinygltf::Model &model)
    {
        for (const auto &mesh : model.meshes)
            for (const auto &primitive : mesh.primitives) {
                count_use(primitive.indices);
                for (const auto &attribute : primitive.attributes)
                    count_use(attribute.second);
                for (const auto &target : primitive.targets)
                    for (const auto &attribute : target)
                        count_use(attribute.second);
            }
        for (const auto &skin : model.skins)
            count_use(skin.inverseBindMatrices);
        for (const auto &animation : model.animations)
            for (const auto &sampler : animation.samplers) {
                count_use(sampler.input);
                count_use(sampler.output);
            }
    }

    void flatten_one(const tinygltf::BufferView &from, skd_gltf_view &to)
    {
        to.buffer = from.buffer;
        to.offset = from.byteOffset;
        to.bytes = from.byteLength;
        to.stride = from.byteStride;
    }

    void flatten_one(const tinygltf::Accessor &from, skd_gltf_accessor &to)
    {
        to.view = from.bufferView;
        to.offset = from.byteOffset;
        to.count = from.count;
        to.component = from.componentType;
        to.width = tinygltf::GetNumComponentsInType(static_cast<uint32_t>(from.type));
        to.is_normalized = from.normalized;
        to.has_bounds = !from.minValues.empty() || !from.maxValues.empty();
        to.is_sparse = from.sparse.isSparse;
        if (!to.is_sparse)
            return;
        to.sparse_count = static_cast<size_t>(from.sparse.count); /* negative: too many */
        to.index_view = from.sparse.indices.bufferView;
        to.index_offset = static_cast<size_t>(from.sparse.indices.byteOffset);
        to.index_component = from.sparse.indices.componentType;
        to.value_view = from.sparse.values.bufferView;
        to.value_offset = static_cast<size_t>(from.sparse.values.byteOffset);
    }

    static int32_t attribute(const tinygltf::Primitive &primitive, const std::string &name)
    {
        const auto found = primitive.attributes.find(name);
        return found == primitive.attributes.end() ? -1 : found->second;
    }

    void flatten_one(const tinygltf::Primitive &from, skd_gltf_primitive &to)
    {
        to.position = attribute(from, "POSITION");
        to.indices = from.indices;
        to.mode = from.mode;
        to.target_count = from.targets.size();
        for (int set = 0; set <= SKD_SETS_MAX; set++) {
            const int32_t joints = attribute(from, "JOINTS_" + std::to_string(set));
            const int32_t weights = attribute(from, "WEIGHTS_" + std::to_string(set));
            if (joints < 0 && weights < 0)
                break;
            to.set_count = set + 1;
            if (set < SKD_SETS_MAX) {
                to.joints[set] = joints;
                to.weights[set] = weights;
            }
        }
    }

    void flatten_one(const tinygltf::Mesh &from, skd_gltf_mesh &to)
    {
        flatten_each(from.primitives, to.primitives, to.primitive_count);
    }

    void flatten_one(const tinygltf::Node &from, skd_gltf_node &to)
    {
        to.name = copy(from.name);
        to.mesh = from.mesh;
        to.skin = from.skin;
        to.child_count = from.children.size();
        to.children = copy(from.children);
        copy(from.matrix, to.matrix, 16, to.matrix_count);
        copy(from.translation, to.translation, 3, to.translation_count);
        copy(from.rotation, to.rotation, 4, to.rotation_count);
        copy(from.scale, to.scale, 3, to.scale_count);
    }

    void flatten_one(const tinygltf::Skin &from, skd_gltf_skin &to)
    {
        to.joint_count = from.joints.size();
        to.joints = copy(from.joints);
        to.inverse_binds = from.inverseBindMatrices;
    }

    void flatten_one(const tinygltf::AnimationSampler &from, skd_gltf_sampler &to)
    {
        to.input = from.input;
        to.output = from.output;
        to.interpolation = copy(from.interpolation);
    }

    void flatten_one(const tinygltf::AnimationChannel &from, skd_gltf_channel &to)
    {
        to.sampler = from.sampler;
        to.node = from.target_node;
        to.path = copy(from.target_path);
    }

    void flatten_one(const tinygltf::Animation &from, skd_gltf_animation &to)
    {
        to.name = copy(from.name);
        flatten_each(from.samplers, to.samplers, to.sampler_count);
        flatten_each(from.channels, to.channels, to.channel_count);
    }
};

/* Images never reach tinygltf; if one did, this refuses to decode it. */
bool no_image(tinygltf::Image *, const int, std::string *, std::string *, int, int,
              const unsigned char *, int, void *)
{
    return false;
}

/* tinygltf gathers complaints line by line; the one that made it stop is the last. */
std::string last_line(std::string text)
{
    while (!text.empty() && (text.back() == '\n' || text.back() == '.'))
        text.pop_back();
    const size_t start = text.rfind('\n');
    return start == std::string::npos ? text : text.substr(start + 1);
}

/* True when the document is filled, else `problem` says why not. */
bool parse(const char *json, size_t json_bytes, skd_gltf_document *document, std::string &problem)
{
    tinygltf::TinyGLTF loader;
    tinygltf::Model model;
    std::string warning;
    loader.SetImageLoader(no_image, nullptr);
    if (!loader.LoadASCIIFromString(&model, &problem, &warning, json,
                                    static_cast<unsigned int>(json_bytes), "")) {
        problem = last_line(problem);
        return false;
    }
    flattener(document).flatten(model);
    return true;
}

void (*end_without_memory)(void);

[[noreturn]] void terminate()
{
    try {
        if (const std::exception_ptr thrown = std::current_exception())
            std::rethrow_exception(thrown);
    } catch (const std::bad_alloc &) {
        end_without_memory();
    } catch (...) {
    }
    std::abort();
}

} // namespace

extern "C" void skd_gltf_on_no_memory(void (*end)(void))
{
    end_without_memory = end;
    std::set_terminate(terminate);
}

extern "C" enum skd_gltf_parsed skd_gltf_document_parse(const char *json, size_t json_bytes,
                                                        struct skd_gltf_document **document,
                                                        char *problem, size_t problem_bytes)
{
    *document = nullptr;
    auto *made = static_cast<skd_gltf_document *>(std::calloc(1, sizeof(skd_gltf_document)));
    if (made == nullptr)
        return SKD_GLTF_NO_MEMORY;
    enum skd_gltf_parsed parsed = SKD_GLTF_INVALID;
    try {
        std::string text;
        if (parse(json, json_bytes, made, text))
            parsed = SKD_GLTF_PARSED;
        else if (text.find("bad_alloc") != std::string::npos) /* tinygltf caught it itself */
            parsed = SKD_GLTF_NO_MEMORY;
        else
            std::snprintf(problem, problem_bytes, "%s", text.c_str());
    } catch (const std::bad_alloc &) {
        parsed = SKD_GLTF_NO_MEMORY;
    } catch (const std::exception &thrown) {
        std::snprintf(problem, problem_bytes, "%s", thrown.what());
    } catch (...) {
        std::snprintf(problem, problem_bytes, "tinygltf gives no reason");
    }
    if (parsed == SKD_GLTF_PARSED)
        *document = made;
    else
        skd_gltf_document_destroy(made);
    return parsed;
}
