// Cascades: nested, each serving its split whole, and errors that name the number.
#include "culling/cascades.h"

#include <gtest/gtest.h>

#include <cmath>

namespace {

TEST(Cascades, EachWindowHoldsItsSplitWhereverItSnaps) {
    const auto cascades = culling::makeCascades(4, 1024, 600, 3);
    ASSERT_TRUE(cascades);
    ASSERT_EQ(cascades.value().size(), 4u);
    EXPECT_DOUBLE_EQ(cascades.value().back().split, 600);
    for (size_t c = 0; c < 4; ++c) {
        const culling::Cascade& k = cascades.value()[c];
        // A snapped window is off its centre by half a texel at most.
        EXPECT_GE((1024 / 2 - 0.5) * k.texel, k.split);
        if (c > 0) {
            EXPECT_NEAR(k.split / cascades.value()[c - 1].split, 3, 1e-12);
        }
    }
}

TEST(Cascades, AGuardBandLeavesRoomForItsSteps) {
    for (const int guard : {2, 7, 64}) {
        const auto cascades = culling::makeCascades(3, 512, 100, 2, guard);
        for (const culling::Cascade& k : cascades.value())
            EXPECT_GE((512 / 2 - 0.5 - guard / 2) * k.texel, k.split);
    }
    EXPECT_FALSE(culling::makeCascades(3, 512, 100, 2, 0));
    EXPECT_FALSE(culling::makeCascades(3, 512, 100, 2, 129));
}

TEST(Cascades, RefusesNumbersThatMakeNoSense) {
    const double nan = std::nan("");
    for (const auto& bad : {culling::makeCascades(0, 1024, 600, 3), culling::makeCascades(9, 1024, 600, 3),
                            culling::makeCascades(4, 63, 600, 3), culling::makeCascades(4, 1024, nan, 3),
                            culling::makeCascades(4, 1024, -1, 3), culling::makeCascades(4, 1024, 600, 1)}) {
        ASSERT_FALSE(bad);
        EXPECT_EQ(bad.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(bad.error().what.find("give"), std::string::npos);
    }
}

}  // namespace
