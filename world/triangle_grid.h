// world/triangle_grid.h — how far points are from a surface of triangles.
// Source: Ericson, "Real-Time Collision Detection", 2005, section 5.1.5 (nearest point of a triangle).
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace world {

/// Nearest point of the triangle a b c to p. Not a number where two corners coincide, which `farthest`
/// takes for no triangle.
glm::vec3 nearestOnTriangle(glm::vec3 p, glm::vec3 a, glm::vec3 b, glm::vec3 c);

/// Triangles in a grid of cells, half as wide as the longest distance asked for. Holds views: positions
/// and indices must outlive it. Queries may run side by side.
class TriangleGrid {
public:
    /// `reach` [same unit as the positions] > 0; cells must be few for the mesh at hand (terrain chunks).
    TriangleGrid(std::span<const glm::vec3> positions, std::span<const uint32_t> indices, float reach);

    /// The largest over `points` of the distance to the nearest triangle, but at least `atLeast` and
    /// at most `reach`, which stands for "that far or farther". Points no farther than the largest so
    /// far are left after the first triangle that shows it.
    float farthest(std::span<const glm::vec3> points, float atLeast) const;

private:
    bool within(glm::vec3 p, float& distance) const;

    std::span<const glm::vec3> positions_;
    std::span<const uint32_t> indices_;
    float reach_, cell_;
    glm::vec3 low_{0};
    glm::ivec3 cells_{0};
    std::vector<uint32_t> first_;      // per cell, into triangles_; one more at the end
    std::vector<uint32_t> triangles_;  // first index of each triangle / 3
};

}  // namespace world
