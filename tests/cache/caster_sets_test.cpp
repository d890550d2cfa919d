// Static and active sets: rest, cap, order.
#include "cache/caster_sets.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace {

using Ids = std::vector<world::CasterId>;

TEST(CasterSets, ACasterIsActiveAtOnceAndStaticAfterItsRest) {
    cache::CasterSets sets(10, 16);
    sets.moved(4, 0.0);
    EXPECT_EQ(sets.active(), Ids{4});
    EXPECT_TRUE(sets.promote(9.9).empty());
    sets.moved(4, 9.95);  // moves again: the rest starts over
    EXPECT_TRUE(sets.promote(19.9).empty());
    EXPECT_EQ(sets.promote(19.95), Ids{4});
    EXPECT_TRUE(sets.active().empty());
}

TEST(CasterSets, AHundredThatStopTogetherAreSpreadOverFrames) {
    cache::CasterSets sets(1, 16);
    for (world::CasterId id = 100; id-- > 0;) sets.moved(id, 0.0);
    size_t frames = 0, seen = 0;
    while (!sets.active().empty()) {
        const Ids promoted = sets.promote(2.0);
        ASSERT_LE(promoted.size(), 16u);
        ASSERT_TRUE(std::is_sorted(promoted.begin(), promoted.end()));
        seen += promoted.size();
        ++frames;
    }
    EXPECT_EQ(frames, 7u);
    EXPECT_EQ(seen, 100u);
}

TEST(CasterSets, TheLongestRestGoesFirst) {
    cache::CasterSets sets(1, 1);
    sets.moved(1, 3.0);
    sets.moved(2, 1.0);
    sets.moved(3, 2.0);
    EXPECT_EQ(sets.promote(10), Ids{2});
    EXPECT_EQ(sets.promote(10), Ids{3});
    EXPECT_EQ(sets.promote(10), Ids{1});
}

}  // namespace
