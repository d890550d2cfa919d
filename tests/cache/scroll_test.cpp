// Scrolling: slabs are exactly what a moved window shows anew.
#include "cache/scroll.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "cache/lattice.h"

namespace {

using cache::Lattice;
using cache::Texel;
using cache::TexelRect;

/// Each slot remembers which texel was drawn into it last.
class FakeMap {
public:
    explicit FakeMap(const Lattice& lattice)
        : lattice_(lattice), held_(size_t(lattice.side * lattice.side), Texel(INT64_MIN)) {}
    void draw(const TexelRect& r) {
        for (int64_t y = r.min.y; y < r.max.y; ++y)
            for (int64_t x = r.min.x; x < r.max.x; ++x) at({x, y}) = {x, y};
    }
    bool holdsExactly(const TexelRect& r) {
        for (int64_t y = r.min.y; y < r.max.y; ++y)
            for (int64_t x = r.min.x; x < r.max.x; ++x)
                if (at({x, y}) != Texel(x, y)) return false;
        return true;
    }

private:
    Texel& at(Texel t) {
        const Texel slot = lattice_.slot(t);
        return held_[size_t(slot.y * lattice_.side + slot.x)];
    }
    Lattice lattice_;
    std::vector<Texel> held_;
};

TEST(Scroll, LeavesTheMapAsIfRedrawn) {
    std::mt19937 rng(7);
    std::uniform_real_distribution<double> stride(-40, 40);  // beyond the 16 m window: jumps too
    const Lattice lattice{.texel = 0.25, .side = 64};
    FakeMap map(lattice);
    glm::dvec2 camera(0);
    Texel window = lattice.windowAt(camera);
    map.draw(lattice.window(window));
    for (int step = 0; step < 1000; ++step) {
        camera += glm::dvec2(stride(rng), stride(rng)) * (step % 7 ? 0.1 : 1.0);
        const Texel next = lattice.windowAt(camera);
        int64_t drawn = 0;
        for (const TexelRect& slab : cache::exposedSlabs(window, next, lattice.side)) {
            map.draw(slab);
            drawn += slab.area();
        }
        const int64_t kept = intersection(lattice.window(window), lattice.window(next)).area();
        ASSERT_EQ(drawn, lattice.side * lattice.side - kept) << "step " << step;
        window = next;
        ASSERT_TRUE(map.holdsExactly(lattice.window(window))) << "step " << step;
    }
}

TEST(Scroll, AMoveOfTheWidthIsAJumpAndOneLessIsNot) {
    for (int64_t far : {int64_t(0), int64_t(1) << 40}) {
        const Texel from(far, -far);
        EXPECT_FALSE(cache::isJump(from, from, 8));
        EXPECT_FALSE(cache::isJump(from, from + Texel(7, -7), 8));
        EXPECT_TRUE(cache::isJump(from, from + Texel(8, 0), 8));
        EXPECT_TRUE(cache::isJump(from, from - Texel(0, 8), 8));
        EXPECT_EQ(cache::exposedSlabs(from, from, 8).count, 0);
        const cache::Slabs all = cache::exposedSlabs(from, from + Texel(100, 3), 8);
        ASSERT_EQ(all.count, 1);
        EXPECT_EQ(all.rect[0].area(), 64);
    }
}

}  // namespace
