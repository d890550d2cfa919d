// world/mesh_changes.cpp — see mesh_changes.h.
#include "world/mesh_changes.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <iterator>
#include <vector>

namespace world {
namespace {

using Bits = std::array<uint32_t, 9>;

std::vector<Bits> sortedTriangles(const MeshLevel& level) {
    std::vector<Bits> triangles(level.indices.size() / 3);
    for (size_t i = 0; i < level.indices.size(); ++i) {
        const glm::vec3& p = level.positions[level.indices[i]];
        for (int axis = 0; axis < 3; ++axis)
            triangles[i / 3][3 * (i % 3) + static_cast<size_t>(axis)] = std::bit_cast<uint32_t>(p[axis]);
    }
    std::sort(triangles.begin(), triangles.end());
    return triangles;
}

}  // namespace

Box changedBox(const MeshLevel& before, const MeshLevel& after) {
    const std::vector<Bits> a = sortedTriangles(before), b = sortedTriangles(after);
    std::vector<Bits> changed;
    std::set_symmetric_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(changed));
    Box box;
    for (const Bits& t : changed)
        for (size_t i = 0; i < 9; i += 3)
            box.add(glm::dvec3(std::bit_cast<float>(t[i]), std::bit_cast<float>(t[i + 1]), std::bit_cast<float>(t[i + 2])));
    return box;
}

}  // namespace world
