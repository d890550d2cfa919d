#include "cache/rect_set.h"

#include <limits>

namespace cache {

namespace {

/// What the hull of each rectangle and `rect` covers beyond the two: rows of doubles, which become vectors.
void wasteOfHulls(const double* minX, const double* minY, const double* maxX, const double* maxY, size_t count,
                  const TexelRect& rect, double* __restrict waste) {
    const double lowX = double(rect.min.x), lowY = double(rect.min.y), highX = double(rect.max.x),
                 highY = double(rect.max.y), area = (highX - lowX) * (highY - lowY);
    for (size_t i = 0; i < count; ++i) {
        const double hullX = (maxX[i] > highX ? maxX[i] : highX) - (minX[i] < lowX ? minX[i] : lowX);
        const double hullY = (maxY[i] > highY ? maxY[i] : highY) - (minY[i] < lowY ? minY[i] : lowY);
        const double cutX = (maxX[i] < highX ? maxX[i] : highX) - (minX[i] > lowX ? minX[i] : lowX);
        const double cutY = (maxY[i] < highY ? maxY[i] : highY) - (minY[i] > lowY ? minY[i] : lowY);
        const double shared = (cutX > 0 ? cutX : 0) * (cutY > 0 ? cutY : 0);
        waste[i] = hullX * hullY - ((maxX[i] - minX[i]) * (maxY[i] - minY[i]) + area - shared);
    }
}

}  // namespace

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

void RectSet::clear() {
    rects_.clear();
    for (auto* row : {&minX_, &minY_, &maxX_, &maxY_, &waste_}) row->clear();
}

void RectSet::append(const TexelRect& rect) {
    rects_.push_back(rect);
    minX_.push_back(double(rect.min.x));
    minY_.push_back(double(rect.min.y));
    maxX_.push_back(double(rect.max.x));
    maxY_.push_back(double(rect.max.y));
    waste_.push_back(0);
}

void RectSet::replaceByLast(size_t at) {
    rects_[at] = rects_.back();
    rects_.pop_back();
    for (auto* row : {&minX_, &minY_, &maxX_, &maxY_, &waste_}) {
        (*row)[at] = row->back();
        row->pop_back();
    }
}

void RectSet::add(TexelRect rect) {
    if (rect.empty()) return;
    for (;;) {
        wasteOfHulls(minX_.data(), minY_.data(), maxX_.data(), maxY_.data(), rects_.size(), rect, waste_.data());
        size_t best = rects_.size();
        double bestWaste = rects_.size() >= limit_ ? std::numeric_limits<double>::infinity() : double(kRectOverhead + 1);
        for (size_t i = 0; i < rects_.size(); ++i) {
            if (waste_[i] < bestWaste) {
                bestWaste = waste_[i];
                best = i;
            }
        }
        if (best == rects_.size()) break;
        rect = hull(rect, rects_[best]);
        replaceByLast(best);
    }
    addExactly(rect);
}

void RectSet::addExactly(const TexelRect& rect) {
    pieces_.clear();
    if (!rect.empty()) pieces_.push_back(rect);
    for (const TexelRect& r : rects_) {
        if (!r.overlaps(rect)) continue;
        scratch_.clear();
        for (const TexelRect& piece : pieces_) subtract(piece, r, scratch_);
        pieces_.swap(scratch_);
    }
    for (const TexelRect& piece : pieces_) append(piece);
}

void RectSet::remove(const TexelRect& hole) {
    pieces_.assign(rects_.begin(), rects_.end());
    clear();
    scratch_.clear();
    for (const TexelRect& r : pieces_) subtract(r, hole, scratch_);
    for (const TexelRect& r : scratch_) append(r);
}

int64_t RectSet::area() const {
    int64_t sum = 0;
    for (const TexelRect& r : rects_) sum += r.area();
    return sum;
}

}  // namespace cache
