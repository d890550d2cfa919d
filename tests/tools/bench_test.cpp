// tests/tools/bench_test.cpp — a benchmark's motions move as they say, and its counters count: nothing here
// is timed.
#include <gtest/gtest.h>

#include <glm/gtc/constants.hpp>
#include <random>

#include "tests/server/worlds.h"
#include "tools/bench_culling.h"
#include "tools/bench_motion.h"
#include "tools/bench_occlusion.h"
#include "tools/bench_report.h"
#include "tools/bench_run.h"
#include "tools/bench_sizes.h"
#include "tools/summary.h"

namespace {

using tools::Motion;
using tools::MotionCost;
using world::Pose;

/// Poses at 30 a second, `stride` metres apart along x from `x`.
void go(std::vector<Pose>& path, size_t poses, double stride, double x) {
    for (size_t k = 0; k < poses; ++k)
        path.push_back({double(path.size()) / 30, {x + double(k) * stride, 0, 0}, {1, 0, 0, 0}});
}

TEST(Travelled, IsTheLongestDriveBetweenStandsWalksAndJumps) {
    std::vector<Pose> path;
    go(path, 300, 0.05, 0);     // 1.5 m/s
    go(path, 30, 0.5, 15);      // 15 m/s for a second
    go(path, 100, 0, 29.5);     // a stand
    go(path, 60, 0.5, 29.5);    // 15 m/s for two seconds, after a stand: the longest
    go(path, 300, 0.05, 5000);  // a jump, and longer on foot
    const auto track = tools::travelled(path);
    ASSERT_TRUE(track);
    EXPECT_EQ(track.value().size(), 60u);
    EXPECT_EQ(track.value().front().position.x, 29.5);
    EXPECT_EQ(track.value().back().position.x, 29.5 + 59 * 0.5);
}

TEST(Travelled, IsOnFootWhereNothingDrives) {
    std::vector<Pose> path;
    go(path, 100, 0.05, 0);
    go(path, 200, 0.05, 900);
    const auto track = tools::travelled(path);
    ASSERT_TRUE(track);
    EXPECT_EQ(track.value().size(), 200u);
    EXPECT_EQ(track.value().front().position.x, 900);
}

TEST(Travelled, RefusesAPathThatStays) {
    std::vector<Pose> path;
    for (const size_t poses : {1u, 50u}) {
        path.clear();
        go(path, poses, 0, 3);
        const auto track = tools::travelled(path);
        ASSERT_FALSE(track);
        EXPECT_EQ(track.error().code, world::ErrorCode::kUsage);
    }
}

TEST(Follow, KeepsItsSpeedOverPosesOfAnySpacing) {
    std::mt19937 rng(5);
    std::vector<Pose> track{{0, {7, 1, 2}, {1, 0, 0, 0}}};
    for (int k = 1; k < 200; ++k) {
        Pose next = track.back();
        next.time += 0.1;
        if (rng() % 4) next.position.x += double(rng() % 1000) / 300;  // some poses stand
        track.push_back(next);
    }
    for (const double speed : {1.5, 15.0, 90.0}) {
        const std::vector<Pose> poses = tools::follow(track, speed, 1'000'000);
        const double length = track.back().position.x - track.front().position.x;
        // One for the start; the last is at most a stride before the end. 1e-9: sums of 200 steps.
        EXPECT_EQ(poses.size(), size_t(std::floor(length / (speed / 30) + 1e-9)) + 1);
        for (size_t k = 0; k < poses.size(); ++k) {
            ASSERT_NEAR(poses[k].position.x, 7 + double(k) * speed / 30, 1e-9) << k;
            ASSERT_DOUBLE_EQ(poses[k].time, double(k) / 30);
        }
    }
    EXPECT_EQ(tools::follow(track, 15, 4).size(), 4u);
}

TEST(BenchMotions, WalkDriveTurnAndStand) {
    std::vector<Pose> track;
    go(track, 2000, 0.5, 0);
    const std::vector<Motion> motions = tools::benchMotions(track, 10'000);
    ASSERT_EQ(motions.size(), 5u);
    EXPECT_EQ(motions[0].poses.size(), 300u);
    EXPECT_NEAR(motions[0].poses.back().position.x, 299 * 0.05, 1e-9);
    EXPECT_EQ(motions[1].poses.size(), 900u);
    EXPECT_NEAR(motions[1].poses.back().position.x, 899 * 0.5, 1e-9);
    ASSERT_EQ(motions[2].poses.size(), 180u);
    for (size_t k = 1; k < 180; ++k) {
        ASSERT_EQ(motions[2].poses[k].position, track.front().position);
        const glm::dquat step =
            glm::inverse(motions[2].poses[k - 1].orientation) * motions[2].poses[k].orientation;
        ASSERT_NEAR(glm::degrees(glm::angle(step)), 7, 1e-6) << k;  // 210 degrees in 30 frames
    }
    for (const size_t still : {3u, 4u})
        for (const Pose& pose : motions[still].poses) ASSERT_EQ(pose.position, track.front().position);
    EXPECT_EQ(motions[3].movers, 0u);
    EXPECT_EQ(motions[4].movers, 200u);
    for (const Motion& motion : tools::benchMotions(track, 7)) EXPECT_EQ(motion.poses.size(), 7u);
}

TEST(Movers, CircleAroundTheEye) {
    const glm::dvec3 eye(10, 20, 30);
    for (uint32_t mover = 0; mover < 200; ++mover) {
        double moved = 0;
        for (int frame = 0; frame <= 30; ++frame) {
            const world::Placement at = tools::moverAt(mover, eye, frame / 30.0);
            const double far = glm::length(glm::dvec2(at.translation.x - eye.x, at.translation.z - eye.z));
            ASSERT_GE(far, 6 - 4 - 1e-9);
            ASSERT_LE(far, 60 + 4 + 1e-9);
            ASSERT_DOUBLE_EQ(at.translation.y, 20 - 1.7);
            if (frame == 30) continue;
            const glm::dvec3 step =
                tools::moverAt(mover, eye, (frame + 1) / 30.0).translation - at.translation;
            moved += glm::length(step);
            // It looks where it goes; a chord of 1/24 radian is off by half of that.
            EXPECT_GT(glm::dot(glm::normalize(step), -glm::dvec3(at.linear[2])), std::cos(0.03));
        }
        ASSERT_NEAR(moved, 5, 0.01);  // chords, not arcs
    }
}

/// Each way of drawing does what it is there for, by its counters.
TEST(BenchRun, CountsWhatEachWayDraws) {
    const world::WorldStore store = tests::baked(tests::streets(glm::dvec3(0)), "bench.world");
    tools::BenchConfig config;
    config.shadows.cascades = 2;
    config.shadows.side = 256;
    config.shadows.farDistance = 45;
    config.redraws = 3;
    auto run = tools::BenchRun::create(tests::validatedDevice(), store, config);
    ASSERT_TRUE(run) << run.error().what;
    std::vector<Pose> track;
    go(track, 40, 0.5, -8);
    for (Pose& pose : track) pose.position.y = 2;
    for (const Motion& motion : tools::benchMotions(track, 12)) {
        const auto played = run.value()->play(motion);
        ASSERT_TRUE(played) << motion.name << ": " << played.error().what;
        const MotionCost& cost = played.value();
        EXPECT_EQ(cost.frames(), 12u);
        EXPECT_EQ(cost.whole.size(), 12u);
        EXPECT_EQ(cost.floor.size(), 12u);
        EXPECT_EQ(cost.redraw.size(), 3u);
        EXPECT_GT(cost.redrawn.triangles, 0u);
        // Two maps, drawn and restored whole.
        EXPECT_GE(cost.redrawn.texels, 3u * 2 * 2 * 256 * 256);
        EXPECT_LT(cost.drawn.triangles / 12, cost.redrawn.triangles / 3) << motion.name;
        if (motion.name == "turning" || motion.name == "standing") {
            EXPECT_EQ(cost.submissions, 0u) << motion.name;
            EXPECT_EQ(cost.drawn.texels, 0u);
            EXPECT_EQ(tools::quantile(cost.floor, 1), 0);
        } else {
            EXPECT_GT(cost.submissions, 0u) << motion.name;
            EXPECT_GT(cost.drawn.triangles, 0u);
            EXPECT_GT(tools::quantile(cost.floor, 1), 0);
        }
        if (motion.movers > 0) {
            EXPECT_EQ(cost.submissions, 12u);
        }
    }
    tests::expectSilence();
}

TEST(BenchCulling, CountsTheSameEveryTime) {
    const world::WorldStore store = tests::baked(tests::streets(glm::dvec3(0)), "culling.world");
    std::vector<Pose> track;
    go(track, 40, 0.5, -8);
    const std::vector<Motion> motions = tools::benchMotions(track, 12);
    const auto once = tools::benchCulling(store, motions, 1), again = tools::benchCulling(store, motions, 2);
    ASSERT_TRUE(once) << once.error().what;
    ASSERT_TRUE(again) << again.error().what;
    EXPECT_EQ(once.value().chunks, store.chunks().size());
    EXPECT_GT(once.value().clusters, once.value().casters);
    ASSERT_EQ(once.value().costs.size(), motions.size());
    for (size_t m = 0; m < motions.size(); ++m) {
        const tools::CullingCost &a = once.value().costs[m], &b = again.value().costs[m];
        EXPECT_EQ(a.motion, motions[m].name);
        EXPECT_EQ(a.planHash, b.planHash) << a.motion;
        ASSERT_EQ(a.stages.size(), b.stages.size());
        const bool still = motions[m].name != "walking" && motions[m].name != "driving";
        ASSERT_EQ(a.stages.size(), still ? 2u : 5u) << a.motion;  // nothing is exposed, nothing asked
        for (size_t k = 0; k < a.stages.size(); ++k) {
            EXPECT_EQ(a.stages[k].queries, b.stages[k].queries);
            EXPECT_EQ(a.stages[k].castersFound, b.stages[k].castersFound);
            EXPECT_EQ(a.stages[k].clustersFound, b.stages[k].clustersFound);
        }
        if (still) continue;
        EXPECT_GT(a.stages[1].castersFound, 0u);
        EXPECT_EQ(a.stages[1].castersTested, a.stages[0].castersFound);
        EXPECT_GE(a.stages[0].castersFound, a.stages[1].castersFound);  // world boxes are wider than light-space bounds
        EXPECT_GT(a.stages[2].clustersFound, 0u);
        EXPECT_GE(a.stages[2].clustersTested, a.stages[2].clustersFound);
        EXPECT_EQ(a.stages[3].castersFound, a.stages[2].castersFound);  // the plan draws what its parts find
    }
}

TEST(MotionGoals, TakeTheBoundsAsMet) {
    MotionCost driving, standing;
    driving.name = "driving";
    driving.update = {2};
    driving.whole = {3};
    driving.floor = {2};
    driving.redraw = {100};
    standing.name = "standing";
    standing.update = standing.floor = {0};
    standing.whole = {0.05};
    standing.redraw = {100};
    const auto met = [&] {
        std::vector<bool> all;
        for (const tools::Goal& goal : tools::motionGoals({driving, standing}, 1'000'000))
            all.push_back(goal.met);
        return all;
    };
    EXPECT_EQ(met(), (std::vector<bool>{true, true, true}));
    driving.update = {2.1};
    driving.whole = {3.1};
    standing.submissions = 1;
    EXPECT_EQ(met(), (std::vector<bool>{false, false, false}));
}

TEST(SearchCosts, CountWhatACascadeAsks) {
    const world::WorldStore store = tests::baked(tests::streets(glm::dvec3(0)), "search.world");
    const auto costs = tools::measureSearch(store, glm::dvec3(0, 1.7, 0), {});
    ASSERT_TRUE(costs);
    ASSERT_EQ(costs.value().size(), 4u);
    uint64_t certificates = 0;
    for (const tools::SearchCost& cost : costs.value()) {
        EXPECT_GE(cost.counts.rays, 9 * cost.counts.clustersTested) << "a texel and its neighbours at least";
        EXPECT_GE(cost.triangles, cost.casters);
        EXPECT_EQ(cost.bare.size(), cost.search.size());
        certificates += cost.counts.certificates;
    }
    EXPECT_GT(costs.value().back().counts.rays, 1000u);
    EXPECT_GT(certificates, 0u);
}

TEST(SearchGoal, TakesItsBoundAsMet) {
    tools::SearchCost fine, coarse;
    fine.counts.rays = 1000;
    coarse.counts.rays = 3000;
    fine.bare = {1, 1, 50};  // medians count
    coarse.bare = {3, 3, 3};
    fine.search = {2, 2, 2};
    coarse.search = {3, 3, 3};
    EXPECT_TRUE(tools::searchGoal({fine, coarse}).met) << "4 ms of bare Embree in 5 ms";
    coarse.search = {3.1, 3.1, 3.1};
    EXPECT_FALSE(tools::searchGoal({fine, coarse}).met);
}

TEST(Sizes, AreWholeCountsOfInstances) {
    EXPECT_EQ(tools::parseSizes("1e4,100000,1e6").value(),
              (std::vector<uint32_t>{10'000, 100'000, 1'000'000}));
    for (const char* bad : {"", ",", "1e4,", "x", "1e4x", "0", "-5", "1.5", "1e8", "nan", "1e4,,1e5"}) {
        const auto sizes = tools::parseSizes(bad);
        ASSERT_FALSE(sizes) << bad;
        EXPECT_EQ(sizes.error().code, world::ErrorCode::kUsage);
        EXPECT_NE(sizes.error().what.find("--sizes"), std::string::npos);
    }
}

TEST(Sizes, KeepTheDensity) {
    const world::ProceduralOptions usual;
    for (const uint32_t instances : {10'000u, 50'000u, 1'000'000u, 10'000'000u}) {
        const world::ProceduralOptions options = tools::sizedWorld(instances);
        EXPECT_NEAR(instances / (options.size * options.size), usual.instances / (usual.size * usual.size),
                    1e-12);
    }
    EXPECT_EQ(tools::sizedWorld(100).size, 1024);
}

TEST(Sizes, DriveOverTheSameGround) {
    const std::vector<Pose> small = tools::middleTrack(tools::sizedWorld(10'000)),
                            large = tools::middleTrack(tools::sizedWorld(1'000'000));
    ASSERT_EQ(small.size(), large.size());
    for (size_t k = 0; k < small.size(); ++k) EXPECT_EQ(small[k].position, large[k].position) << k;
    EXPECT_GE(tools::follow(small, 15, 10'000).size(), 601u);  // and what goes uphill
}

}  // namespace
