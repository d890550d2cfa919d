// world/terrain_edit.cpp — see terrain_edit.h.
#include "world/terrain_edit.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "world/band_samples.h"
#include "world/casters.h"
#include "world/clusters.h"
#include "world/mesh_bounds.h"
#include "world/terrain.h"

namespace world {
namespace {

constexpr double kFarthest = 1e8;  // [m], as for placed objects

/// Signed distances to the shape's surface [m], negative inside.
double distance(const Sphere& s, glm::dvec3 p) { return glm::length(p - s.centre) - s.radius; }

double distance(const Capsule& c, glm::dvec3 p) {
    const glm::dvec3 axis = c.to - c.from, d = p - c.from;
    const double length2 = glm::dot(axis, axis);
    const double along = length2 > 0 ? std::clamp(glm::dot(d, axis) / length2, 0.0, 1.0) : 0;
    return glm::length(d - axis * along) - c.radius;
}

double distance(const Box& b, glm::dvec3 p) {
    const glm::dvec3 q = glm::max(b.min - p, p - b.max);
    return glm::length(glm::max(q, 0.0)) + std::min(std::max({q.x, q.y, q.z}), 0.0);
}

Box shapeBounds(const Sphere& s) { return {s.centre - s.radius, s.centre + s.radius}; }
Box shapeBounds(const Capsule& c) { return {glm::min(c.from, c.to) - c.radius, glm::max(c.from, c.to) + c.radius}; }
Box shapeBounds(const Box& b) { return b; }

const char* nameOf(EditKind kind) { return kind == EditKind::kDig ? "dig" : "fill"; }

int32_t voxelsAlong(const Header& header) { return static_cast<int32_t>(std::llround(header.chunkSize / header.voxel)); }

/// Lattice indices, of the world's frame, of the samples that the edit may change.
struct LatticeBox {
    glm::i64vec3 low{0}, high{0};  ///< high excluded
};

LatticeBox latticeBox(const TerrainEdit& edit, double voxel) {
    const Box reach = grown(boundsOf(edit), kBandVoxels * voxel);
    return {glm::i64vec3(glm::floor(reach.min / voxel - 0.5)), glm::i64vec3(glm::floor(reach.max / voxel - 0.5)) + int64_t{2}};
}

int64_t floorDiv(int64_t a, int64_t b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }

/// In units of the band.
int16_t unitsOf(double distance, double unitsPerMetre) {
    return static_cast<int16_t>(
        std::lround(std::clamp(distance * unitsPerMetre, -double{kBandUnits}, double{kBandUnits})));
}

}  // namespace

Box boundsOf(const TerrainEdit& edit) {
    return std::visit([](const auto& shape) { return shapeBounds(shape); }, edit.shape);
}

Result<Done> requireEdit(const TerrainEdit& edit, const Header& header) {
    const std::string who = nameOf(edit.kind);
    if (!(header.voxel > 0)) return Error{ErrorCode::kUsage, who + ": this world has no terrain; bake one that has"};
    const Box b = boundsOf(edit);
    const glm::dvec3 size = b.extent();
    // Also false for what is not a number.
    if (!(size.x > 0 && size.y > 0 && size.z > 0 && std::isfinite(size.x + size.y + size.z)))
        return Error{ErrorCode::kUsage, who + ": its shape has no extent, or a number is not finite; give metres above 0"};
    const double widest = std::max({size.x, size.y, size.z});
    if (widest > header.chunkSize)
        return Error{ErrorCode::kLimit, who + ": " + std::to_string(widest) + " m across, the most is a chunk's edge, " +
                                            std::to_string(header.chunkSize) + " m; give several smaller ones"};
    if (glm::any(glm::greaterThan(glm::max(glm::abs(b.min), glm::abs(b.max)), glm::dvec3(kFarthest))))
        return Error{ErrorCode::kLimit, who + ": it reaches farther than 1e8 m from the origin; move it"};
    return Done{};
}

std::vector<ChunkKey> chunksWithin(const TerrainEdit& edit, const Header& header) {
    const LatticeBox box = latticeBox(edit, header.voxel);
    const int64_t side = voxelsAlong(header), samples = bandSamples(static_cast<int32_t>(side));
    // Chunk k holds samples k * side - kBandMargin and the `samples` - 1 after it.
    const auto first = [&](int64_t low) { return floorDiv(low + kBandMargin - samples, side) + 1; };
    const auto last = [&](int64_t high) { return floorDiv(high - 1 + kBandMargin, side); };
    std::vector<ChunkKey> keys;
    for (int64_t x = first(box.low.x); x <= last(box.high.x); ++x)
        for (int64_t z = first(box.low.z); z <= last(box.high.z); ++z)
            keys.push_back({static_cast<int32_t>(x), 0, static_cast<int32_t>(z)});
    return keys;
}

Result<LevelSet> edited(const LevelSet& set, ChunkKey key, const TerrainEdit& edit) {
    CHECK(!set.leaves.empty());
    LatticeBox box = latticeBox(edit, set.voxel);
    const int64_t samples = bandSamples(set.side);
    const glm::i64vec3 origin(int64_t{key.x} * set.side - kBandMargin, 0, int64_t{key.z} * set.side - kBandMargin);
    box.low -= origin;
    box.high -= origin;
    const int64_t lowX = std::max<int64_t>(box.low.x, 0), highX = std::min(box.high.x, samples);
    const int64_t lowZ = std::max<int64_t>(box.low.z, 0), highZ = std::min(box.high.z, samples);
    if (lowX >= highX || lowZ >= highZ) return set;
    int64_t lowest = box.low.y, highest = box.high.y;
    for (const LevelSetLeaf& leaf : set.leaves) {
        lowest = std::min<int64_t>(lowest, leaf.origin.y);
        highest = std::max<int64_t>(highest, leaf.origin.y + kLeafSide);
    }
    // With the spare leaves around them.
    if (samples * samples * (highest - lowest + 4 * kLeafSide) > kMaxBandSamples)
        return Error{ErrorCode::kLimit, std::string(nameOf(edit.kind)) + ": chunk " + toString(key) +
                                            ": its terrain would span " + std::to_string(highest - lowest) +
                                            " voxels of height; stay nearer to the ground"};

    BandSamples band = samplesOf(set, box.low.y, box.high.y);
    const double unitsPerMetre = kBandUnits / (kBandVoxels * set.voxel);
    for (int64_t x = lowX; x < highX; ++x) {
        for (int64_t z = lowZ; z < highZ; ++z) {
            for (int64_t y = box.low.y; y < box.high.y; ++y) {
                int16_t& v = band.values[band.index(int32_t(x), int32_t(y - band.firstY), int32_t(z))];
                if (v == kVoidSample) break;
                const glm::dvec3 p = (glm::dvec3(glm::i64vec3(x, y, z) + origin) + 0.5) * set.voxel;
                const int16_t s = unitsOf(std::visit([&](const auto& shape) { return distance(shape, p); }, edit.shape),
                                          unitsPerMetre);
                v = edit.kind == EditKind::kFill ? std::min(v, s) : std::max(v, static_cast<int16_t>(-s));
            }
        }
    }
    return LevelSet{set.voxel, set.side, leavesOf(band)};
}

Mesh terrainMesh(const LevelSet& set) {
    Mesh mesh = meshLevelSet(set);
    for (MeshLevel& level : mesh.levels) buildClusters(level);
    mesh.bounds = boundsOf(mesh);
    return mesh;
}

}  // namespace world
