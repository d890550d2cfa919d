// Lattice: the same texel for the same place, at any distance from the origin and on both sides of it.
#include "cache/lattice.h"

#include <gtest/gtest.h>

#include <random>

#include "cache/plan_writer.h"

namespace {

using cache::Lattice;
using cache::Texel;
using cache::TexelRect;

TEST(Lattice, SlotsWrapAndQuadrantsCountTheTurns) {
    const Lattice lattice{.texel = 0.5, .side = 64};
    for (int64_t i : {-129, -128, -65, -64, -1, 0, 1, 63, 64, 127, 128}) {
        const Texel t(i, -i), slot = lattice.slot(t);
        EXPECT_GE(slot.x, 0);
        EXPECT_LT(slot.x, 64);
        EXPECT_GE(slot.y, 0);
        EXPECT_LT(slot.y, 64);
        EXPECT_EQ(lattice.quadrant(t) * int64_t(64) + slot, t);
    }
}

TEST(Lattice, WindowHoldsItsCentreFarFromTheOrigin) {
    const Lattice lattice{.texel = 0.04, .side = 1024};
    for (double at : {0.0, -17.3, 1e6, -1e6, 1e7}) {
        const TexelRect w = lattice.window(lattice.windowAt({at, -at}));
        const glm::dvec2 middle = (glm::dvec2(w.min) + glm::dvec2(w.max)) * 0.5 * lattice.texel;
        // Half a texel of snap; doubles are good to 2e-9 m at 1e7 m.
        EXPECT_NEAR(middle.x, at, 0.5 * lattice.texel + 1e-8);
        EXPECT_NEAR(middle.y, -at, 0.5 * lattice.texel + 1e-8);
    }
}

TEST(Lattice, SplitAtWrapCoversTheRectangleOnceAndStaysInOneQuadrant) {
    std::mt19937 rng(3);
    const Lattice lattice{.texel = 1, .side = 16};
    std::uniform_int_distribution<int64_t> corner(-100, 100), edge(0, 16);
    for (int step = 0; step < 2000; ++step) {
        const Texel min(corner(rng), corner(rng));
        const TexelRect rect{min, min + Texel(edge(rng), edge(rng))};
        std::vector<cache::Piece> pieces;
        cache::splitAtWrap(lattice, rect, pieces);
        ASSERT_LE(pieces.size(), 4u);
        int64_t area = 0;
        for (const cache::Piece& p : pieces) {
            area += p.rect.area();
            ASSERT_TRUE(rect.contains(p.rect)) << "step " << step;
            for (const Texel& t : {p.rect.min, p.rect.max - int64_t(1)}) {
                ASSERT_EQ(lattice.quadrant(t), p.quadrant) << "step " << step;
                ASSERT_EQ(Texel(p.store.min) + (t - p.rect.min), lattice.slot(t)) << "step " << step;
            }
        }
        ASSERT_EQ(area, rect.area()) << "step " << step;
    }
}

}  // namespace
