// cache/rect_set.h — disjoint rectangles that cover what was added, merged where that is cheaper.
#pragma once

#include <span>
#include <vector>

#include "cache/texel_rect.h"

namespace cache {

/// A pass over a rectangle costs about as much as this many texels of area on top of it: a clear
/// and a scissored draw of nothing take 0.02 ms on lavapipe, the clear of 1024 x 1024 texels 0.07.
constexpr int64_t kRectOverhead = 64 * 64;

/// Appends the parts of `rect` outside `hole`: at most four disjoint rectangles.
void subtract(const TexelRect& rect, const TexelRect& hole, std::vector<TexelRect>& out);

/// Disjoint rectangles. Covers everything added and, where merging is cheaper, some more.
/// Keeps its memory when cleared. Edges are shorter than 2^26 texels: areas and their sums are then exact in
/// double, in which they are compared. One thread at a time.
class RectSet {
public:
    /// `limit` bounds the number of rectangles that an addition leaves apart from clipping pieces:
    /// beyond it the cheapest merge is taken whatever it costs.
    explicit RectSet(size_t limit = 32) : limit_(limit) {}

    void clear();
    void add(TexelRect rect);
    /// Adds without merging: covers exactly what it is given.
    void addExactly(const TexelRect& rect);
    /// Takes `hole` away.
    void remove(const TexelRect& hole);

    std::span<const TexelRect> rects() const { return rects_; }
    bool empty() const { return rects_.empty(); }
    int64_t area() const;

private:
    void append(const TexelRect& rect);
    void replaceByLast(size_t at);
    std::vector<TexelRect> rects_;
    std::vector<double> minX_, minY_, maxX_, maxY_;  ///< of `rects_`, for what asks all of them
    std::vector<double> waste_;                      ///< scratch, likewise
    std::vector<TexelRect> scratch_, pieces_;
    size_t limit_;
};

}  // namespace cache
