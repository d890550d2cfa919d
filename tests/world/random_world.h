// tests/world/random_world.h — seeded worlds and folders for tests that write files.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "world/bake.h"

namespace world_tests {

/// A folder of its own that goes away with its owner.
class TempFolder {
public:
    TempFolder() {
        std::string name = (std::filesystem::temp_directory_path() / "gnomon-XXXXXX").string();
        CHECK(mkdtemp(name.data()) != nullptr);
        path_ = name;
    }
    TempFolder(const TempFolder&) = delete;
    TempFolder& operator=(const TempFolder&) = delete;
    ~TempFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    std::string file(const std::string& name) const { return (path_ / name).string(); }
    /// Names of what is in it, sorted.
    std::vector<std::string> list() const {
        std::vector<std::string> names;
        for (const auto& entry : std::filesystem::directory_iterator(path_))
            names.push_back(entry.path().filename());
        std::sort(names.begin(), names.end());
        return names;
    }

private:
    std::filesystem::path path_;
};

inline std::string readFile(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

inline void writeFile(const std::string& path, const std::string& bytes) {
    std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

/// A patch of `side` x `side` bumpy squares of edge 1 around the origin, no clusters.
inline world::MeshLevel patch(uint32_t side, float error, std::mt19937& rng) {
    std::uniform_real_distribution<float> height(-0.4f, 0.4f);
    world::MeshLevel level;
    level.error = error;
    for (uint32_t z = 0; z <= side; ++z)
        for (uint32_t x = 0; x <= side; ++x)
            level.positions.emplace_back(static_cast<float>(x) - 0.5f * static_cast<float>(side), height(rng),
                                         static_cast<float>(z) - 0.5f * static_cast<float>(side));
    for (uint32_t z = 0; z < side; ++z)
        for (uint32_t x = 0; x < side; ++x) {
            const uint32_t a = z * (side + 1) + x, b = a + 1, c = a + side + 1, d = c + 1;
            for (const uint32_t index : {a, c, b, b, c, d}) level.indices.push_back(index);
        }
    return level;
}

/// 1 to 3 levels, the finest `side` squares wide.
inline world::Mesh randomMesh(uint32_t side, std::mt19937& rng) {
    world::Mesh mesh;
    const uint32_t levels = 1 + rng() % 3;
    for (uint32_t k = 0; k < levels; ++k)
        mesh.levels.push_back(patch(std::max(1u, side >> k), 0.25f * static_cast<float>(k), rng));
    return mesh;
}

struct RandomWorld {
    uint32_t seed = 1;
    int chunksAside = 4;    ///< chunks in x and in z
    int firstChunk = -2;    ///< lowest key in x and z
    double chunkSize = 32;  ///< [m]
    uint32_t meshes = 6;
    uint32_t instances = 12;  ///< most in a chunk; some chunks have none
    uint32_t meshSide = 9;
};

/// About every third chunk has terrain, every fifth has nothing at all.
inline world::BakeSource randomSource(const RandomWorld& options) {
    world::BakeSource source;
    source.header.chunkSize = options.chunkSize;
    source.header.source = "random:" + std::to_string(options.seed);
    source.header.sun = glm::dvec3(0, -1, 0);
    source.header.voxel = 0.5;
    std::mt19937 rng(options.seed);
    for (uint32_t m = 0; m < options.meshes; ++m)
        source.meshes.push_back(randomMesh(1 + rng() % options.meshSide, rng));
    for (int x = 0; x < options.chunksAside; ++x)
        for (int z = 0; z < options.chunksAside; ++z)
            source.chunks.push_back({options.firstChunk + x, 0, options.firstChunk + z});
    source.make = [options](world::ChunkKey key) -> world::Result<world::SourceChunk> {
        std::mt19937 own(options.seed * 7919u + static_cast<uint32_t>(key.x) * 131u +
                         static_cast<uint32_t>(key.z));
        world::SourceChunk chunk;
        if (own() % 5 == 0) return chunk;
        std::uniform_real_distribution<double> place(0, options.chunkSize);
        std::uniform_real_distribution<float> turn(-1, 1);
        const uint32_t count = own() % (options.instances + 1);
        for (uint32_t i = 0; i < count; ++i) {
            world::Instance instance;
            instance.mesh = own() % options.meshes;
            for (int c = 0; c < 3; ++c)
                for (int r = 0; r < 3; ++r) instance.placement.linear[c][r] = turn(own);
            const double x = place(own), y = place(own), z = place(own);
            instance.placement.translation = {key.x * options.chunkSize + x, y,
                                              key.z * options.chunkSize + z};
            chunk.instances.push_back(instance);
            chunk.names.push_back(own() % 3 == 0 ? "node/" + std::to_string(own() % 1000) : "");
        }
        if (own() % 3 == 0) {
            world::TerrainChunk terrain;
            terrain.mesh = randomMesh(16, own);
            chunk.terrain = std::move(terrain);
        }
        return chunk;
    };
    return source;
}

}  // namespace world_tests
