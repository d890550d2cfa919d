// Rectangle sets against a bitmap.
#include "cache/rect_set.h"

#include <gtest/gtest.h>

#include <array>
#include <random>

namespace {

using cache::RectSet;
using cache::Texel;
using cache::TexelRect;

constexpr int kSide = 48;
using Bitmap = std::array<std::array<int, kSide>, kSide>;

void paint(Bitmap& map, const TexelRect& r, int add) {
    for (int64_t y = r.min.y; y < r.max.y; ++y)
        for (int64_t x = r.min.x; x < r.max.x; ++x) map[size_t(y)][size_t(x)] += add;
}

TexelRect randomRect(std::mt19937& rng) {
    std::uniform_int_distribution<int64_t> at(0, kSide);
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
            for (size_t y = 0; y < kSide; ++y)
                for (size_t x = 0; x < kSide; ++x) {
                    ASSERT_LE(held[y][x], 1) << "overlap, round " << round;
                    ASSERT_TRUE(held[y][x] == 1 || !wanted[y][x]) << "hole, round " << round;
                }
        }
    }
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
