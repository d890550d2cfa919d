// world/terrain.cpp — see terrain.h.
#include "world/terrain.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <span>
#include <utility>

#include "world/contour.h"
#include "world/triangle_grid.h"

namespace world {
namespace {

/// A level to try: lattice of `step` voxels, cells merged while 1 - cos(angle of normals) <= adaptivity.
struct Detail {
    int step;
    float adaptivity;
};
// Chosen on the procedural world (seed 7, 56 chunks of 64 voxels of 2 m; without skirts): on average
// 11,600, 4,100, 1,500 and some 700 triangles a chunk, with errors of 0, 0.11, 0.42 and 0.7 to 0.8 voxels.
constexpr std::array<Detail, 4> kDetails{{{1, 0.0f}, {1, 0.001f}, {2, 0.002f}, {2, 0.1f}}};
constexpr double kMostTriangles = 0.6;  // of the level before, else a level is not worth its bytes

/// Those of `points` that lie over the chunk's own column.
std::vector<glm::vec3> insideColumn(std::vector<glm::vec3> points, float edge) {
    std::erase_if(points, [&](const glm::vec3& p) { return p.x < 0 || p.x > edge || p.z < 0 || p.z > edge; });
    return points;
}

/// Vertices, edge midpoints and centroids.
std::vector<glm::vec3> samplePoints(const MeshLevel& level) {
    std::vector<glm::vec3> points = level.positions;
    for (size_t i = 0; i < level.indices.size(); i += 3) {
        const glm::vec3 a = level.positions[level.indices[i]], b = level.positions[level.indices[i + 1]],
                        c = level.positions[level.indices[i + 2]];
        points.insert(points.end(), {(a + b) * 0.5f, (b + c) * 0.5f, (c + a) * 0.5f, (a + b + c) / 3.0f});
    }
    return points;
}

/// How far [m] a skirt goes from p [m] along `into` until the solid ends, at most `depth`; half a
/// voxel where there is no solid to go into.
float skirtDepth(const Band& band, glm::vec3 p, glm::vec3 into, float depth, float voxel) {
    const float step = 0.5f * voxel;
    bool solid = false;
    for (float t = step; t < depth; t += step) {
        const float v = band.probe((p + into * t) / voxel);
        if (solid && v > 0) return std::max(t - step, step);
        solid |= !(v > 0);  // a void hides nothing
    }
    return solid ? depth : step;
}

/// Hangs a skirt `depth` [m] deep from every edge that only one triangle has.
void addSkirts(MeshLevel& level, const Band& band, float depth, float voxel) {
    // Directed edges sorted by (low, high) vertex: partners become neighbours.
    struct Edge {
        uint32_t low, high, from, to;
        auto key() const { return std::pair(low, high); }
    };
    std::vector<Edge> edges;
    edges.reserve(level.indices.size());
    for (size_t i = 0; i < level.indices.size(); i += 3) {
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t a = level.indices[i + k], b = level.indices[i + (k + 1) % 3];
            edges.push_back({std::min(a, b), std::max(a, b), a, b});
        }
    }
    std::stable_sort(edges.begin(), edges.end(),
                     [](const Edge& a, const Edge& b) { return a.key() < b.key(); });
    std::map<uint32_t, uint32_t> bottoms;
    const auto bottom = [&](uint32_t top) {
        const auto [it, fresh] = bottoms.try_emplace(top, static_cast<uint32_t>(level.positions.size()));
        if (fresh) {
            const glm::vec3 p = level.positions[top];
            const glm::vec3 into = -band.normal(p / voxel);
            level.positions.push_back(p + into * skirtDepth(band, p, into, depth, voxel));
        }
        return it->second;
    };
    for (size_t i = 0; i < edges.size();) {
        size_t end = i + 1;
        while (end < edges.size() && edges[end].key() == edges[i].key()) ++end;
        if (end == i + 1) {
            const uint32_t a = edges[i].from, b = edges[i].to;
            const uint32_t below = bottom(a), belowNext = bottom(b);
            level.indices.insert(level.indices.end(), {b, a, below, b, below, belowNext});
        }
        i = end;
    }
}

}  // namespace

Mesh meshLevelSet(const LevelSet& set) {
    Mesh mesh;
    if (set.leaves.empty()) return mesh;
    const Band fine = unpack(set), coarse = halved(fine);
    const Columns fineColumns = columnsOf(fine, set.side), coarseColumns = columnsOf(coarse, set.side);
    const auto voxel = static_cast<float>(set.voxel);
    const float edge = float(set.side) * voxel, cap = float(kBandVoxels) * voxel;

    mesh.levels.push_back(contour(fine, fineColumns, kDetails[0].adaptivity, set.voxel));
    if (mesh.levels[0].indices.empty()) return {};
    const TriangleGrid finest(mesh.levels[0].positions, mesh.levels[0].indices, cap);
    const std::vector<glm::vec3> finestPoints = insideColumn(mesh.levels[0].positions, edge);
    for (size_t i = 1; i < kDetails.size(); ++i) {
        const bool isFine = kDetails[i].step == 1;
        const Band& band = isFine ? fine : coarse;
        MeshLevel level =
            contour(band, isFine ? fineColumns : coarseColumns, kDetails[i].adaptivity, set.voxel);
        const MeshLevel& before = mesh.levels.back();
        if (level.indices.empty() ||
            double(level.indices.size()) > kMostTriangles * double(before.indices.size())) {
            continue;
        }
        level.error =
            finest.farthest(insideColumn(samplePoints(level), edge), std::nextafter(before.error, cap));
        level.error = TriangleGrid(level.positions, level.indices, cap).farthest(finestPoints, level.error);
        if (level.error >= cap) continue;
        mesh.levels.push_back(std::move(level));
    }

    for (MeshLevel& level : mesh.levels) addSkirts(level, fine, 2 * cap, voxel);
    for (const glm::vec3& p : mesh.levels[0].positions) mesh.bounds.add(glm::dvec3(p));
    return mesh;
}

Result<std::optional<TerrainChunk>> makeTerrain(const TerrainField& field, ChunkKey key, int32_t side,
                                                double voxel) {
    const Result<LevelSet> set = sampleLevelSet(field, key, side, voxel);
    if (!set) return set.error();
    Mesh mesh = meshLevelSet(set.value());
    if (mesh.levels.empty()) return std::optional<TerrainChunk>();
    return std::optional(TerrainChunk{std::move(mesh), encodeLevelSet(set.value())});
}

}  // namespace world
