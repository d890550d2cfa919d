// cache/work.h — regions to draw, in the order in which a limited frame takes them.
// Source: our own.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "cache/owed.h"
#include "cache/statistics.h"
#include "cache/texel_rect.h"

namespace cache {

/// What a frame may draw into cache maps at most, by the counters of its statistics.
struct Limits {
    static constexpr uint64_t kNone = std::numeric_limits<uint64_t>::max();
    uint64_t texels = kNone;
    uint64_t triangles = kNone;
    bool untouched = true;  ///< nothing was drawn yet: one smallest block may exceed `triangles`, or it never would be
    bool limited() const { return texels != kNone || triangles != kNone; }
    /// One of so many equal parts, rounded up.
    Limits part(uint64_t parts) const {
        const auto cut = [parts](uint64_t whole) { return whole == kNone ? kNone : whole / parts + (whole % parts > 0); };
        return {cut(texels), cut(triangles), untouched};
    }
    /// What is left after spending `cost`: nothing, once either is used up.
    Limits less(const Cost& cost) const {
        if (cost.texels >= texels || cost.triangles >= triangles) return {0, 0, false};
        return {texels == kNone ? kNone : texels - cost.texels, triangles == kNone ? kNone : triangles - cost.triangles,
                untouched && cost.texels == 0};
    }
};

/// A region of one cascade's window that is to be drawn.
struct Work {
    int cascade = 0;
    OwedRegion region;
    bool clear = true;  ///< drawn from nothing; else only this frame's new casters are added
};

/// Work that has waited for longer than this many frames comes before nearer work, for half of a limit.
constexpr uint64_t kPatience = 30;

/// Cuts work into blocks of at most kBlock x kBlock texels, aligned to the lattice, so that what is near
/// can be drawn before what is far.
constexpr int64_t kBlock = 128;
void cutIntoBlocks(std::vector<Work>& work);

/// Texels between a texel and the nearest one of a rectangle, along the longer axis; 0 inside.
int64_t distance(const TexelRect& rect, Texel from);

/// Orders by urgency: unknown before stale, near cascades before far ones, near texels before far ones;
/// ties by place, so that the order is total.
///   eyes  per cascade: the texel that holds the eye
void nearestFirst(std::vector<Work>& work, const std::vector<Texel>& eyes);
/// Orders by age, oldest first; ties as above.
void oldestFirst(std::vector<Work>& work, const std::vector<Texel>& eyes);

/// The half nearer `from`, cut across the longer edge. The rectangle has more than one texel.
TexelRect nearestHalf(const TexelRect& rect, Texel from);

/// The part of at most `area` > 0 texels to draw first: whole rows where one fits, those nearest `from`.
TexelRect nearestPart(const TexelRect& rect, int64_t area, Texel from);

}  // namespace cache
