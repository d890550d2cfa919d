#include "culling/coverage.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace culling {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

double cross(glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x; }

double doubleArea(const PlacedTriangle& t) {
    return cross(glm::dvec2(t[1] - t[0]), glm::dvec2(t[2] - t[0]));
}

/// Change of depth per texel along x and y.
glm::dvec2 gradient(const PlacedTriangle& t, double area) {
    const glm::dvec3 u = t[1] - t[0], v = t[2] - t[0];
    return {(u.z * v.y - v.z * u.y) / area, (v.z * u.x - u.z * v.x) / area};
}

/// An edge's line as dot(normal, p) + offset: distance times length, positive on the inner side.
struct Line {
    glm::dvec2 normal{0};
    double offset = 0;
    double room = 0;     ///< what the margin is on this scale
    double inverse = 0;  ///< 1 / normal.x
    double at(glm::dvec2 p) const { return glm::dot(normal, p) + offset; }
};

/// An interval of x.
struct Span {
    double low, high;
    /// Keeps the part where the line's value is `least` or more; `value` is that at x = 0.
    void keep(const Line& line, double value, double least) {
        const double x = (least - value) * line.inverse;
        if (line.normal.x > 0) low = std::max(low, x);
        else if (line.normal.x < 0) high = std::min(high, x);
        else if (!(value >= least)) high = -kInfinity;
    }
};

}  // namespace

double depthSlope(const PlacedTriangle& triangle) {
    const double slope = glm::length(gradient(triangle, doubleArea(triangle)));
    return std::isfinite(slope) ? slope : kInfinity;
}

void Coverage::reset(glm::ivec2 size) {
    size_ = size;
    const size_t texels = size_t(size.x) * size_t(size.y);
    depths_.assign(texels, kInfinity);
    casters_.resize(texels);
    halves_.clear();
}

void Coverage::addWithin(const Range& reach, world::CasterId caster, const PlacedTriangle& triangle, double margin) {
    const double area = doubleArea(triangle);
    std::array<Line, 3> lines;
    for (size_t e = 0; e < 3; ++e) {
        const glm::dvec2 from(triangle[e]), to(triangle[(e + 1) % 3]);
        Line& line = lines[e];
        line.normal = area > 0 ? glm::dvec2(from.y - to.y, to.x - from.x) : glm::dvec2(to.y - from.y, from.x - to.x);
        line.offset = -glm::dot(line.normal, from);
        // Most small triangles miss the few centres around them: the corner of the box that is farthest inside
        // decides, with a length that is too long rather than too short.
        const double most = line.at({(line.normal.x > 0 ? reach.last.x : reach.first.x) + 0.5,
                                     (line.normal.y > 0 ? reach.last.y : reach.first.y) + 0.5});
        if (most < -margin * (std::abs(line.normal.x) + std::abs(line.normal.y))) return;
    }
    const glm::dvec2 g = gradient(triangle, area);
    const double slope = glm::length(g);
    if (!std::isfinite(slope)) return;  // seen edge on
    for (Line& line : lines) {
        line.room = margin * glm::length(line.normal);
    }
    const auto depthAt = [&](glm::dvec2 p) { return triangle[0].z + glm::dot(g, p - glm::dvec2(triangle[0])) + slope * margin; };
    const auto nearAnEdge = [&](glm::ivec2 texel) {
        const glm::dvec2 p = glm::dvec2(texel) + 0.5;
        size_t near = 3;
        for (size_t e = 0; e < 3; ++e) {
            const double value = lines[e].at(p);
            if (value >= lines[e].room) continue;
            // Near two edges is near a corner, where any number of triangles may meet.
            if (!(value >= -lines[e].room) || near < 3) return;
            near = e;
        }
        const double depth = depthAt(p);
        if (near == 3) return prove(at(texel), depth, caster);  // a span's end, rounded the other way
        if (!(depth < depths_[at(texel)])) return;
        const glm::dvec3 &from = triangle[near], &to = triangle[(near + 1) % 3];
        Half half{at(texel), caster, {from.x, from.y, from.z, to.x, to.y, to.z}, area > 0, depth};
        if (std::tie(to.x, to.y, to.z) < std::tie(from.x, from.y, from.z)) {
            half.edge = {to.x, to.y, to.z, from.x, from.y, from.z};
            half.left = !half.left;
        }
        halves_.push_back(half);
    };
    for (Line& line : lines) line.inverse = 1 / line.normal.x;
    for (int y = reach.first.y; y <= reach.last.y; ++y) {
        Span inner{reach.first.x + 0.5, reach.last.x + 0.5}, outer = inner;
        for (const Line& line : lines) {
            const double value = line.normal.y * (y + 0.5) + line.offset;
            inner.keep(line, value, line.room);
            outer.keep(line, value, -line.room);
        }
        if (!(outer.low <= outer.high)) continue;
        const int from = roundUp(outer.low - 0.5), to = int(outer.high - 0.5);
        int first = to + 1, last = to;
        if (inner.low <= inner.high && roundUp(inner.low - 0.5) <= int(inner.high - 0.5)) {
            first = roundUp(inner.low - 0.5);
            last = int(inner.high - 0.5);
        }
        for (int x = from; x < first; ++x) nearAnEdge({x, y});
        const size_t row = at({0, y});
        const double start = depthAt({0.5, y + 0.5});
        for (int x = first; x <= last; ++x) prove(row + size_t(x), start + g.x * x, caster);
        for (int x = last + 1; x <= to; ++x) nearAnEdge({x, y});
    }
}

void Coverage::join() {
    std::sort(halves_.begin(), halves_.end(), [](const Half& a, const Half& b) {
        return std::tie(a.texel, a.caster, a.edge, a.left, a.depth) < std::tie(b.texel, b.caster, b.edge, b.left, b.depth);
    });
    const auto meet = [](const Half& a, const Half& b) {
        return a.texel == b.texel && a.caster == b.caster && a.edge == b.edge;
    };
    for (size_t first = 0, end = 0; first < halves_.size(); first = end) {
        while (end < halves_.size() && meet(halves_[first], halves_[end])) ++end;
        // Of the triangles on each side the nearest one: right ones come first.
        const Half& right = halves_[first];
        const auto left = std::find_if(halves_.begin() + std::ptrdiff_t(first), halves_.begin() + std::ptrdiff_t(end),
                                       [](const Half& half) { return half.left; });
        if (right.left || left == halves_.begin() + std::ptrdiff_t(end)) continue;  // a rim, or a fold
        prove(right.texel, std::max(right.depth, left->depth), right.caster);
    }
}

bool Coverage::nearer(glm::ivec2 first, glm::ivec2 last, double depth) const {
    // Whole rows at a time: to stop at the first open texel would cost more than to go on.
    bool all = true;
    for (int y = first.y; y <= last.y; ++y) {
        const double* row = depths_.data() + at({0, y});
        int open = 0;
        for (int x = first.x; x <= last.x; ++x) open |= !(row[x] < depth);
        all &= !open;
    }
    return all;
}

}  // namespace culling
