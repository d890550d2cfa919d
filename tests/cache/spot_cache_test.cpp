// What one light decides: when its static map is redrawn and why, when its working map is, and when nothing is.
#include "cache/spot_cache.h"

#include <gtest/gtest.h>

#include "tests/toy_scene.h"

namespace {

using cache::Cause;
using cache::Cost;
using cache::Sabotage;
using cache::SpotCache;
using cache::SpotStatistics;

/// A lamp 10 m above a sheet of ground, boxes in its cone and beside it.
class SpotCaches : public testing::Test {
protected:
    tests::ToyScene scene{glm::dvec3(0, -1, 0), {{10, 0.1}}};
    world::MeshSlot box = scene.addMesh(tests::boxMesh({1, 1, 1}));
    world::MeshSlot sheet = scene.addMesh(tests::sheetMesh(200, 40));
    world::CasterId ground = scene.addStatic(sheet, tests::placedAt({0, 0, 0}));
    world::CasterId inside = scene.addStatic(box, tests::placedAt({1, 1, 1}));
    world::CasterId outside = scene.addStatic(box, tests::placedAt({30, 1, 1}));
    culling::SpotLight lamp{{0, 10, 0}, {0, -1, 0}, 0.7, 0.1, 30, 64};
    std::vector<cache::Departure> departures;
    std::vector<cache::Arrival> arrivals;
    std::vector<world::Box> dirt;
    cache::FramePlan plan;
    cache::GeometryOf geometry = [this](world::CasterId id, size_t level) -> world::Result<cache::GeometryId> {
        return scene.table.mesh(scene.table[id].mesh).geometry[level];
    };

