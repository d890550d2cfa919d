// tests/world/gltf_builder.h — builds small glTF files in memory, and folders to put them in.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <glm/glm.hpp>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "world/gltf.h"

namespace world {

/// A folder that goes with the test.
class TempFolder {
public:
    TempFolder() {
        std::string name = testing::TempDir() + "gltf_XXXXXX";
        root_ = ::mkdtemp(name.data());
    }
    ~TempFolder() { std::filesystem::remove_all(root_); }
    TempFolder(const TempFolder&) = delete;
    TempFolder& operator=(const TempFolder&) = delete;
    std::filesystem::path path(const std::string& name) const { return root_ / name; }
    /// Writes a file and returns its path.
    std::string write(const std::string& name, std::string_view bytes) const {
        if (name.find('/') != std::string::npos)
            std::filesystem::create_directories(path(name).parent_path());
        std::ofstream(path(name), std::ios::binary) << bytes;
        return path(name).string();
    }

private:
    std::filesystem::path root_;
};

/// A glTF file in the making: the JSON is open to every change, the buffer grows by accessors.
struct GltfBuilder {
    using Json = nlohmann::json;
    Json root{{"asset", {{"version", "2.0"}}},
              {"nodes", Json::array()},
              {"meshes", Json::array()},
              {"accessors", Json::array()},
              {"bufferViews", Json::array()}};
    std::string bin;

