// culling/coverage.h — how deep, at each texel centre of a rectangle, triangles surely cover it.
// Source: our own; the rules bounded here are those of the Vulkan specification, chapter
// "Rasterization" (positions snap to a subpixel grid, edges of shared vertices leave no gap). Rows of a
// triangle are spans between its edges, after Pineda, "A Parallel Algorithm for Polygon Rasterization",
// 1988.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "world/casters.h"

namespace culling {

/// Positions snap to 1/256 texel on every driver we know, so they move by 1/512 at most; twice that
/// in each axis, rounded up, is the room an edge must leave.
constexpr double kSnapTexels = 1.0 / 128;

/// Corners in the map plane: x, y in texels, z in metres of light space.
using PlacedTriangle = std::array<glm::dvec3, 3>;

/// Depth slope of a triangle [m per texel]; infinite where it is seen edge on.
double depthSlope(const PlacedTriangle& triangle);

/// For each texel of a rectangle the nearest bound on depth that a caster proves there: the caster surely
/// covers the texel's centre, and no rasteriser puts it deeper. A triangle proves it alone where the centre
/// lies inside by more than a margin; two of one caster that meet at an edge prove it together where the
/// centre is nearer than that to this one edge. Reused from rectangle to rectangle; one thread at a time.
class Coverage {
public:
    /// Forgets everything. Of `size` texels, > 0, the low corner of (0, 0) is the origin of triangles.
    void reset(glm::ivec2 size);

    /// Texels where something of the rectangle [min, max] could count, none if first > last on an axis.
    ///   min, max  bounds in the map plane [texels]
    struct Range {
        glm::ivec2 first{0}, last{-1};
        bool empty() const { return first.x > last.x || first.y > last.y; }
    };
    Range range(glm::dvec2 min, glm::dvec2 max, double margin) const {
        // Centres lie at half texels. What is far outside must not reach an int.
        const glm::dvec2 first = min - (0.5 + margin), last = max - (0.5 - margin);
        if (!(last.x >= 0 && last.y >= 0 && first.x <= size_.x - 1 && first.y <= size_.y - 1)) return {};
        return {{roundUp(std::max(first.x, 0.0)), roundUp(std::max(first.y, 0.0))},
                {int(std::min(last.x, size_.x - 1.0)), int(std::min(last.y, size_.y - 1.0))}};
    }

    /// Adds a triangle. The order of triangles does not matter, but where casters prove the same depth the first
    /// one keeps the texel.
    ///   margin  room that a centre must have [texels]: kSnapTexels plus float error of the positions
    void add(world::CasterId caster, const PlacedTriangle& triangle, double margin) {
        const glm::dvec2 a(triangle[0]), b(triangle[1]), c(triangle[2]);
        const Range reach = range(glm::min(glm::min(a, b), c), glm::max(glm::max(a, b), c), margin);
        if (!reach.empty()) addWithin(reach, caster, triangle, margin);
    }
    /// Joins triangles across shared edges. To be called after the last `add`, before anything is read.
    void join();

    /// Bound on the depth [m], and the caster that proves it; infinite where nothing is proven.
    double depth(glm::ivec2 texel) const { return depths_[at(texel)]; }
    world::CasterId caster(glm::ivec2 texel) const { return casters_[at(texel)]; }
    /// True if the texels from `first` up to `last`, both within, are all proven nearer than `depth` [m].
    bool nearer(glm::ivec2 first, glm::ivec2 last, double depth) const;

private:
    /// Of numbers from 0 to 2^31; std::ceil is a call on a plain x86-64.
    static int roundUp(double value) {
        const int whole = int(value);
        return whole + (double(whole) < value);
    }
    /// One side of an edge at a centre near it: proves nothing until the other side is found.
    struct Half {
        size_t texel = 0;
        world::CasterId caster = 0;
        std::array<double, 6> edge{};  ///< both ends, in an order that does not depend on the triangle
        bool left = false;             ///< of the edge in that order
        double depth = 0;
    };
    void addWithin(const Range& reach, world::CasterId caster, const PlacedTriangle& triangle, double margin);
    size_t at(glm::ivec2 texel) const { return size_t(texel.y) * size_t(size_.x) + size_t(texel.x); }
    void prove(size_t texel, double depth, world::CasterId caster) {
        if (!(depth < depths_[texel])) return;
        depths_[texel] = depth;
        casters_[texel] = caster;
    }

    glm::ivec2 size_{0};
    std::vector<double> depths_;
    std::vector<world::CasterId> casters_;
    std::vector<Half> halves_;
};

}  // namespace culling
