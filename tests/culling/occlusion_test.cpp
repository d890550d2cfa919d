// Certificates: what they hide changes no texel; what they lose comes back.
#include "culling/occlusion.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <limits>
#include <random>

#include "culling/bare_rays.h"
#include "tests/toy_scene.h"

namespace {

using tests::SoftMaps;
using tests::ToyScene;

constexpr int kSide = 96;
const std::vector<culling::Cascade> kTwoCascades{{4.4, 0.1}, {17.6, 0.4}};

constexpr uint64_t kUnlimited = std::numeric_limits<uint64_t>::max();

culling::OcclusionConfig configured(uint32_t rays, bool sticky = false) { return {{rays, 100, kSide}, sticky}; }

/// Sheets and boxes in layers over each other, so that much is hidden, at random angles.
struct Layers {
    explicit Layers(uint32_t seed, glm::dvec3 at = glm::dvec3(0), bool sticky = false)
        : scene(glm::dvec3(0.35, -1, 0.2), kTwoCascades), rng(seed), origin(at) {
        const auto sheet = scene.addMesh(tests::sheetMesh(9, 6));
        const auto box = scene.addMesh(tests::boxMesh({1, 1, 1}));
        const auto small = scene.addMesh(tests::sheetMesh(1.5, 3));
        for (int i = 0; i < 10; ++i) ids.push_back(scene.addStatic(sheet, somewhere(2, 6, 0.2)));
        for (int i = 0; i < 60; ++i) ids.push_back(scene.addStatic(i % 2 ? box : small, somewhere(-6, 5, 3)));
        const glm::dvec3 light = scene.light.space().toLight(origin);
        depthNear = light.z - 50;
        eye = light;
        occlusion = std::make_unique<culling::Occlusion>(scene.table, scene.light, configured(4096, sticky));
    }
    void await() {
        for (int c = 0; c < int(kTwoCascades.size()); ++c) occlusion->await(c, ids);
    }
    culling::CertifyCosts certify() {
        await();
        return occlusion->search(scene.statics, kUnlimited);
    }
    world::Placement somewhere(double low, double high, double tilt) {
        const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(rng); };
        world::Placement p = tests::placedAt(origin + glm::dvec3(uniform(-7, 7), uniform(low, high), uniform(-7, 7)));
        const double a = uniform(-tilt, tilt), b = uniform(-tilt, tilt);
        const glm::mat3 x(1, 0, 0, 0, float(std::cos(a)), float(std::sin(a)), 0, -float(std::sin(a)), float(std::cos(a)));
        const glm::mat3 z(float(std::cos(b)), float(std::sin(b)), 0, -float(std::sin(b)), float(std::cos(b)), 0, 0, 0, 1);
        p.linear = x * z;
        return p;
    }
    cache::ShadowCache makeCache() const { return {kTwoCascades, {.side = kSide, .scene = {depthNear, 100}}}; }

    ToyScene scene;
    std::mt19937 rng;
    glm::dvec3 origin;
    glm::dvec3 eye{0};
    double depthNear = 0;
    std::vector<world::CasterId> ids;
    std::unique_ptr<culling::Occlusion> occlusion;
};

std::vector<SoftMaps::Maps> drawn(const Layers& l, bool hide, uint64_t* hidden = nullptr) {
    cache::ShadowCache cache = l.makeCache();
    cache::FramePlan plan;
    plan.reset(kTwoCascades.size());
    std::vector<cache::CascadeStatistics> statistics;
    cache.plan(l.scene.view(hide ? l.occlusion.get() : nullptr), {}, {.eye = l.eye}, plan, statistics);
    SoftMaps maps(l.scene, kTwoCascades.size(), kSide);
    maps.execute(plan);
    if (hidden)
        for (const auto& s : statistics) *hidden += s.clustersHidden;
    return maps.maps();
}

TEST(Occlusion, WhatIsHiddenChangesNoTexel) {
    uint64_t hidden = 0;
    for (uint32_t seed = 1; seed <= 12; ++seed) {
        Layers l(seed, seed % 2 ? glm::dvec3(0) : glm::dvec3(1e6, 0, -6e6));
        const culling::CertifyCosts costs = l.certify();
        EXPECT_EQ(costs.certificates, l.occlusion->certificates());
        ASSERT_EQ(drawn(l, true, &hidden), drawn(l, false)) << "seed " << seed;
    }
    EXPECT_GT(hidden, 100u) << "hides too little for the test to mean something";
}

