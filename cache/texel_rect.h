// cache/texel_rect.h — integer rectangles of lattice texels.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>

namespace cache {

using Texel = glm::i64vec2;  ///< index of a lattice texel, counted from the world's origin

/// Texels t with min <= t < max; empty when max <= min on an axis.
struct TexelRect {
    Texel min{0}, max{0};

    bool empty() const { return max.x <= min.x || max.y <= min.y; }
    int64_t area() const { return empty() ? 0 : (max.x - min.x) * (max.y - min.y); }
    bool overlaps(const TexelRect& o) const {
        return min.x < o.max.x && o.min.x < max.x && min.y < o.max.y && o.min.y < max.y;
    }
    bool contains(const TexelRect& o) const {
        return min.x <= o.min.x && min.y <= o.min.y && o.max.x <= max.x && o.max.y <= max.y;
    }
    friend bool operator==(const TexelRect&, const TexelRect&) = default;
};

inline TexelRect intersection(const TexelRect& a, const TexelRect& b) {
    return {glm::max(a.min, b.min), glm::min(a.max, b.max)};
}
/// The smallest rectangle around both; an empty one adds nothing.
inline TexelRect hull(const TexelRect& a, const TexelRect& b) {
    if (a.empty()) return b;
    if (b.empty()) return a;
    return {glm::min(a.min, b.min), glm::max(a.max, b.max)};
}

}  // namespace cache
