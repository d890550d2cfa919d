// tests/tools/replay_test.cpp — which poses a replay plays, and where a moved object stands.
#include "tools/replay.h"

#include <gtest/gtest.h>

#include <glm/gtc/quaternion.hpp>
#include <random>

#include "tools/mover_feed.h"

namespace {

using tools::FrameRange;
using world::Pose;

std::vector<Pose> path(size_t count, double step, double firstTime = 100) {
    std::vector<Pose> poses(count);
    for (size_t k = 0; k < count; ++k) {
        poses[k].time = firstTime + double(k) * step;
        poses[k].position = {double(k), 0, 0};
    }
    return poses;
}

TEST(ReplayPoses, AreThePathsOwnByDefault) {
    const std::vector<Pose> whole = path(10, 0.1);
    EXPECT_EQ(tools::replayPoses(whole, 0, {}).value().size(), 10u);
    const auto cut = tools::replayPoses(whole, 0, FrameRange{3, 5});
    ASSERT_TRUE(cut);
    ASSERT_EQ(cut.value().size(), 2u);
    EXPECT_EQ(cut.value()[0].position.x, 3);
    EXPECT_EQ(cut.value()[1].time, whole[4].time);
}

TEST(ReplayPoses, ResampleFromFirstToLast) {
    // 9 steps of 0.1 s: at 30 frames a second, 27 intervals and both ends.
    const auto poses = tools::replayPoses(path(10, 0.1), 30, {});
    ASSERT_TRUE(poses);
    ASSERT_EQ(poses.value().size(), 28u);
    for (size_t k = 0; k < 28; ++k) {
        EXPECT_DOUBLE_EQ(poses.value()[k].time, 100 + double(k) / 30);
        // A tenth of a metre in 1/300 s; times near 100 s carry 1e-14 s of rounding.
        EXPECT_NEAR(poses.value()[k].position.x, double(k) / 3, 1e-9);
    }
    EXPECT_EQ(tools::replayPoses(path(1, 1), 30, {}).value().size(), 1u);
    const auto cut = tools::replayPoses(path(10, 0.1), 30, FrameRange{27, 28});
    EXPECT_NEAR(cut.value()[0].position.x, 9, 1e-9);
}

TEST(ReplayPoses, RefuseRangesAndRatesThatMakeNoSense) {
    for (const auto& [fps, range] : std::vector<std::pair<double, FrameRange>>{{0, {0, 11}},
                                                                               {0, {11, 12}},
                                                                               {30, {0, 29}},
                                                                               {-1, {0, 1}},
                                                                               {std::nan(""), {0, 1}},
                                                                               {1e300, {0, 1}}}) {
        const auto poses = tools::replayPoses(path(10, 0.1), fps, range);
        ASSERT_FALSE(poses) << fps << " " << range.end;
        EXPECT_EQ(poses.error().code, world::ErrorCode::kUsage);
    }
    EXPECT_NE(tools::replayPoses(path(10, 0.1), 0, FrameRange{0, 11}).error().what.find("10 frames"),
              std::string::npos);
}

TEST(RequirePathInWorld, TakesAPathThatComesNearOnce) {
    const world::Box bounds{{-10, 0, -10}, {10, 5, 10}};
    std::vector<Pose> poses = path(3, 1);
    for (Pose& pose : poses) pose.position = {5000, 0, 0};
    const auto far = tools::requirePathInWorld(poses, bounds, 600);
    ASSERT_FALSE(far);
    EXPECT_EQ(far.error().code, world::ErrorCode::kUsage);
    EXPECT_NE(far.error().what.find("5000"), std::string::npos);
    EXPECT_NE(far.error().what.find("-10 to 10"), std::string::npos);
    poses[1].position = {610, 9999, -610};  // height does not matter
    EXPECT_TRUE(tools::requirePathInWorld(poses, bounds, 600));
    EXPECT_FALSE(tools::requirePathInWorld(poses, bounds, 599));
}

TEST(SamplingStep, GivesAboutSixtyFrames) {
    EXPECT_EQ(tools::samplingStep(1), 1u);
    EXPECT_EQ(tools::samplingStep(59), 1u);
    EXPECT_EQ(tools::samplingStep(1980), 33u);
}

class Moved : public testing::Test {
protected:
    std::mt19937 rng_{11};
    std::uniform_real_distribution<double> unit_{-1, 1};
    glm::dquat turn() {
        return glm::normalize(glm::dquat(unit_(rng_), unit_(rng_), unit_(rng_), unit_(rng_)));
    }

    static world::Placement place(const glm::dquat& q, glm::dvec3 factors, glm::dvec3 at) {
        const glm::dmat3 r = glm::mat3_cast(q);
        return {glm::mat3(r[0] * factors.x, r[1] * factors.y, r[2] * factors.z), at};
    }
    static double apart(const world::Placement& a, const world::Placement& b) {
        double worst = glm::length(a.translation - b.translation);
        for (int k = 0; k < 3; ++k) worst = std::max(worst, double(glm::length(a.linear[k] - b.linear[k])));
        return worst;
    }
};

TEST_F(Moved, KeepsTheRatiosOfTheRestPlacement) {
    for (int round = 0; round < 200; ++round) {
        const glm::dvec3 factors = glm::exp(glm::dvec3(unit_(rng_), unit_(rng_), unit_(rng_)));
        const double mean = std::cbrt(factors.x * factors.y * factors.z);
        const glm::dvec3 at(1e6 + unit_(rng_), unit_(rng_), unit_(rng_));
        const glm::dquat q = turn(), q2 = turn();
        const world::Placement rest = place(q, factors, at);
        // Factors come out of a float matrix: seven digits of values below 3.
        EXPECT_LT(apart(world::moved(rest, {0, at, q, mean}), rest), 3e-6) << round;
        const glm::dvec3 elsewhere = at + glm::dvec3(3, 2, 1);
        EXPECT_LT(
            apart(world::moved(rest, {1, elsewhere, q2, 2 * mean}), place(q2, 2.0 * factors, elsewhere)),
            6e-6);
    }
}

TEST_F(Moved, KeepsAMirrorAndAFlatShape) {
    const world::Placement mirrored = place(turn(), {-2, 2, 2}, {});
    EXPECT_LT(glm::determinant(world::moved(mirrored, {0, {}, turn(), 2}).linear), 0);
    const world::Placement flat = place(turn(), {1, 0, 3}, {});
    const world::Placement still = world::moved(flat, {0, {}, glm::dquat(1, 0, 0, 0), 5});
    EXPECT_LT(apart(still, place(glm::dquat(1, 0, 0, 0), {1, 0, 3}, {})), 1e-6);
}

}  // namespace
