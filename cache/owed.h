// cache/owed.h — what a map still owes the world: regions whose texels are stale or unknown.
// Source: our own.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cache/statistics.h"
#include "cache/texel_rect.h"

namespace cache {

/// What a texel is that is not valid.
enum class Owes : uint8_t {
    kStale,    ///< holds a depth that was true of an earlier frame
    kUnknown,  ///< holds kUnknownDepth: nothing was drawn here since the window came
};

struct OwedRegion {
    TexelRect rect;
    Cause cause = Cause::kStart;
    Owes owes = Owes::kStale;
    uint64_t since = 0;  ///< frame in which it fell due
};

/// Disjoint regions of one window. Regions that touch along a whole edge and owe the same for the same
/// cause are kept as one, with the older date. One thread at a time.
class OwedSet {
public:
    /// Regions kept apart at most; beyond it those of one kind are replaced by what covers them.
    static constexpr size_t kMost = 256;

    void clear() { regions_.clear(); }
    /// Forgets what lies outside.
    void clip(const TexelRect& window);
    /// Adds those parts of the region that are not owed yet.
    void add(const OwedRegion& region);
    /// The rectangle was drawn.
    void settle(const TexelRect& drawn);
    /// Keeps the set small: where more than kMost regions are stale, their hull is, less what is unknown.
    void compactStale();
    /// Unknown regions cannot grow without forgetting depths: more than kMost of them also become one, and
    /// the caller must set to unknown what this returns: empty, or a rectangle that holds them all.
    TexelRect compactUnknown();

    std::span<const OwedRegion> regions() const { return regions_; }
    bool empty() const { return regions_.empty(); }
    int64_t area(Owes owes) const;
    /// Frames since the oldest region fell due; 0 if nothing is owed.
    uint64_t age(uint64_t now) const;

private:
    OwedRegion replaceByHull(Owes owes);
    std::vector<OwedRegion> regions_;
    std::vector<TexelRect> pieces_, scratch_;
};

}  // namespace cache
