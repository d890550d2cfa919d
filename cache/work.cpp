#include "cache/work.h"

#include <algorithm>
#include <tuple>

namespace cache {

namespace {

/// The end of the block that holds `at`.
int64_t blockEnd(int64_t at) { return at - ((at % kBlock) + kBlock) % kBlock + kBlock; }

/// `count` of the numbers [low, high) as near to `from` as can be: where they start.
int64_t startNear(int64_t low, int64_t high, int64_t count, int64_t from) {
    return std::clamp(from - count / 2, low, high - count);
}

auto urgency(const Work& w, const std::vector<Texel>& eyes) {
    const TexelRect& r = w.region.rect;
    return std::tuple(w.region.owes == Owes::kUnknown ? 0 : 1, w.cascade, distance(r, eyes[size_t(w.cascade)]),
                      r.min.y, r.min.x);
}

}  // namespace

void cutIntoBlocks(std::vector<Work>& work) {
    std::vector<Work> blocks;
    for (const Work& w : work) {
        const TexelRect& r = w.region.rect;
        for (int64_t y = r.min.y; y < r.max.y; y = blockEnd(y)) {
            for (int64_t x = r.min.x; x < r.max.x; x = blockEnd(x)) {
                blocks.push_back(w);
                blocks.back().region.rect = intersection(r, {{x, y}, {blockEnd(x), blockEnd(y)}});
            }
        }
    }
    work.swap(blocks);
}

int64_t distance(const TexelRect& rect, Texel from) {
    const Texel out = glm::max(rect.min - from, from - (rect.max - Texel(1)));
    return std::max<int64_t>(0, std::max(out.x, out.y));
}

void nearestFirst(std::vector<Work>& work, const std::vector<Texel>& eyes) {
    std::sort(work.begin(), work.end(), [&](const Work& a, const Work& b) { return urgency(a, eyes) < urgency(b, eyes); });
}

void oldestFirst(std::vector<Work>& work, const std::vector<Texel>& eyes) {
    std::sort(work.begin(), work.end(), [&](const Work& a, const Work& b) {
        if (a.region.since != b.region.since) return a.region.since < b.region.since;
        return urgency(a, eyes) < urgency(b, eyes);
    });
}

TexelRect nearestHalf(const TexelRect& rect, Texel from) {
    const int axis = rect.max.x - rect.min.x >= rect.max.y - rect.min.y ? 0 : 1;
    const int64_t middle = (rect.min[axis] + rect.max[axis]) / 2;
    TexelRect half = rect;
    (from[axis] < middle ? half.max : half.min)[axis] = middle;
    return half;
}

TexelRect nearestPart(const TexelRect& rect, int64_t area, Texel from) {
    const Texel size = rect.max - rect.min;
    const int64_t rows = std::clamp<int64_t>(area / size.x, 1, size.y), columns = std::min(size.x, area);
    const Texel low(startNear(rect.min.x, rect.max.x, columns, from.x), startNear(rect.min.y, rect.max.y, rows, from.y));
    return {low, low + Texel(columns, rows)};
}

}  // namespace cache
