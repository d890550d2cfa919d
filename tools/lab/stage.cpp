#include "tools/lab/stage.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <utility>

#include "world/bake.h"
#include "world/check.h"

namespace tools::lab {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

enum StageMesh : uint32_t { kBox, kSheet };

/// Quads along an edge of a sheet: triangles that are small enough for single precision.
constexpr int kQuads = 8;

void addQuad(world::MeshLevel& level, std::array<glm::vec3, 4> corners) {
    const auto first = uint32_t(level.positions.size());
    level.positions.insert(level.positions.end(), corners.begin(), corners.end());
    for (const uint32_t i : {0u, 1u, 2u, 0u, 2u, 3u}) level.indices.push_back(first + i);
}

world::Mesh sheet() {
    world::MeshLevel level;
    const auto at = [](int i) { return float(i) / kQuads - 0.5f; };
    for (int z = 0; z < kQuads; ++z)
        for (int x = 0; x < kQuads; ++x)
            addQuad(level, {{{at(x), 0, at(z)}, {at(x), 0, at(z + 1)}, {at(x + 1), 0, at(z + 1)}, {at(x + 1), 0, at(z)}}});
    world::Mesh mesh;
    mesh.levels.push_back(std::move(level));
    return mesh;
}

world::Mesh box() {
    world::MeshLevel level;
    addUnitBox(level, {0, 0, 0}, {1, 1, 1});
    world::Mesh mesh;
    mesh.levels.push_back(std::move(level));
    return mesh;
}

world::ChunkKey chunkOf(glm::dvec3 p) {
    return {int32_t(std::floor(p.x / kStageChunk)), 0, int32_t(std::floor(p.z / kStageChunk))};
}

world::BakeSource sourceOf(const Stage& stage) {
    world::BakeSource source;
    source.header.chunkSize = kStageChunk;
    source.header.source = "stage";
    source.meshes = {box(), sheet()};
    std::map<world::ChunkKey, world::SourceChunk> chunks;
    for (const Stage::Piece& piece : stage.pieces) {
        const glm::dvec3 at = stage.origin + piece.centre;
        world::SourceChunk& chunk = chunks[chunkOf(at)];
        world::Instance instance{piece.size.y == 0 ? kSheet : kBox, {}};
        for (int axis = 0; axis < 3; ++axis) instance.placement.linear[axis][axis] = float(piece.size[axis]);
        if (piece.size.y == 0) instance.placement.linear[1][1] = 1;
        instance.placement.translation = at;
        chunk.instances.push_back(instance);
        chunk.names.push_back(piece.name);
    }
    for (const auto& [key, mesh] : stage.terrain) chunks[key].terrain = world::TerrainChunk{mesh, {}};
    for (const auto& [key, chunk] : chunks) source.chunks.push_back(key);
    source.make = [chunks](world::ChunkKey key) -> Result<world::SourceChunk> { return chunks.at(key); };
    return source;
}

/// In [low, high). Distributions differ between libraries; this division does not.
double uniform(std::mt19937& rng, double low, double high) { return low + (high - low) * double(rng()) * 0x1p-32; }

}  // namespace

void addUnitBox(world::MeshLevel& level, glm::vec3 centre, glm::vec3 size) {
    const auto corner = [&](int i) {
        return centre + size * (glm::vec3(i & 1, i >> 1 & 1, i >> 2 & 1) - 0.5f);
    };
    for (const auto& f : {std::array{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}})
        addQuad(level, {corner(f[0]), corner(f[1]), corner(f[2]), corner(f[3])});
}

void Stage::addGround(glm::dvec2 middle, double edge) {
    const int tiles = int(std::ceil(edge / kStageChunk));
    for (int z = 0; z < tiles; ++z)
        for (int x = 0; x < tiles; ++x) {
            const glm::dvec2 at = middle + (glm::dvec2(x, z) + 0.5 - tiles / 2.0) * kStageChunk;
            pieces.push_back({"", {at.x, 0, at.y}, {kStageChunk, 0, kStageChunk}});
        }
}

void Stage::addBox(glm::dvec3 centre, glm::dvec3 size, const std::string& name) { pieces.push_back({name, centre, size}); }

void Stage::addBlocks(uint32_t seed, glm::dvec2 middle, double edge, double gap) {
    std::mt19937 rng(seed);
    const int count = int(edge / gap);
    for (int z = 0; z < count; ++z)
        for (int x = 0; x < count; ++x) {
            const double dx = uniform(rng, 0, gap), dz = uniform(rng, 0, gap);
            const double width = uniform(rng, 0.3, 1.5), depth = uniform(rng, 0.3, 1.5), height = uniform(rng, 0.5, 3);
            const glm::dvec2 from = glm::dvec2(x, z) * gap - edge / 2 + glm::dvec2(dx, dz);
            if (glm::length(from) < gap) continue;
            addBox({middle.x + from.x, height / 2, middle.y + from.y}, {width, height, depth});
        }
}

void Stage::addBars(glm::dvec3 first, int count, double step, double width, double height) {
    for (int i = 0; i < count; ++i)
        addBox(first + glm::dvec3(i * step, height / 2, 0), {width, height, width});
}

world::MoverSample Stage::restOf(const std::string& name, double time) const {
    const auto piece = std::find_if(pieces.begin(), pieces.end(), [&](const Piece& p) { return p.name == name; });
    CHECK(piece != pieces.end());
    return {time, origin + piece->centre, {1, 0, 0, 0}, std::cbrt(piece->size.x * piece->size.y * piece->size.z)};
}

Result<StageWorld> StageWorld::bake(const Stage& stage) {
    std::string pattern = (std::filesystem::temp_directory_path() / "gnomon-stage-XXXXXX").string();
    if (!mkdtemp(pattern.data()))
        return Error{ErrorCode::kIo, pattern + ": cannot be made: " + std::strerror(errno) + "; make room, or set TMPDIR", errno};
    StageWorld made;
    made.folder_ = std::shared_ptr<const std::string>(new std::string(pattern), [](const std::string* folder) {
        std::error_code ignored;
        std::filesystem::remove_all(*folder, ignored);
        delete folder;
    });
    const std::string path = pattern + "/stage.world";
    if (const auto baked = world::bake(sourceOf(stage), path, [](size_t, size_t) {}); !baked) return baked.error();
    auto store = world::WorldStore::open(path);
    if (!store) return store.error();
    made.store_ = std::make_unique<world::WorldStore>(std::move(store.value()));
    return made;
}

}  // namespace tools::lab
