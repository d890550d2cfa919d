// 16-bit maps in a world longer than they can resolve: ranges of depths follow the eye, and every frame equals a
// redraw.
#include <gtest/gtest.h>

#include "server/shadow_system.h"
#include "tests/server/worlds.h"

namespace {

using cache::Cause;
using server::FrameReport;
using server::ShadowConfig;
using server::ShadowSystem;

/// A street of 1,600 m along x, lit along it.
const world::WorldStore& longStreet() {
    static const world::WorldStore store = [] {
        world::BakeSource source = tests::streets(glm::dvec3(0));
        source.header.sun = glm::normalize(glm::dvec3(1, -0.3, 0.05));
        source.chunks.clear();
        for (int x = -1; x < 100; ++x)
            for (int z = -1; z < 1; ++z) source.chunks.push_back({x, 0, z});
        return tests::baked(source, "long.world");
    }();
    return store;
}

ShadowConfig tiny() {
    ShadowConfig config;
    config.cascades = 2;
    config.side = 64;
    config.farDistance = 3;  // ranges of 300 and 900 m
    config.geometryBytes = 16 << 20;
    config.format = gpu::DepthFormat::kD16;
    return config;
}

struct Seen {
    uint64_t differing = 0, rebased = 0, unknown = 0;
    int ranges = 0;  ///< that cascade 0 had
};

Seen walk(ShadowSystem& system, double stride, int frames) {
    Seen seen;
    double near = 0;
    for (int frame = 0; frame < frames; ++frame) {
        const auto report = system.advance({frame / 30.0, {glm::dvec3(500 + stride * frame, 2, 0.3), {1, 0, 0, 0}}, {}});
        EXPECT_TRUE(report) << report.error().what;
        const cache::CascadeStatistics& s = report.value().cascades[0];
        const uint64_t rebase = s.byCause[size_t(Cause::kRebase)].texels;
        seen.rebased += rebase;
        EXPECT_LE(rebase, s.total.texels - rebase + 64 * 64 / 50) << "what the shown maps needed, and a share";
        seen.unknown += s.unknownTexels;
        const server::CascadeView view = system.view(0);
        seen.ranges += view.depthNear != near;
        near = view.depthNear;
        const double z = (view.lightFromWorld * glm::dvec3(500 + stride * frame, 2, 0.3)).z;
        EXPECT_GT(z - 1, view.depthNear);
        EXPECT_LT(z + 1, view.depthNear + view.depthRange);
        if (frame % 7 == 0) seen.differing += system.verify().value().differing;
    }
    return seen;
}

TEST(DepthFollowing, IsSpreadOverFramesAndExact) {
    const auto system = ShadowSystem::create(tests::validatedDevice(), longStreet(), tiny());
    ASSERT_TRUE(system) << system.error().what;
    const Seen seen = walk(*system.value(), 0.5, 600);
    EXPECT_EQ(seen.differing, 0u);
    EXPECT_GE(seen.ranges, 3);
    EXPECT_GT(seen.rebased, 0u);
    EXPECT_EQ(seen.unknown, 0u) << "the shown maps stay whole meanwhile";
    tests::expectSilence();
}

TEST(DepthFollowing, FloatsCoverTheWholeWorld) {
    ShadowConfig config = tiny();
    config.format = gpu::DepthFormat::kD32;
    const auto system = ShadowSystem::create(tests::validatedDevice(), longStreet(), config);
    ASSERT_TRUE(system) << system.error().what;
    const Seen seen = walk(*system.value(), 3, 100);
    EXPECT_EQ(seen.ranges, 1);
    EXPECT_EQ(seen.rebased, 0u);
}

}  // namespace
