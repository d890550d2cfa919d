#include "culling/coverage.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

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

std::vector<uint32_t> neighbours(const world::MeshLevel& level) {
    // Vertices at one place are one corner, whatever number they have.
    const auto& positions = level.positions;
    std::vector<uint32_t> order(positions.size());
    std::iota(order.begin(), order.end(), 0u);
    const auto before = [&](uint32_t a, uint32_t b) {
        const glm::vec3 &p = positions[a], &q = positions[b];
        return p.x != q.x ? p.x < q.x : p.y != q.y ? p.y < q.y : p.z < q.z;
    };
    std::sort(order.begin(), order.end(), before);
    std::vector<uint32_t> corner(positions.size());
    for (size_t i = 0; i < order.size(); ++i)
        corner[order[i]] = i > 0 && !before(order[i - 1], order[i]) ? corner[order[i - 1]] : order[i];

    struct Edge {
        uint32_t low, high, at;
    };
    std::vector<Edge> edges;
    edges.reserve(level.indices.size());
    for (uint32_t i = 0; i < level.indices.size(); ++i) {
        const uint32_t next = i % 3 == 2 ? i - 2 : i + 1;
        const uint32_t a = corner[level.indices[i]], b = corner[level.indices[next]];
        edges.push_back({std::min(a, b), std::max(a, b), i});
    }
    std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
        return a.low != b.low ? a.low < b.low : a.high != b.high ? a.high < b.high : a.at < b.at;
    });
    std::vector<uint32_t> result(level.indices.size(), kNoNeighbour);
    for (size_t i = 0; i < edges.size();) {
        size_t end = i + 1;
        while (end < edges.size() && edges[end].low == edges[i].low && edges[end].high == edges[i].high) ++end;
        if (end - i == 2) {
            result[edges[i].at] = edges[i + 1].at / 3;
            result[edges[i + 1].at] = edges[i].at / 3;
        }
        i = end;
    }
    return result;
}

}  // namespace culling
