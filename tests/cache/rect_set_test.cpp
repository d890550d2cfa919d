// Rectangle sets against a bitmap.
#include "cache/rect_set.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <random>
#include <vector>

namespace {

using cache::RectSet;
using cache::Texel;
using cache::TexelRect;

constexpr int kGrid = 48;
using Bitmap = std::array<std::array<int, kGrid>, kGrid>;

void paint(Bitmap& map, const TexelRect& r, int add) {
    for (int64_t y = r.min.y; y < r.max.y; ++y)
        for (int64_t x = r.min.x; x < r.max.x; ++x) map[size_t(y)][size_t(x)] += add;
}

TexelRect randomRect(std::mt19937& rng) {
    std::uniform_int_distribution<int64_t> at(0, kGrid);
    const int64_t a = at(rng), b = at(rng), c = at(rng), d = at(rng);
    return {{std::min(a, b), std::min(c, d)}, {std::max(a, b), std::max(c, d)}};
}

TEST(RectSet, ExactAdditionAndRemovalMatchABitmap) {
    std::mt19937 rng(11);
    for (int round = 0; round < 200; ++round) {
        RectSet set;
        Bitmap truth{};
        for (int step = 0; step < 12; ++step) {
            const TexelRect r = randomRect(rng);
            const bool add = rng() % 3 != 0;
            if (add) set.addExactly(r);
            else set.remove(r);
            for (int64_t y = r.min.y; y < r.max.y; ++y)
                for (int64_t x = r.min.x; x < r.max.x; ++x) truth[size_t(y)][size_t(x)] = add;
            Bitmap held{};
            for (const TexelRect& s : set.rects()) paint(held, s, 1);
            ASSERT_EQ(held, truth) << "round " << round << " step " << step;  // 2 would be an overlap
        }
    }
}

TEST(RectSet, MergedAdditionCoversAllAndStaysDisjoint) {
    std::mt19937 rng(12);
    for (int round = 0; round < 200; ++round) {
        RectSet set(3);  // forces merges
        Bitmap wanted{};
        for (int step = 0; step < 12; ++step) {
            const TexelRect r = randomRect(rng);
            set.add(r);
            paint(wanted, r, 1);
            Bitmap held{};
            for (const TexelRect& s : set.rects()) paint(held, s, 1);
            for (size_t y = 0; y < kGrid; ++y)
                for (size_t x = 0; x < kGrid; ++x) {
                    ASSERT_LE(held[y][x], 1) << "overlap, round " << round;
                    ASSERT_TRUE(held[y][x] == 1 || !wanted[y][x]) << "hole, round " << round;
                }
        }
    }
}

/// The same rules in whole numbers, one rectangle at a time.
class ScalarSet {
public:
    explicit ScalarSet(size_t limit) : limit_(limit) {}
    void add(TexelRect rect) {
        if (rect.empty()) return;
        for (;;) {
            size_t best = rects.size();
            int64_t bestWaste = rects.size() >= limit_ ? std::numeric_limits<int64_t>::max() : cache::kRectOverhead + 1;
            for (size_t i = 0; i < rects.size(); ++i) {
                const int64_t together = rects[i].area() + rect.area() - intersection(rects[i], rect).area();
                const int64_t waste = hull(rects[i], rect).area() - together;
                if (waste >= bestWaste) continue;
                bestWaste = waste;
                best = i;
            }
            if (best == rects.size()) break;
            rect = hull(rect, rects[best]);
            rects[best] = rects.back();
            rects.pop_back();
        }
        std::vector<TexelRect> pieces{rect};
        for (const TexelRect& r : rects) {
            std::vector<TexelRect> rest;
            for (const TexelRect& piece : pieces) cache::subtract(piece, r, rest);
            pieces = rest;
        }
        rects.insert(rects.end(), pieces.begin(), pieces.end());
    }
    std::vector<TexelRect> rects;

private:
    size_t limit_;
};

// In rows of doubles the merges are those of whole numbers, ties included, 1000 km out at 4 cm a texel as well.
TEST(RectSet, MergesLikeWholeNumbers) {
    std::mt19937 rng(13);
    size_t most = 0;
    for (const int64_t far : {int64_t(0), int64_t(25'000'000)}) {
        for (int round = 0; round < 60; ++round) {
            const size_t limit = round % 3 ? 32 : 4;
            RectSet set(limit);
            ScalarSet truth(limit);
            const int64_t side = round % 2 ? 8192 : 300;
            const auto at = [&](int64_t below) { return int64_t(rng() % uint64_t(below)); };
            for (int step = 0; step < 300; ++step) {
                const Texel min(far + at(side), at(side) - far), size(at(round % 5 ? 40 : side), at(40));
                set.add({min, min + size});
                truth.add({min, min + size});
                ASSERT_TRUE(std::equal(set.rects().begin(), set.rects().end(), truth.rects.begin(), truth.rects.end()))
                    << "round " << round << " step " << step;
                most = std::max(most, truth.rects.size());
            }
            set.clear();
            EXPECT_TRUE(set.empty());
        }
    }
    EXPECT_GT(most, 31u);
}

TEST(RectSet, KeepsDistantRectanglesApart) {
    RectSet set;
    set.add({{0, 0}, {10, 10}});
    set.add({{100000, 0}, {100010, 10}});
    EXPECT_EQ(set.area(), 200);
    set.add({{5, 5}, {15, 15}});  // near the first: one rectangle is cheaper than three
    EXPECT_EQ(set.rects().size(), 2u);
    EXPECT_EQ(set.area(), 15 * 15 + 100);
}

}  // namespace
