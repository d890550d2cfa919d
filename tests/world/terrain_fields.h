// tests/world/terrain_fields.h — hills with a cave, as a formula: what the terrain tests are judged by.
#pragma once

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>

#include "world/mesh.h"
#include "world/terrain_field.h"

namespace world::test {

/// About the distance to the surface [m], positive in air: rolling hills of up to 25 m, and a tunnel of
/// radius 6 m along x that comes out of a slope.
inline double hillsWithCave(glm::dvec3 p) {
    const double h = 9 * std::sin(p.x / 31) + 8 * std::cos(p.z / 27) + 4 * std::sin((p.x + p.z) / 13);
    const double dx = 9.0 / 31 * std::cos(p.x / 31) + 4.0 / 13 * std::cos((p.x + p.z) / 13);
    const double dz = -8.0 / 27 * std::sin(p.z / 27) + 4.0 / 13 * std::cos((p.x + p.z) / 13);
    const double ground = (p.y - h) / std::sqrt(1 + dx * dx + dz * dz);
    const double axis = 6 * std::sin(p.x / 40) + 62;
    const double tunnel = 6 - std::hypot(p.y + 4, p.z - axis);
    return std::max(ground, tunnel);
}

/// Any such formula as a field, between `lowY` and `highY` [m].
template <class F>
TerrainField fieldOf(F f, double lowY, double highY) {
    return [=](const LatticeRect& rect) {
        FieldBlock block;
        block.firstY = static_cast<int64_t>(std::floor(lowY / rect.voxel));
        block.countY = static_cast<int32_t>(std::ceil((highY - lowY) / rect.voxel));
        for (int32_t i = 0; i < rect.countX; ++i) {
            for (int32_t k = 0; k < rect.countZ; ++k) {
                for (int32_t j = 0; j < block.countY; ++j) {
                    const double y = (static_cast<double>(block.firstY + j) + 0.5) * rect.voxel;
                    block.distance.push_back(static_cast<float>(f(glm::dvec3(rect.x(i), y, rect.z(k)))));
                }
            }
        }
        return block;
    };
}

/// In positions, indices and errors of all levels.
inline bool sameMesh(const Mesh& a, const Mesh& b) {
    return std::ranges::equal(a.levels, b.levels, [](const MeshLevel& x, const MeshLevel& y) {
        return x.error == y.error && x.positions == y.positions && x.indices == y.indices;
    });
}

}  // namespace world::test
