// world/triangle_grid.cpp — see triangle_grid.h.
#include "world/triangle_grid.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace world {
namespace {

constexpr int kRings = 2;  // cells that the longest distance spans

}  // namespace

glm::vec3 nearestOnTriangle(glm::vec3 p, glm::vec3 a, glm::vec3 b, glm::vec3 c) {
    const glm::vec3 ab = b - a, ac = c - a, ap = p - a;
    const float d1 = glm::dot(ab, ap), d2 = glm::dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return a;
    const glm::vec3 bp = p - b;
    const float d3 = glm::dot(ab, bp), d4 = glm::dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return b;
    const float vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + ab * (d1 / (d1 - d3));
    const glm::vec3 cp = p - c;
    const float d5 = glm::dot(ab, cp), d6 = glm::dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return c;
    const float vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + ac * (d2 / (d2 - d6));
    const float va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 >= d3 && d5 >= d6) return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    const float scale = 1 / (va + vb + vc);
    return a + ab * (vb * scale) + ac * (vc * scale);
}

TriangleGrid::TriangleGrid(std::span<const glm::vec3> positions, std::span<const uint32_t> indices,
                           float reach)
    : positions_(positions), indices_(indices), reach_(reach), cell_(reach / kRings) {
    if (indices.empty()) return;
    glm::vec3 high = positions[indices[0]];
    low_ = high;
    for (const uint32_t i : indices) {
        low_ = glm::min(low_, positions[i]);
        high = glm::max(high, positions[i]);
    }
    cells_ = glm::ivec3((high - low_) / cell_) + 1;

    // Counting sort: count per cell, prefix sums, then fill.
    const auto forCells = [&](uint32_t triangle, auto&& visit) {
        const glm::vec3 a = positions[indices[3 * triangle]], b = positions[indices[3 * triangle + 1]],
                        c = positions[indices[3 * triangle + 2]];
        const glm::ivec3 from((glm::min(a, glm::min(b, c)) - low_) / cell_);
        const glm::ivec3 to((glm::max(a, glm::max(b, c)) - low_) / cell_);
        for (int x = from.x; x <= to.x; ++x)
            for (int y = from.y; y <= to.y; ++y)
                for (int z = from.z; z <= to.z; ++z)
                    visit(static_cast<size_t>((x * cells_.y + y) * cells_.z + z));
    };
    const auto count = static_cast<uint32_t>(indices.size() / 3);
    first_.assign(
        static_cast<size_t>(cells_.x) * static_cast<size_t>(cells_.y) * static_cast<size_t>(cells_.z) + 1, 0);
    for (uint32_t t = 0; t < count; ++t) forCells(t, [&](size_t cell) { ++first_[cell + 1]; });
    for (size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    triangles_.resize(first_.back());
    std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
    for (uint32_t t = 0; t < count; ++t) forCells(t, [&](size_t cell) { triangles_[next[cell]++] = t; });
}

/// True if a triangle lies within `distance` of p; else `distance` becomes the distance to the
/// nearest one, at most reach_.
bool TriangleGrid::within(glm::vec3 p, float& distance) const {
    const float enough = distance * distance;
    float best = reach_ * reach_;
    const glm::ivec3 home(glm::floor((p - low_) / cell_));
    const auto look = [&](glm::ivec3 at) {
        const size_t cell = static_cast<size_t>((at.x * cells_.y + at.y) * cells_.z + at.z);
        for (uint32_t i = first_[cell]; i < first_[cell + 1]; ++i) {
            const uint32_t* v = &indices_[3 * triangles_[i]];
            const glm::vec3 to =
                nearestOnTriangle(p, positions_[v[0]], positions_[v[1]], positions_[v[2]]) - p;
            best = std::min(best, glm::dot(to, to));  // keeps best where the other is not a number
            if (best <= enough) return true;
        }
        return false;
    };
    const auto inside = [&](glm::ivec3 at) {
        return glm::all(glm::greaterThanEqual(at, glm::ivec3(0))) && glm::all(glm::lessThan(at, cells_));
    };
    for (int ring = 0; ring <= kRings; ++ring) {
        for (int x = -ring; x <= ring; ++x)
            for (int y = -ring; y <= ring; ++y) {
                // Inside the ring's faces only the two ends of a row belong to it.
                const int step = std::max(std::abs(x), std::abs(y)) == ring ? 1 : 2 * ring;
                for (int z = -ring; z <= ring; z += step) {
                    const glm::ivec3 at = home + glm::ivec3(x, y, z);
                    if (inside(at) && look(at)) return true;
                }
            }
        // What no ring so far holds is at least so many cells away, but for rounding.
        const float seen = (float(ring) - 0.01f) * cell_;
        if (ring > 0 && best <= seen * seen) break;
    }
    distance = std::sqrt(best);
    return false;
}

float TriangleGrid::farthest(std::span<const glm::vec3> points, float atLeast) const {
    float largest = atLeast;
    if (indices_.empty()) return points.empty() ? largest : reach_;
    for (const glm::vec3& p : points) {
        within(p, largest);
        if (largest >= reach_) return reach_;
    }
    return largest;
}

}  // namespace world
