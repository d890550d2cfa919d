// tests/server/rays.h — shadow rays against all triangles of a world's finest level, one by one.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "world/store.h"

namespace tests {

using WorldTriangles = std::vector<std::array<glm::dvec3, 3>>;

/// Of instances; terrain is left out.
inline WorldTriangles trianglesOf(const world::WorldStore& store) {
    WorldTriangles triangles;
    for (const world::ChunkRecord& record : store.chunks()) {
        const world::Chunk chunk = store.readChunk(record.key).value();
        for (const world::Instance& instance : chunk.instances) {
            const world::Mesh mesh = store.readMesh(instance.mesh).value();
            const world::MeshLevel& level = mesh.levels[0];
            for (size_t i = 0; i < level.indices.size(); i += 3) {
                std::array<glm::dvec3, 3> t;
                for (size_t k = 0; k < 3; ++k)
                    t[k] = glm::dmat3(instance.placement.linear) * glm::dvec3(level.positions[level.indices[i + k]]) +
                           instance.placement.translation;
                triangles.push_back(t);
            }
        }
    }
    return triangles;
}

/// Of terrain alone, as the file has it now.
inline WorldTriangles terrainTrianglesOf(const world::WorldStore& store) {
    WorldTriangles triangles;
    for (const world::ChunkRecord& record : store.chunks()) {
        const world::Chunk chunk = store.readChunk(record.key).value();
        const glm::dvec3 origin = glm::dvec3(record.key.x, 0, record.key.z) * store.header().chunkSize;
        const world::MeshLevel& level = chunk.terrain.levels.at(0);
        for (size_t i = 0; i < level.indices.size(); i += 3) {
            std::array<glm::dvec3, 3> t;
            for (size_t k = 0; k < 3; ++k) t[k] = glm::dvec3(level.positions[level.indices[i + k]]) + origin;
            triangles.push_back(t);
        }
    }
    return triangles;
}

/// Distances from `p` toward the sun at which the ray leaves a triangle behind, more than 0.05 m off.
template <class F>
void eachHit(const WorldTriangles& triangles, glm::dvec3 p, glm::dvec3 toSun, F f) {
    for (const auto& t : triangles) {
        const glm::dvec3 u = t[1] - t[0], v = t[2] - t[0], n = glm::cross(toSun, v);
        const double det = glm::dot(u, n);
        if (std::abs(det) < 1e-12) continue;
        const glm::dvec3 s = p - t[0], q = glm::cross(s, u);
        const double a = glm::dot(s, n) / det, b = glm::dot(toSun, q) / det, away = glm::dot(v, q) / det;
        if (a >= 0 && b >= 0 && a + b <= 1 && away > 0.05) f(away);
    }
}

inline bool shadowed(const WorldTriangles& triangles, glm::dvec3 p, glm::dvec3 toSun) {
    bool any = false;
    eachHit(triangles, p, toSun, [&](double) { any = true; });
    return any;
}

/// Distance to the last caster on the way to the sun [m]; 0 for none.
inline double farthestCaster(const WorldTriangles& triangles, glm::dvec3 p, glm::dvec3 toSun) {
    double farthest = 0;
    eachHit(triangles, p, toSun, [&](double away) { farthest = std::max(farthest, away); });
    return farthest;
}

}  // namespace tests
