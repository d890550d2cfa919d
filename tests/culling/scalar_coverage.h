// tests/culling/scalar_coverage.h — the proof of coverage one texel at a time: the yardstick of the one by spans.
#pragma once

#include <algorithm>
#include <optional>

#include "culling/coverage.h"

namespace tests {

using culling::PlacedTriangle;

inline double cross(glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; }

inline double doubleArea(const PlacedTriangle& t) {
    return cross(glm::dvec2(t[1] - t[0]), glm::dvec2(t[2] - t[0]));
}

/// Signed distance [texels] from `p` to edge e (corner e to e + 1), positive on the inner side.
/// NaN where the triangle is seen edge on or the edge has no length.
inline double edgeDistance(const PlacedTriangle& triangle, int e, glm::dvec2 p) {
    const glm::dvec2 a(triangle[size_t(e)]), b(triangle[size_t((e + 1) % 3)]);
    return (doubleArea(triangle) > 0 ? 1 : -1) * cross(b - a, p - a) / glm::length(b - a);
}

/// Depth of the triangle's plane at `p`, deepened by what its slope adds over `margin` texels [m].
inline double depthBound(const PlacedTriangle& t, glm::dvec2 p, double margin) {
    const glm::dvec3 u = t[1] - t[0], v = t[2] - t[0];
    const glm::dvec2 gradient = glm::dvec2(u.z * v.y - v.z * u.y, v.z * u.x - u.z * v.x) / doubleArea(t);
    return t[0].z + glm::dot(gradient, p - glm::dvec2(t[0])) + culling::depthSlope(t) * margin;
}

/// What the triangle proves at `p`, alone or with that of the others which shares the one edge near `p` and proves
/// the nearest depth; nothing if `p` is not surely covered.
inline std::optional<double> coveredDepth(const PlacedTriangle& triangle, glm::dvec2 p, double margin,
                                          std::span<const PlacedTriangle> others) {
    if (!std::isfinite(culling::depthSlope(triangle))) return std::nullopt;
    int near = -1;
    for (int e = 0; e < 3; ++e) {
        const double d = edgeDistance(triangle, e, p);
        if (d >= margin) continue;
        if (!(d >= -margin) || near >= 0) return std::nullopt;
        near = e;
    }
    if (near < 0) return depthBound(triangle, p, margin);
    const glm::dvec3 a = triangle[size_t(near)], b = triangle[size_t((near + 1) % 3)];
    std::optional<double> best;
    for (const PlacedTriangle& other : others) {
        if (!std::isfinite(culling::depthSlope(other))) continue;
        bool shares = false;
        int clear = 0;
        for (int e = 0; e < 3; ++e) {
            const glm::dvec3 oa = other[size_t(e)], ob = other[size_t((e + 1) % 3)];
            if ((oa == a && ob == b) || (oa == b && ob == a))
                // The neighbour must lie on the edge's far side, else the surface folds back.
                shares = edgeDistance(triangle, near, glm::dvec2(other[size_t((e + 2) % 3)])) < 0;
            else clear += edgeDistance(other, e, p) >= margin;
        }
        if (!shares || clear != 2) continue;
        const double both = std::max(depthBound(triangle, p, margin), depthBound(other, p, margin));
        best = std::min(best.value_or(both), both);
    }
    return best;
}

}  // namespace tests