    /// Appends an accessor over `count` elements of `bytes` in a view of its own.
    int accessor(std::string_view bytes, size_t count, int component, const char* type, size_t stride = 0) {
        bin.resize((bin.size() + 3) / 4 * 4);
        Json view{{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", bytes.size()}};
        if (stride != 0) view["byteStride"] = stride;
        bin += bytes;
        root["bufferViews"].push_back(view);
        root["accessors"].push_back({{"bufferView", root["bufferViews"].size() - 1},
                                     {"componentType", component},
                                     {"count", count},
                                     {"type", type}});
        return static_cast<int>(root["accessors"].size()) - 1;
    }

    /// Positions, `padding` bytes of noise after each.
    int positions(const std::vector<glm::vec3>& points, size_t padding = 0) {
        std::string bytes;
        for (const glm::vec3& p : points) {
            bytes.append(reinterpret_cast<const char*>(&p), sizeof p);
            bytes.append(padding, '\x7f');
        }
        return accessor(bytes, points.size(), 5126, "VEC3", padding == 0 ? 0 : sizeof(glm::vec3) + padding);
    }

    template <class T>
    int indices(const std::vector<T>& values) {
        const std::string_view bytes(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
        return accessor(bytes, values.size(), sizeof(T) == 1 ? 5121 : sizeof(T) == 2 ? 5123 : 5125, "SCALAR");
    }

    static Json primitive(int positionAccessor, int indexAccessor = -1, int mode = 4) {
        Json out{{"attributes", {{"POSITION", positionAccessor}}}, {"mode", mode}};
        if (indexAccessor >= 0) out["indices"] = indexAccessor;
        return out;
    }

    int mesh(const std::vector<Json>& primitives) {
        root["meshes"].push_back({{"primitives", primitives}});
        return static_cast<int>(root["meshes"].size()) - 1;
    }

    /// A mesh of one triangle in the plane z = 0.
    int triangleMesh() { return mesh({primitive(positions({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}))}); }

    int material(const char* alphaMode) {
        root["materials"].push_back({{"alphaMode", alphaMode}});
        return static_cast<int>(root["materials"].size()) - 1;
    }

    int node(const Json& json) {
        root["nodes"].push_back(json);
        return static_cast<int>(root["nodes"].size()) - 1;
    }

    std::string glb() const {
        Json full = root;
        std::string body = bin;
        body.resize((body.size() + 3) / 4 * 4);
        if (!full.contains("buffers") && !body.empty())
            full["buffers"] = Json::array({Json{{"byteLength", bin.size()}}});
        std::string json = full.dump();
        json.resize((json.size() + 3) / 4 * 4, ' ');
        return frame(json, body);
    }

    /// The text of a .gltf whose buffer is at `uri`.
    std::string gltf(const std::string& uri) const {
        Json full = root;
        full["buffers"] = Json::array({Json{{"byteLength", bin.size()}, {"uri", uri}}});
        return full.dump();
    }

    static std::string frame(const std::string& json, const std::string& body) {
        std::string out = "glTF";
        const auto word = [&out](size_t value) {
            for (int i = 0; i < 4; ++i) out += static_cast<char>(value >> (8 * i) & 0xff);
        };
        word(2);
        word(20 + json.size() + (body.empty() ? 0 : 8 + body.size()));
        word(json.size());
        out += "JSON" + json;
        if (!body.empty()) {
            word(body.size());
            out += std::string("BIN\0", 4) + body;
        }
        return out;
    }
};

/// All instances of a source, chunk by chunk, with their names.
struct Listed {
    ChunkKey chunk;
    Instance instance;
    std::string name;
};

inline std::vector<Listed> listAll(const BakeSource& source) {
    std::vector<Listed> all;
    for (const ChunkKey& key : source.chunks) {
        const Result<SourceChunk> chunk = source.make(key);
        EXPECT_TRUE(chunk);
        for (size_t i = 0; i < chunk.value().instances.size(); ++i)
            all.push_back({key, chunk.value().instances[i], chunk.value().names[i]});
    }
    return all;
}

/// Every promise of world/bake.h and world/mesh.h on a source.
inline void expectSound(const BakeSource& source) {
    const double size = source.header.chunkSize;
    ASSERT_TRUE(std::isfinite(size) && size > 0);
    const double sun = glm::length(source.header.sun);
    ASSERT_TRUE(sun == 0 || std::abs(sun - 1) < 1e-12) << sun;
    for (size_t m = 0; m < source.meshes.size(); ++m) {
        const Mesh& mesh = source.meshes[m];
        ASSERT_EQ(mesh.levels.size(), 1u);
        const MeshLevel& level = mesh.levels[0];
        ASSERT_EQ(level.error, 0);
        ASSERT_FALSE(level.indices.empty());
        ASSERT_EQ(level.indices.size() % 3, 0u);
        Box bounds;
        for (const uint32_t index : level.indices) {
            ASSERT_LT(index, level.positions.size());
            bounds.add(glm::dvec3(level.positions[index]));
        }
        ASSERT_EQ(bounds, mesh.bounds) << "mesh " << m;
        for (const glm::vec3& p : level.positions)
            ASSERT_TRUE(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
    }
    std::set<std::string> names;
    for (size_t c = 0; c < source.chunks.size(); ++c) {
        ASSERT_TRUE(c == 0 || source.chunks[c - 1] < source.chunks[c]);
        const Result<SourceChunk> chunk = source.make(source.chunks[c]);
        ASSERT_TRUE(chunk);
        ASSERT_FALSE(chunk.value().instances.empty());
        ASSERT_EQ(chunk.value().instances.size(), chunk.value().names.size());
        for (size_t i = 0; i < chunk.value().instances.size(); ++i) {
            const Instance& instance = chunk.value().instances[i];
            ASSERT_LT(instance.mesh, source.meshes.size());
            const Box bounds =
                transformed(source.meshes[instance.mesh].bounds, glm::dmat3(instance.placement.linear),
                            instance.placement.translation);
            const glm::dvec3 cell = glm::floor(bounds.centre() / size);
            ASSERT_EQ(source.chunks[c],
                      (ChunkKey{static_cast<int32_t>(cell.x), 0, static_cast<int32_t>(cell.z)}));
            const std::string& name = chunk.value().names[i];
            ASSERT_TRUE(name.empty() || names.insert(name).second) << name;
        }
    }
}

}  // namespace world
