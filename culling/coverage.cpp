#include "culling/coverage.h"

#include <cmath>
#include <limits>

namespace culling {

namespace {

double cross(glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; }

double doubleArea(const PlacedTriangle& t) {
    return cross(glm::dvec2(t[1] - t[0]), glm::dvec2(t[2] - t[0]));
}

/// Change of depth per texel along x and y.
glm::dvec2 gradient(const PlacedTriangle& t) {
    const glm::dvec3 u = t[1] - t[0], v = t[2] - t[0];
    const double area = doubleArea(t);
    return {(u.z * v.y - v.z * u.y) / area, (v.z * u.x - u.z * v.x) / area};
}

}  // namespace

double depthSlope(const PlacedTriangle& triangle) {
    const double slope = glm::length(gradient(triangle));
    return std::isfinite(slope) ? slope : std::numeric_limits<double>::infinity();
}

double edgeDistance(const PlacedTriangle& triangle, int e, glm::dvec2 p) {
    const glm::dvec2 a(triangle[size_t(e)]), b(triangle[size_t((e + 1) % 3)]);
    const double side = doubleArea(triangle) > 0 ? 1 : -1;
    return side * cross(b - a, p - a) / glm::length(b - a);
}

double depthBound(const PlacedTriangle& triangle, glm::dvec2 p, double margin) {
    const glm::dvec2 g = gradient(triangle);
    return triangle[0].z + glm::dot(g, p - glm::dvec2(triangle[0])) + glm::length(g) * margin;
}

}  // namespace culling
