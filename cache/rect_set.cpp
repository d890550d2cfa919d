#include "cache/rect_set.h"

#include <limits>

namespace cache {

void subtract(const TexelRect& rect, const TexelRect& hole, std::vector<TexelRect>& out) {
    if (rect.empty()) return;
    const TexelRect cut = intersection(rect, hole);
    if (cut.empty()) {
        out.push_back(rect);
        return;
    }
    const TexelRect parts[4] = {
        {rect.min, {rect.max.x, cut.min.y}},                        // rows below the hole
        {{rect.min.x, cut.max.y}, rect.max},                        // rows above it
        {{rect.min.x, cut.min.y}, {cut.min.x, cut.max.y}},          // left of it
        {{cut.max.x, cut.min.y}, {rect.max.x, cut.max.y}},          // right of it
    };
    for (const TexelRect& part : parts)
        if (!part.empty()) out.push_back(part);
}

void RectSet::add(TexelRect rect) {
    if (rect.empty()) return;
    for (;;) {
        size_t best = rects_.size();
        int64_t bestWaste = rects_.size() >= limit_ ? std::numeric_limits<int64_t>::max() : kRectOverhead + 1;
        for (size_t i = 0; i < rects_.size(); ++i) {
            const int64_t together = rects_[i].area() + rect.area() - intersection(rects_[i], rect).area();
            const int64_t waste = hull(rects_[i], rect).area() - together;
            if (waste < bestWaste) {
                bestWaste = waste;
                best = i;
            }
        }
        if (best == rects_.size()) break;
        rect = hull(rect, rects_[best]);
        rects_[best] = rects_.back();
        rects_.pop_back();
    }
    addExactly(rect);
}

void RectSet::addExactly(const TexelRect& rect) {
    pieces_.clear();
    if (!rect.empty()) pieces_.push_back(rect);
    for (const TexelRect& r : rects_) {
        scratch_.clear();
        for (const TexelRect& piece : pieces_) subtract(piece, r, scratch_);
        pieces_.swap(scratch_);
    }
    rects_.insert(rects_.end(), pieces_.begin(), pieces_.end());
}

void RectSet::remove(const TexelRect& hole) {
    scratch_.clear();
    for (const TexelRect& r : rects_) subtract(r, hole, scratch_);
    rects_.swap(scratch_);
}

int64_t RectSet::area() const {
    int64_t sum = 0;
    for (const TexelRect& r : rects_) sum += r.area();
    return sum;
}

}  // namespace cache
