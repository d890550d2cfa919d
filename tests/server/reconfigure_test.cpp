// Other maps while a system runs: what can be kept is kept, and every frame equals a redraw.
#include <gtest/gtest.h>

#include <random>

#include "server/shadow_system.h"
#include "tests/server/worlds.h"

namespace {

using cache::Cause;
using server::FrameReport;
using server::MapSettings;
using server::ShadowConfig;
using server::ShadowSystem;

constexpr int kSide = 128;

std::unique_ptr<ShadowSystem> make() {
    static const world::WorldStore store = tests::baked(tests::streets(glm::dvec3(0)), "reconfigured.world");
    ShadowConfig config;
    config.cascades = 3;
    config.side = kSide;
    config.farDistance = 45;
    config.geometryBytes = 16 << 20;
    config.movingSun = true;
    auto system = ShadowSystem::create(tests::validatedDevice(), store, config);
    EXPECT_TRUE(system) << system.error().what;
    return std::move(system.value());
}

class Walk {
public:
    explicit Walk(ShadowSystem& system) : system_(system) {}
    FrameReport step(double stride = 0.3, glm::dvec3 sun = glm::dvec3(0)) {
        x_ += stride;
        auto report = system_.advance({double(frame_++) / 30, {glm::dvec3(x_, 2, 1), {1, 0, 0, 0}}, {}, sun});
        EXPECT_TRUE(report) << report.error().what;
        return std::move(report.value());
    }
    void expectExact() {
        const auto verified = system_.verify();
        ASSERT_TRUE(verified) << verified.error().what;
        ASSERT_GT(verified.value().texels, 0u);
        ASSERT_EQ(verified.value().differing, 0u) << "frame " << frame_;
    }

private:
    ShadowSystem& system_;
    int frame_ = 0;
    double x_ = -20;
};

TEST(Reconfigure, ACascadeMoreOrLessKeepsTheOthers) {
    const auto system = make();
    Walk walk(*system);
    for (int frame = 0; frame < 10; ++frame) walk.step();
    MapSettings settings = system->config();
    settings.cascades = 4;  // one more at the near end
    ASSERT_TRUE(system->reconfigure(settings));
    ASSERT_EQ(system->cascades(), 4);
    const FrameReport more = walk.step(0);
    EXPECT_EQ(more.cascades[0].byCause[size_t(Cause::kStart)].texels, uint64_t(kSide * kSide));
    for (int c = 1; c < 4; ++c) EXPECT_EQ(more.cascades[size_t(c)].total, cache::Cost{}) << "cascade " << c;
    walk.expectExact();
    settings.farDistance = 15;  // the far one goes, the others are those that were
    settings.cascades = 3;
    ASSERT_TRUE(system->reconfigure(settings));
    const FrameReport less = walk.step(0);
    for (int c = 0; c < 3; ++c) EXPECT_EQ(less.cascades[size_t(c)].total, cache::Cost{}) << "cascade " << c;
    EXPECT_FALSE(less.submitted);
    walk.expectExact();
    for (int frame = 0; frame < 10; ++frame) {
        walk.step();
        walk.expectExact();
    }
    tests::expectSilence();
}

TEST(Reconfigure, OtherTexelsAreDrawnAnewWithinTheBudget) {
    const auto system = make();
    Walk walk(*system);
    walk.step();
    ASSERT_TRUE(system->setBudget({.texels = 6000}));
    MapSettings settings = system->config();
    settings.side = 256;
    ASSERT_TRUE(system->reconfigure(settings));
    uint64_t unknown = 1;
    for (int frame = 0; unknown > 0; ++frame) {
        ASSERT_LT(frame, 60);
        const FrameReport report = walk.step(0);
        unknown = 0;
        uint64_t texels = 0;
        for (const auto& c : report.cascades) {
            unknown += c.unknownTexels;
            texels += c.total.texels;
        }
        EXPECT_LE(texels, 6000u);
        walk.expectExact();
    }
    for (int c = 0; c < 3; ++c) EXPECT_EQ(system->readMap(c, gpu::MapKind::kWorking).value().size(), 256u * 256u);
    tests::expectSilence();
}

TEST(Reconfigure, SmallCastersLeaveKeptMapsAndComeBack) {
    const auto system = make();
    Walk walk(*system);
    for (int frame = 0; frame < 5; ++frame) walk.step();
    const auto before = system->mapHash(2, gpu::MapKind::kCache).value();
    MapSettings settings = system->config();
    settings.smallestCaster = 5;
    ASSERT_TRUE(system->reconfigure(settings));
    const FrameReport gone = walk.step(0);
    EXPECT_GT(gone.cascades[2].byCause[size_t(Cause::kLevel)].texels, 0u);
    EXPECT_GT(gone.cascades[2].castersDropped, 0u);
    EXPECT_NE(system->mapHash(2, gpu::MapKind::kCache).value(), before);
    walk.expectExact();
    settings.smallestCaster = 0;
    ASSERT_TRUE(system->reconfigure(settings));
    walk.step(0);
    EXPECT_EQ(system->mapHash(2, gpu::MapKind::kCache).value(), before);
    walk.expectExact();
}

TEST(Reconfigure, AnySequenceStaysExact) {
    const auto system = make();
    Walk walk(*system);
    std::mt19937 rng(5);
    const glm::dvec3 sun = system->config().sun;
    for (int round = 0; round < 25; ++round) {
        MapSettings settings = system->config();
        switch (rng() % 6) {
            case 0: settings.cascades = 1 + int(rng() % 5); break;
            case 1: settings.side = rng() % 2 ? 128 : 96; break;
            case 2: settings.farDistance = rng() % 2 ? 45 : 15; break;
            case 3: settings.guardBand = rng() % 2 ? 1 : 4; break;
            case 4: settings.smallestCaster = double(rng() % 3); break;
            default: settings.format = rng() % 2 ? gpu::DepthFormat::kD16 : gpu::DepthFormat::kD32; break;
        }
        ASSERT_TRUE(system->reconfigure(settings));
        for (uint32_t frame = 0; frame < 1 + rng() % 4; ++frame) {
            // A sun that goes on turning, so that changes also come while its next maps are being filled.
            const glm::dvec3 turned = glm::normalize(sun + glm::dvec3(0.002 * round, 0, 0));
            const FrameReport report = walk.step(rng() % 3 ? 0.4 : 0, turned);
            ASSERT_TRUE(report.errors.empty()) << report.errors[0].what;
            walk.expectExact();
        }
    }
    tests::expectSilence();
}

TEST(Reconfigure, BadSettingsChangeNothing) {
    const auto system = make();
    Walk walk(*system);
    walk.step();
    const MapSettings good = system->config();
    for (int bad = 0; bad < 5; ++bad) {
        MapSettings settings = good;
        if (bad == 0) settings.cascades = 9;
        if (bad == 1) settings.side = 7;
        if (bad == 2) settings.farDistance = std::nan("");
        if (bad == 3) settings.smallestCaster = -1;
        if (bad == 4) settings.guardBand = 1000;
        const auto done = system->reconfigure(settings);
        ASSERT_FALSE(done);
        EXPECT_EQ(done.error().code, world::ErrorCode::kUsage);
        EXPECT_FALSE(done.error().what.empty());
        EXPECT_FALSE(walk.step(0).submitted) << "case " << bad;
        walk.expectExact();
    }
}

}  // namespace
