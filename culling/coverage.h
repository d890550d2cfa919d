// culling/coverage.h — proof that a rasteriser covers a texel centre with a given triangle, and how deep.
// Source: our own; the rules bounded here are those of the Vulkan specification, chapter
// "Rasterization" (positions snap to a subpixel grid, edges of shared vertices leave no gap).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "world/mesh.h"

namespace culling {

/// Positions snap to 1/256 texel on every driver we know, so they move by 1/512 at most; twice that
/// in each axis, rounded up, is the room an edge must leave.
constexpr double kSnapTexels = 1.0 / 128;

/// Corners in the map plane: x, y in texels, z in metres of light space.
using PlacedTriangle = std::array<glm::dvec3, 3>;

/// Depth slope of a triangle [m per texel]; infinite where it is seen edge on.
double depthSlope(const PlacedTriangle& triangle);

/// Signed distance [texels] from `p` to edge e (corner e to e + 1), positive on the inner side.
/// NaN where the triangle is seen edge on or the edge has no length.
double edgeDistance(const PlacedTriangle& triangle, int e, glm::dvec2 p);

/// Calls `visit` with each other triangle of the level that has both ends of edge e of `triangle`, by
/// position, until it returns true.
template <class Visit>
void acrossEdge(const world::MeshLevel& level, uint32_t triangle, int e, const Visit& visit);

/// The farthest depth [m] at which a rasteriser can put the surface at texel centre `p`, if the
/// triangle, alone or with the neighbour across the one edge that is near, surely covers `p`.
///   margin     room that `p` must have [texels]: kSnapTexels plus float error of the positions
///   neighbourOf  called with that edge for the triangle across it, placed likewise; nothing if none
template <class NeighbourOf>
std::optional<double> coveredDepth(const PlacedTriangle& triangle, glm::dvec2 p, double margin,
                                   const NeighbourOf& neighbourOf);

/// Depth of the triangle's plane at `p`, deepened by what its slope adds over `margin` texels [m].
double depthBound(const PlacedTriangle& triangle, glm::dvec2 p, double margin);

template <class Visit>
void acrossEdge(const world::MeshLevel& level, uint32_t triangle, int e, const Visit& visit) {
    const auto corner = [&level](uint32_t index) { return level.positions[level.indices[index]]; };
    const uint32_t first = 3 * triangle;
    const glm::vec3 a = corner(first + uint32_t(e)), b = corner(first + uint32_t(e + 1) % 3);
    for (const world::Cluster& cluster : level.clusters) {
        if (glm::any(glm::lessThan(glm::min(a, b), cluster.min)) ||
            glm::any(glm::greaterThan(glm::max(a, b), cluster.max)))
            continue;
        for (uint32_t i = cluster.firstIndex; i < cluster.firstIndex + cluster.indexCount; i += 3) {
            if (i == first) continue;
            bool hasA = false, hasB = false;
            for (uint32_t k = i; k < i + 3; ++k) {
                hasA |= corner(k) == a;
                hasB |= corner(k) == b;
            }
            if (hasA && hasB && visit(i / 3)) return;
        }
    }
}

template <class NeighbourOf>
std::optional<double> coveredDepth(const PlacedTriangle& triangle, glm::dvec2 p, double margin,
                                   const NeighbourOf& neighbourOf) {
    int near = -1;
    for (int e = 0; e < 3; ++e) {
        const double d = edgeDistance(triangle, e, p);
        if (d >= margin) continue;
        // Near two edges is near a corner, where any number of triangles may meet.
        if (!(d >= -margin) || near >= 0) return std::nullopt;
        near = e;
    }
    if (near < 0) return depthBound(triangle, p, margin);
    const std::optional<PlacedTriangle> other = neighbourOf(near);
    if (!other) return std::nullopt;
    const glm::dvec2 a(triangle[size_t(near)]), b(triangle[size_t((near + 1) % 3)]);
    int clear = 0;
    double far = 0;
    for (int e = 0; e < 3; ++e) {
        const glm::dvec2 oa((*other)[size_t(e)]), ob((*other)[size_t((e + 1) % 3)]);
        const double d = edgeDistance(*other, e, p);
        if ((oa == a && ob == b) || (oa == b && ob == a)) {
            // The shared edge: the neighbour must lie on its far side, else the surface folds back.
            far = edgeDistance(triangle, near, glm::dvec2((*other)[size_t((e + 2) % 3)]));
        } else if (d >= margin) {
            ++clear;
        }
    }
    if (!(far < 0) || clear != 2) return std::nullopt;
    return std::max(depthBound(triangle, p, margin), depthBound(*other, p, margin));
}

}  // namespace culling