TEST(Occlusion, EmbreeFindsNoOpeningOverWhatIsHidden) {
    size_t hidden = 0, open = 0;
    for (uint32_t seed = 1; seed <= 6; ++seed) {
        Layers l(seed, seed % 2 ? glm::dvec3(0) : glm::dvec3(1e6, 0, -6e6));
        l.certify();
        for (int c = 0; c < int(kTwoCascades.size()); ++c) {
            std::vector<culling::Footprint> covered, others;
            for (const culling::Footprint& f : culling::footprints(l.scene.table, l.scene.light, c, l.ids, 4096))
                (l.occlusion->hidden(c, f.caster, f.cluster) ? covered : others).push_back(f);
            for (const auto* footprints : {&covered, &others}) {
                const auto rays = culling::BareRays::create(l.scene.table, l.scene.light, c, l.ids, *footprints);
                ASSERT_TRUE(rays);
                const uint64_t through = rays.value()->rays() - rays.value()->shoot();
                if (footprints == &others) open += through;
                else ASSERT_EQ(through, 0u) << "seed " << seed << " cascade " << c;
            }
            hidden += covered.size();
        }
    }
    EXPECT_GT(hidden, 100u);
    EXPECT_GT(open, 10000u) << "rays that meet everything judge nothing";
}

TEST(Occlusion, ASearchInPiecesKeepsItsShareAndFindsTheSame) {
    Layers whole(3), pieces(3);
    const culling::CertifyCosts all = whole.certify();
    pieces.await();
    culling::CertifyCosts sum;
    for (const uint64_t share : {1, 700, 1, 5000}) {
        const culling::CertifyCosts costs = pieces.occlusion->search(pieces.scene.statics, share);
        EXPECT_GT(costs.rays, 0u);
        EXPECT_LT(costs.rays, share + 4096) << "beyond its share only the cluster that it was at";
        if (share == 1) {
            EXPECT_EQ(costs.clustersTested, 1u);
        }
        sum += costs;
        pieces.await();
    }
    ASSERT_LT(sum.rays, all.rays);
    EXPECT_EQ(drawn(pieces, true), drawn(pieces, false)) << "half a search hides nothing that can be seen";
    sum += pieces.occlusion->search(pieces.scene.statics, kUnlimited);
    EXPECT_EQ(sum.rays, all.rays);
    EXPECT_EQ(sum.clustersTested, all.clustersTested);
    EXPECT_EQ(sum.certificates, all.certificates);
    EXPECT_GT(all.certificates, 0u);
    for (int c = 0; c < int(kTwoCascades.size()); ++c)
        for (world::CasterId id : pieces.ids)
            for (uint32_t k = 0; k < pieces.scene.light.rects(id, c).size(); ++k)
                EXPECT_EQ(pieces.occlusion->hidden(c, id, k), whole.occlusion->hidden(c, id, k));
}

TEST(Occlusion, WhoLeavesWaitsNoMore) {
    Layers l(3);
    const uint64_t all = Layers(3).certify().rays;
    for (int round = 0; round < 3; ++round) {
        l.await();
        EXPECT_EQ(l.occlusion->search(l.scene.statics, 1).clustersTested, 1u) << "the others of its caster have begun";
        l.occlusion->remove(l.ids);
        EXPECT_EQ(l.occlusion->search(l.scene.statics, kUnlimited).rays, 0u);
    }
    EXPECT_EQ(l.certify().rays, all) << "each once, though they had come before";
}

/// Takes the casters away one by one; true while each map equals the one drawn from scratch.
bool survivesDepartures(Layers& l, size_t& revocations) {
    l.certify();
    cache::ShadowCache cache = l.makeCache();
    cache::FramePlan plan;
    plan.reset(kTwoCascades.size());
    std::vector<cache::CascadeStatistics> statistics;
    SoftMaps maps(l.scene, kTwoCascades.size(), kSide);
    cache.plan(l.scene.view(l.occlusion.get()), {}, {.eye = l.eye}, plan, statistics);
    maps.execute(plan);
    std::vector<world::CasterId> left = l.ids;
    while (left.size() > 1) {
        const size_t at = l.rng() % left.size();
        const world::CasterId id = left[at];
        left.erase(left.begin() + std::ptrdiff_t(at));
        revocations += l.occlusion->remove(std::span(&id, 1));
        const std::vector<cache::Departure> departures{{l.scene.light[id].bounds, cache::Cause::kDeparture}};
        l.scene.statics.remove(id);
        plan.reset(kTwoCascades.size());
        cache.plan(l.scene.view(l.occlusion.get()), {departures, {}, {}}, {.eye = l.eye}, plan, statistics);
        maps.execute(plan);
        if (maps.maps() != drawn(l, false)) return false;
    }
    return true;
}

TEST(Occlusion, WhatAFallenCertificateHidComesBack) {
    size_t revocations = 0;
    for (uint32_t seed = 1; seed <= 4; ++seed) {
        Layers l(seed);
        EXPECT_TRUE(survivesDepartures(l, revocations)) << "seed " << seed;
        EXPECT_EQ(l.occlusion->certificates(), 0u) << "one caster is left: nobody can hide it";
    }
    EXPECT_GT(revocations, 20u);
}

