// The range of depths: long enough, fine enough, and in place before a receiver leaves it.
#include "cache/depth_range.h"

#include <gtest/gtest.h>

#include <random>

namespace {

using cache::DepthAnchor;
using cache::DepthRange;

constexpr double kD16 = 65534, kD32 = 1 << 24;

TEST(DepthRange, LiesOnAShortSceneForGood) {
    const DepthRange scene{-120, 300};
    for (const double steps : {kD16, kD32}) {
        const DepthAnchor anchor({20, 0.04}, scene, steps);
        for (double z : {-1e6, -120.0, 0.0, 100.0, 1e6}) {
            EXPECT_EQ(anchor.at(z), scene);
            EXPECT_TRUE(anchor.holds(scene, z));
            EXPECT_FALSE(anchor.wearsOut(scene, z));
        }
    }
}

TEST(DepthRange, UnitsStayBelowAnEighthOfATexel) {
    const DepthRange scene{0, 1e6};
    for (const culling::Cascade cascade : {culling::Cascade{22, 0.044}, {67, 0.13}, {200, 0.4}, {600, 1.2}})
        for (const double steps : {kD16, kD32})
            EXPECT_LE(DepthAnchor(cascade, scene, steps).at(5e5).length / steps, cascade.texel / 8 * (1 + 1e-12));
}

TEST(DepthRange, HoldsAllReceiversWhereverTheEyeGoes) {
    std::mt19937 rng(3);
    const DepthRange scene{-40000, 90000};
    for (const culling::Cascade cascade : {culling::Cascade{22, 0.044}, {600, 1.2}, {300, 0.01}}) {
        const DepthAnchor anchor(cascade, scene, kD16);
        std::uniform_real_distribution<double> stride(-cascade.split, cascade.split);
        double z = 0;
        DepthRange range = anchor.at(z);
        int worn = 0;
        for (int step = 0; step < 30000; ++step) {
            z = std::clamp(z + stride(rng), scene.near - 100, scene.far() + 100);
            if (anchor.wearsOut(range, z)) {
                ASSERT_NE(anchor.at(z), range);
                range = anchor.at(z);
                ++worn;
                ASSERT_FALSE(anchor.wearsOut(range, z)) << "the next one would wear out at once, step " << step;
            }
            ASSERT_TRUE(anchor.holds(range, z)) << "step " << step;
            ASSERT_GE(range.near, scene.near);
            ASSERT_LE(range.far(), scene.far() + 1e-9);  // a rounding of the sum
        }
        EXPECT_GT(worn, 0);
    }
}

}  // namespace
