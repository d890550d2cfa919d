// cache/depth_range.h — the stretch of the light's way that a cascade's depths cover, and when it must move.
// Source: our own.
#pragma once

#include <algorithm>
#include <cmath>

#include "culling/cascades.h"

namespace cache {

/// Light-space z [m] from `near`, which is stored as the least depth, to near + length, stored as 1. Casters
/// nearer the sun are clamped to the least depth and still cast; those farther off are not seen.
struct DepthRange {
    double near = 0;
    double length = 1;  ///< > 0
    double far() const { return near + length; }
    friend bool operator==(const DepthRange&, const DepthRange&) = default;
};

/// A unit of depth is at most this share of a texel's edge: well below what a receiver's bias must allow for.
constexpr double kUnitTexels = 1.0 / 8;

/// Length [m] of a cascade's range in a world of any size: as long as a format of `steps` distinct depths can
/// make it in small enough units, and never less than eight times the split.
inline double longestRange(const culling::Cascade& cascade, double steps) {
    return std::max(steps * cascade.texel * kUnitTexels, 8 * cascade.split);
}

/// Where one cascade's range lies. Receivers that the cascade serves are within its split of the eye. A range
/// as long as the scene lies on it for good; a shorter one is anchored in steps of 1/16 of its length, and
/// holds until a receiver could leave it.
class DepthAnchor {
public:
    DepthAnchor(const culling::Cascade& cascade, const DepthRange& scene, double steps)
        : scene_(scene), length_(std::min(scene.length, longestRange(cascade, steps))), reach_(cascade.split) {}

    /// The range for an eye at `z` [m], in the middle of it or nearly so.
    DepthRange at(double z) const {
        const double step = length_ / 16;
        const double near = std::round((z - length_ / 2) / step) * step;
        return {std::clamp(near, scene_.near, scene_.far() - length_), length_};
    }
    /// All that lies in the scene and within the split of the eye is in the range.
    bool holds(const DepthRange& range, double z) const { return holds(range, z, reach_); }
    /// The eye comes near the end: an eighth of the range is left, and another one would be better.
    bool wearsOut(const DepthRange& range, double z) const {
        return !holds(range, z, reach_ + length_ / 8) && at(z) != range;
    }

private:
    bool holds(const DepthRange& range, double z, double reach) const {
        const double low = std::max(z - reach, scene_.near), high = std::min(z + reach, scene_.far());
        return low >= high || (low >= range.near && high <= range.far());
    }
    DepthRange scene_;
    double length_, reach_;
};

}  // namespace cache
