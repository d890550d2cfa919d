#include "cache/owed.h"

#include <algorithm>

#include "cache/rect_set.h"

namespace cache {

namespace {

/// True if the two rectangles together are one.
bool complete(const TexelRect& a, const TexelRect& b) {
    const bool sameRows = a.min.y == b.min.y && a.max.y == b.max.y;
    const bool sameColumns = a.min.x == b.min.x && a.max.x == b.max.x;
    return (sameRows && (a.max.x == b.min.x || b.max.x == a.min.x)) ||
           (sameColumns && (a.max.y == b.min.y || b.max.y == a.min.y));
}

}  // namespace

void OwedSet::clip(const TexelRect& window) {
    for (OwedRegion& r : regions_) r.rect = intersection(r.rect, window);
    std::erase_if(regions_, [](const OwedRegion& r) { return r.rect.empty(); });
}

void OwedSet::add(const OwedRegion& region) {
    pieces_.clear();
    if (!region.rect.empty()) pieces_.push_back(region.rect);
    for (const OwedRegion& r : regions_) {
        scratch_.clear();
        for (const TexelRect& piece : pieces_) subtract(piece, r.rect, scratch_);
        pieces_.swap(scratch_);
    }
    for (const TexelRect& piece : pieces_) {
        OwedRegion fresh = region;
        fresh.rect = piece;
        for (size_t i = 0; i < regions_.size();) {
            const OwedRegion& r = regions_[i];
            if (r.owes != fresh.owes || r.cause != fresh.cause || !complete(r.rect, fresh.rect)) {
                ++i;
                continue;
            }
            fresh.rect = hull(fresh.rect, r.rect);
            fresh.since = std::min(fresh.since, r.since);
            regions_.erase(regions_.begin() + std::ptrdiff_t(i));
            i = 0;  // the larger one may complete another
        }
        regions_.push_back(fresh);
    }
}

void OwedSet::settle(const TexelRect& drawn) {
    for (size_t i = 0, count = regions_.size(); i < count;) {
        if (!regions_[i].rect.overlaps(drawn)) {
            ++i;
            continue;
        }
        const OwedRegion cut = regions_[i];
        regions_.erase(regions_.begin() + std::ptrdiff_t(i));
        --count;
        scratch_.clear();
        subtract(cut.rect, drawn, scratch_);
        for (const TexelRect& rest : scratch_) regions_.push_back({rest, cut.cause, cut.owes, cut.since});
    }
}

/// Takes away more than kMost regions of one kind; their hull with the oldest one's date, empty if there
/// are no more than that.
OwedRegion OwedSet::replaceByHull(Owes owes) {
    OwedRegion all{{}, Cause::kStart, owes, 0};
    size_t count = 0;
    for (const OwedRegion& r : regions_) {
        if (r.owes != owes) continue;
        if (count++ == 0 || r.since < all.since) {
            all.since = r.since;
            all.cause = r.cause;
        }
        all.rect = hull(all.rect, r.rect);
    }
    if (count <= kMost) return {};
    std::erase_if(regions_, [owes](const OwedRegion& r) { return r.owes == owes; });
    return all;
}

void OwedSet::compactStale() { add(replaceByHull(Owes::kStale)); }

TexelRect OwedSet::compactUnknown() {
    const OwedRegion all = replaceByHull(Owes::kUnknown);
    settle(all.rect);  // stale texels in it are forgotten with the rest
    add(all);
    return all.rect;
}

int64_t OwedSet::area(Owes owes) const {
    int64_t sum = 0;
    for (const OwedRegion& r : regions_)
        if (r.owes == owes) sum += r.rect.area();
    return sum;
}

uint64_t OwedSet::age(uint64_t now) const {
    uint64_t oldest = now;
    for (const OwedRegion& r : regions_) oldest = std::min(oldest, r.since);
    return now - oldest;
}

}  // namespace cache