TEST(Occlusion, ACertificateThatOutlivesItsOccluderIsSeen) {
    size_t revocations = 0;
    Layers l(1, glm::dvec3(0), true);
    EXPECT_FALSE(survivesDepartures(l, revocations));
}

TEST(Occlusion, IsTheSameForAnyNumberOfThreads) {
    std::vector<std::vector<glm::uvec3>> answers;  // cascade, caster, cluster
    std::vector<uint64_t> rays;
    for (size_t threads : {1, 2, 7}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        Layers l(8);
        rays.push_back(l.certify().rays);
        std::vector<glm::uvec3> hidden;
        for (int c = 0; c < int(kTwoCascades.size()); ++c)
            for (world::CasterId id : l.ids)
                for (uint32_t k = 0; k < l.scene.light.rects(id, c).size(); ++k)
                    if (l.occlusion->hidden(c, id, k)) hidden.push_back({uint32_t(c), id, k});
        answers.push_back(hidden);
    }
    EXPECT_FALSE(answers[0].empty());
    EXPECT_EQ(answers[0], answers[1]);
    EXPECT_EQ(answers[0], answers[2]);
    EXPECT_EQ(rays[0], rays[1]);
    EXPECT_EQ(rays[0], rays[2]);
}

TEST(Occlusion, TwinsInOnePlaceHideNeitherEachOtherNorThemselves) {
    ToyScene scene(glm::dvec3(0, -1, 0), kTwoCascades);
    const auto sheet = scene.addMesh(tests::sheetMesh(2, 4));
    const std::vector<world::CasterId> ids{scene.addStatic(sheet, tests::placedAt(glm::dvec3(0))),
                                           scene.addStatic(sheet, tests::placedAt(glm::dvec3(0)))};
    culling::Occlusion occlusion(scene.table, scene.light, configured(4096));
    occlusion.await(0, ids);
    EXPECT_EQ(occlusion.search(scene.statics, kUnlimited).certificates, 0u);
    occlusion.await(0, ids);
    EXPECT_EQ(occlusion.search(scene.statics, kUnlimited).rays, 0u) << "tried once, not again";
}

TEST(Occlusion, ABudgetTooSmallForAFootprintDrawsIt) {
    ToyScene scene(glm::dvec3(0.3, -1, 0.1), kTwoCascades);
    const auto roof = scene.addMesh(tests::sheetMesh(16, 4));
    const auto box = scene.addMesh(tests::boxMesh({1, 1, 1}));
    const std::vector<world::CasterId> ids{scene.addStatic(roof, tests::placedAt({0, 5, 0})),
                                           scene.addStatic(box, tests::placedAt({0.013, 0, 0.017}))};
    // About 20 x 20 texels in the fine cascade and 7 x 7 in the coarse one.
    for (const auto& [budget, certificates] : {std::pair(4096u, 2u), {100u, 1u}, {1u, 0u}}) {
        culling::Occlusion occlusion(scene.table, scene.light, configured(budget));
        occlusion.await(0, ids);
        occlusion.await(1, ids);
        EXPECT_EQ(occlusion.search(scene.statics, kUnlimited).certificates, certificates) << budget << " rays";
    }
}

TEST(RayAllowance, FollowsWhatCertificatesPay) {
    using culling::RayAllowance;
    RayAllowance barren;
    uint64_t frames = 0;
    for (; barren.rays() == RayAllowance::kMost; ++frames) barren.spent({.rays = barren.rays()});
    EXPECT_EQ(frames, RayAllowance::kLent / RayAllowance::kMost) << "what was lent is spent at once";
    for (int frame = 0; frame < 10000; ++frame) barren.spent({.rays = RayAllowance::kLeast});
    EXPECT_EQ(barren.rays(), RayAllowance::kLeast);

    const uint64_t worth = RayAllowance::kMost / RayAllowance::kPerCertificate;
    barren.spent({.rays = RayAllowance::kLeast, .certificates = worth + 2});
    EXPECT_EQ(barren.rays(), RayAllowance::kMost) << "a barren stretch leaves no debt";

    RayAllowance rich;
    for (int frame = 0; frame < 10000; ++frame) rich.spent({.rays = rich.rays(), .certificates = worth});
    EXPECT_EQ(rich.rays(), RayAllowance::kMost);
    for (frames = 0; rich.rays() == RayAllowance::kMost; ++frames) rich.spent({.rays = rich.rays()});
    EXPECT_LE(frames, RayAllowance::kLent / RayAllowance::kMost) << "what was earned does not pile up";
}

}  // namespace
