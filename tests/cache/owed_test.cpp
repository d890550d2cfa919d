// OwedSet against a dumb grid of texels; works ordered and cut.
#include "cache/owed.h"

#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <random>

#include "cache/work.h"

namespace {

using cache::Owes;
using cache::OwedRegion;
using cache::OwedSet;
using cache::TexelRect;

constexpr int64_t kSpan = 40;

struct Debt {
    Owes owes;
    uint64_t since;
};

/// The same, texel by texel.
struct Grid {
    std::map<std::pair<int64_t, int64_t>, Debt> texels;
    void each(const TexelRect& r, auto f) {
        for (int64_t y = r.min.y; y < r.max.y; ++y)
            for (int64_t x = r.min.x; x < r.max.x; ++x) f(std::pair(x, y));
    }
};

TexelRect randomRect(std::mt19937& rng, int64_t most) {
    const cache::Texel min(int64_t(rng() % kSpan) - kSpan / 2, int64_t(rng() % kSpan) - kSpan / 2);
    return {min, min + cache::Texel(1 + int64_t(rng()) % most, 1 + int64_t(rng()) % most)};
}

TEST(OwedSet, IsWhatAGridOfTexelsIs) {
    std::mt19937 rng(21);
    OwedSet set;
    Grid grid;
    for (uint64_t step = 1; step < 3000; ++step) {
        const uint32_t what = rng() % 16;
        if (what < 8) {
            const OwedRegion region{randomRect(rng, 12), cache::Cause(rng() % 3), rng() % 2 ? Owes::kStale : Owes::kUnknown, step};
            set.add(region);
            grid.each(region.rect, [&](auto at) { grid.texels.try_emplace(at, Debt{region.owes, step}); });
        } else if (what < 15) {
            const TexelRect drawn = randomRect(rng, 9);
            set.settle(drawn);
            grid.each(drawn, [&](auto at) { grid.texels.erase(at); });
        } else {
            const TexelRect window = randomRect(rng, kSpan);
            set.clip(window);
            std::erase_if(grid.texels, [&](const auto& t) {
                const cache::Texel at(t.first.first, t.first.second);
                return !window.contains({at, at + int64_t(1)});
            });
        }
        size_t covered = 0;
        for (const OwedRegion& r : set.regions()) {
            grid.each(r.rect, [&](auto at) {
                ++covered;
                const auto held = grid.texels.find(at);
                ASSERT_NE(held, grid.texels.end()) << "step " << step;
                ASSERT_EQ(held->second.owes, r.owes) << "step " << step;
                ASSERT_LE(r.since, held->second.since) << "joined regions keep the older date";
            });
        }
        ASSERT_EQ(covered, grid.texels.size()) << "step " << step << ": regions overlap or miss";
        ASSERT_EQ(uint64_t(set.area(Owes::kStale) + set.area(Owes::kUnknown)), covered);
    }
}

TEST(OwedSet, NeighboursThatOweTheSameBecomeOne) {
    OwedSet set;
    for (int64_t x = 0; x < 20; ++x) set.add({{{x, 0}, {x + 1, 30}}, cache::Cause::kScroll, Owes::kUnknown, uint64_t(x)});
    ASSERT_EQ(set.regions().size(), 1u);
    EXPECT_EQ(set.regions()[0].rect, (TexelRect{{0, 0}, {20, 30}}));
    EXPECT_EQ(set.age(25), 25u);
}

TEST(OwedSet, StaysSmallWithoutForgettingDebts) {
    OwedSet set;
    for (int64_t i = 0; i < int64_t(OwedSet::kMost); ++i) {
        set.add({{{4 * i, 0}, {4 * i + 1, 1}}, cache::Cause::kScroll, Owes::kUnknown, 7});
        set.add({{{4 * i + 2, 0}, {4 * i + 3, 1}}, cache::Cause::kDeparture, Owes::kStale, 9});
    }
    EXPECT_TRUE(set.compactUnknown().empty());
    set.compactStale();
    EXPECT_EQ(set.regions().size(), 2 * OwedSet::kMost) << "no more than may be";
    set.add({{{0, 8}, {1, 9}}, cache::Cause::kScroll, Owes::kUnknown, 8});
    set.add({{{2, 20}, {3, 21}}, cache::Cause::kDeparture, Owes::kStale, 8});
    const TexelRect forgotten = set.compactUnknown();
    set.compactStale();
    EXPECT_EQ(forgotten, (TexelRect{{0, 0}, {4 * int64_t(OwedSet::kMost) - 3, 9}}));
    EXPECT_LE(set.regions().size(), 4u);
    EXPECT_EQ(set.area(Owes::kUnknown), forgotten.area());
    bool still = false;
    for (const OwedRegion& r : set.regions()) still |= r.rect.contains({{2, 20}, {3, 21}});
    EXPECT_TRUE(still);
}

TEST(Work, NearestPartFitsAndTouchesTheNearestTexel) {
    std::mt19937 rng(4);
    for (int step = 0; step < 2000; ++step) {
        const TexelRect rect = randomRect(rng, 30);
        const cache::Texel from(int64_t(rng() % 80) - 40, int64_t(rng() % 80) - 40);
        const int64_t area = 1 + int64_t(rng()) % rect.area();
        const TexelRect part = cache::nearestPart(rect, area, from);
        ASSERT_TRUE(rect.contains(part));
        ASSERT_LE(part.area(), area);
        ASSERT_GE(2 * part.area(), std::min(area, rect.area())) << "whole rows waste less than half";
        ASSERT_EQ(cache::distance(part, from), cache::distance(rect, from));
        if (rect.area() == 1) continue;
        const TexelRect half = cache::nearestHalf(rect, from);
        ASSERT_TRUE(rect.contains(half));
        ASSERT_LT(half.area(), rect.area());
        ASSERT_GT(half.area(), 0);
        ASSERT_EQ(cache::distance(half, from), cache::distance(rect, from));
    }
}

TEST(Work, BlocksCoverAndStayApart) {
    std::vector<cache::Work> work{{0, {{{-200, -5}, {300, 140}}, cache::Cause::kStart, Owes::kUnknown, 1}, true}};
    const int64_t area = work[0].region.rect.area();
    cache::cutIntoBlocks(work);
    int64_t sum = 0;
    for (size_t i = 0; i < work.size(); ++i) {
        const TexelRect& r = work[i].region.rect;
        EXPECT_LE(r.max.x - r.min.x, cache::kBlock);
        EXPECT_LE(r.max.y - r.min.y, cache::kBlock);
        sum += r.area();
        for (size_t j = 0; j < i; ++j) EXPECT_FALSE(r.overlaps(work[j].region.rect));
    }
    EXPECT_EQ(sum, area);
}

}  // namespace