    SpotCache make(Sabotage sabotage = Sabotage::kNone) const {
        return SpotCache(culling::makeSpotSpace(lamp).value(), sabotage);
    }
    SpotStatistics advance(SpotCache& cache) {
        plan.reset(1);
        SpotStatistics statistics;
        EXPECT_TRUE(cache.plan(scene.view(), {departures, arrivals, dirt}, geometry, 0, plan, statistics));
        departures.clear();
        arrivals.clear();
        dirt.clear();
        return statistics;
    }
    world::Box boundsOf(world::CasterId id) const { return scene.table[id].bounds; }
};

TEST_F(SpotCaches, FirstDrawsWhatIsInTheConeAndThenNothing) {
    SpotCache cache = make();
    EXPECT_FALSE(cache.drawn());
    const SpotStatistics first = advance(cache);
    EXPECT_TRUE(cache.drawn());
    EXPECT_EQ(first.cause, Cause::kStart);
    EXPECT_EQ(first.statics.texels, 64u * 64);
    EXPECT_EQ(first.statics.casters, 2u);
    EXPECT_GE(first.statics.triangles, 12u + 2u);
    EXPECT_LT(first.statics.triangles, 12u + 3200u) << "clusters of the ground beside the cone";
    EXPECT_EQ(first.active.texels, 64u * 64);
    EXPECT_EQ(first.active.triangles, 0u);
    EXPECT_EQ(plan.cascades[0].staticPasses.size(), 1u);
    EXPECT_EQ(plan.cascades[0].activePasses.size(), 0u);
    const SpotStatistics rest = advance(cache);
    EXPECT_TRUE(plan.idle());
    EXPECT_EQ(rest.statics, Cost{});
    EXPECT_EQ(rest.active, Cost{});
}

TEST_F(SpotCaches, OnlyWhatTouchesTheConeCountsAndTheFirstCauseNamesIt) {
    SpotCache cache = make();
    advance(cache);
    departures = {{boundsOf(outside), Cause::kDeparture}};
    arrivals = {{outside, Cause::kArrival}};
    arrivals.push_back({inside, Cause::kLevel});  // of the cascades
    dirt = {boundsOf(outside)};
    advance(cache);
    EXPECT_TRUE(plan.idle());

    const auto causeOf = [&] {
        const SpotStatistics s = advance(cache);
        EXPECT_GT(s.statics.triangles, 0u);
        EXPECT_EQ(s.active.texels, 64u * 64) << "the working map follows";
        return s.cause;
    };
    arrivals = {{inside, Cause::kPromotion}};
    EXPECT_EQ(causeOf(), Cause::kPromotion);
    arrivals = {{inside, Cause::kArrival}, {ground, Cause::kPromotion}};
    EXPECT_EQ(causeOf(), Cause::kArrival);
    arrivals = {{inside, Cause::kArrival}};
    departures = {{boundsOf(inside), Cause::kDemotion}};
    EXPECT_EQ(causeOf(), Cause::kDemotion);
    departures = {{boundsOf(inside), Cause::kDemotion}, {boundsOf(inside), Cause::kDeparture}};
    EXPECT_EQ(causeOf(), Cause::kDeparture);
    departures = {{boundsOf(inside), Cause::kDeparture}};
    lamp.position.x = 0.5;
    cache.turn(culling::makeSpotSpace(lamp).value());
    EXPECT_EQ(causeOf(), Cause::kStart);
    cache.turn(culling::makeSpotSpace(lamp).value());  // where it is
    advance(cache);
    EXPECT_TRUE(plan.idle());
    cache.forget();
    EXPECT_EQ(causeOf(), Cause::kStart);
}

TEST_F(SpotCaches, WhatIsCommittedStaysUntilThePlanThatTurnsIt) {
    SpotCache cache = make();
    advance(cache);
    const culling::SpotLight before = cache.space().light;
    lamp.direction = {0.3, -1, 0};
    cache.turn(culling::makeSpotSpace(lamp).value());
    EXPECT_EQ(cache.space().light, before);
    advance(cache);
    EXPECT_NE(cache.space().light, before);
}

TEST_F(SpotCaches, ActiveCastersTouchTheWorkingMapAlone) {
    SpotCache cache = make();
    const auto mover = scene.addActive(box, tests::placedAt({-1, 2, 0}));
    const auto far = scene.addActive(box, tests::placedAt({-40, 2, 0}));
    advance(cache);
    const auto active = [&] {
        const SpotStatistics s = advance(cache);
        EXPECT_EQ(s.statics, Cost{});
        EXPECT_TRUE(plan.cascades[0].clears.empty());
        return s.active;
    };
    dirt = {boundsOf(far)};
    EXPECT_EQ(active(), Cost{});
    dirt = {boundsOf(mover)};
    EXPECT_EQ(active(), (Cost{64 * 64, 1, 12, 1}));
    EXPECT_EQ(active(), Cost{}) << "it rests";
    dirt = {boundsOf(mover)};
    scene.table.place(mover, tests::placedAt({-50, 2, 0}));
    EXPECT_EQ(active(), (Cost{64 * 64, 0, 0, 0})) << "it left";
}

TEST_F(SpotCaches, ADefectAndAnErrorAreWhatTheySay) {
    SpotCache deaf = make(Sabotage::kDeafDeparture);
    advance(deaf);
    departures = {{boundsOf(inside), Cause::kDeparture}};
    advance(deaf);
    EXPECT_TRUE(plan.idle());

    SpotCache cache = make();
    geometry = [](world::CasterId, size_t) -> world::Result<cache::GeometryId> {
        return world::Error{world::ErrorCode::kLimit, "full"};
    };
    plan.reset(1);
    SpotStatistics statistics;
    const auto planned = cache.plan(scene.view(), {}, geometry, 0, plan, statistics);
    ASSERT_FALSE(planned);
    EXPECT_EQ(planned.error().what, "full");
}

TEST_F(SpotCaches, ARedrawPlansWhatTheFirstFrameDid) {
    scene.addActive(box, tests::placedAt({-1, 2, 0}));
    SpotCache cache = make();
    advance(cache);
    const uint64_t first = plan.hash();
    advance(cache);
    EXPECT_NE(plan.hash(), first);
    plan.reset(1);
    ASSERT_TRUE(cache.planRedraw(scene.view(), geometry, 0, plan));
    EXPECT_EQ(plan.hash(), first);
}

}  // namespace
