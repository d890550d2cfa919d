// Other maps while a system runs: what can be kept is kept, and every frame equals a redraw.
#include <gtest/gtest.h>

#include <random>

#include "server/shadow_system.h"
#include "tests/server/worlds.h"
#include "tests/world/terrain_fields.h"
#include "world/terrain.h"

namespace {

using cache::Cause;
using server::FrameReport;
using server::MapSettings;
using server::ShadowConfig;
using server::ShadowSystem;

constexpr int kMapSide = 128;

std::unique_ptr<ShadowSystem> walkable() {
    static const world::WorldStore store = tests::baked(tests::streets(glm::dvec3(0)), "reconfigured.world");
    ShadowConfig config;
    config.cascades = 3;
    config.side = kMapSide;
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
    const auto system = walkable();
    Walk walk(*system);
    for (int frame = 0; frame < 10; ++frame) walk.step();
    MapSettings settings = system->config();
    settings.cascades = 4;  // one more at the near end
    ASSERT_TRUE(system->reconfigure(settings));
    ASSERT_EQ(system->cascades(), 4);
    const FrameReport more = walk.step(0);
    EXPECT_EQ(more.cascades[0].byCause[size_t(Cause::kStart)].texels, uint64_t(kMapSide * kMapSide));
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
    const auto system = walkable();
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
    const auto system = walkable();
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

/// Hills with a cave, in terrain chunks with all their levels of detail.
world::BakeSource hillsSource() {
    world::BakeSource source;
    source.header.chunkSize = 64;
    source.header.voxel = 2;
    source.header.source = "hills";
    source.header.sun = glm::normalize(glm::dvec3(0.5, -0.8, 0.2));
    for (int x = 0; x < 6; ++x)
        for (int z = 0; z < 6; ++z) source.chunks.push_back({x, 0, z});
    source.make = [](world::ChunkKey key) -> world::Result<world::SourceChunk> {
        auto made = world::makeTerrain(world::test::fieldOf(world::test::hillsWithCave, -60, 60), key, 32, 2);
        if (!made) return made.error();
        world::SourceChunk chunk;
        chunk.terrain = std::move(*made.value());
        return chunk;
    };
    return source;
}

ShadowConfig onHills() {
    ShadowConfig config;
    config.cascades = 2;
    config.side = 256;
    config.farDistance = 120;
    config.geometryBytes = 64 << 20;
    return config;
}

TEST(Reconfigure, VerificationSeesLevelsThatSwitchInSilence) {
    const world::WorldStore store = tests::baked(hillsSource(), "silent_hills.world");
    ShadowConfig config = onHills();
    config.sabotage = cache::Sabotage::kSilentLevel;
    const auto made = ShadowSystem::create(tests::validatedDevice(), store, config);
    ASSERT_TRUE(made) << made.error().what;
    ShadowSystem& system = *made.value();
    const server::FrameInput input{0, {glm::dvec3(192, 10, 192), {1, 0, 0, 0}}, {}};
    ASSERT_TRUE(system.advance(input));
    EXPECT_EQ(system.verify().value().differing, 0u);
    server::MapSettings settings = system.config();
    settings.levelError = 2;
    ASSERT_TRUE(system.reconfigure(settings));
    ASSERT_TRUE(system.advance(input));
    EXPECT_GT(system.verify().value().differing, 0u);
}

TEST(Reconfigure, OtherLevelsDepartAndArriveAndMoveShadowsByLessThanTheirErrors) {
    const world::WorldStore store = tests::baked(hillsSource(), "hills.world");
    ShadowConfig config = onHills();
    const auto made = ShadowSystem::create(tests::validatedDevice(), store, config);
    ASSERT_TRUE(made) << made.error().what;
    ShadowSystem& system = *made.value();
    const server::FrameInput input{0, {glm::dvec3(192, 10, 192), {1, 0, 0, 0}}, {}};
    uint64_t fine = 0;
    const FrameReport first = system.advance(input).value();
    for (const auto& c : first.cascades) fine += c.total.triangles;
    std::vector<std::vector<float>> before;
    for (int c = 0; c < 2; ++c) before.push_back(system.readMap(c, gpu::MapKind::kCache).value());

    server::MapSettings settings = system.config();
    settings.levelError = 2;
    ASSERT_TRUE(system.reconfigure(settings));
    const FrameReport coarser = system.advance(input).value();
    uint64_t level = 0, redrawn = 0;
    for (const auto& c : coarser.cascades) {
        level += c.byCause[size_t(Cause::kLevel)].triangles;
        redrawn += c.total.triangles;
    }
    EXPECT_EQ(level, redrawn) << "one cause";
    EXPECT_GT(level, 0u);
    EXPECT_LT(level, fine);
    EXPECT_EQ(system.verify().value().differing, 0u);

    // A surface that is off by 0.5 texels became one that is off by 2: each depth lies between those that were around
    // it, up to the errors. Errors are measured at sample points, so one texel more is allowed.
    const double errors = 0.5 + 2 + 1;
    const int around = int(std::ceil(errors));
    for (int c = 0; c < 2; ++c) {
        const std::vector<float> after = system.readMap(c, gpu::MapKind::kCache).value();
        const server::CascadeView view = system.view(c);
        const double room = errors * view.texel / view.depthRange;
        uint64_t moved = 0, popped = 0;
        const auto slot = [](int64_t t) { return size_t(((t % 256) + 256) % 256); };
        for (int64_t y = around; y < 256 - around; ++y)
            for (int64_t x = around; x < 256 - around; ++x) {
                const auto at = [&](int64_t i, int64_t j) {
                    return slot(view.window.y + j) * 256 + slot(view.window.x + i);
                };
                const double now = double(after[at(x, y)]);
                moved += after[at(x, y)] != before[size_t(c)][at(x, y)];
                double low = 2, high = -1;
                for (int64_t j = y - around; j <= y + around; ++j)
                    for (int64_t i = x - around; i <= x + around; ++i) {
                        const double was = double(before[size_t(c)][at(i, j)]);
                        low = std::min(low, was);
                        high = std::max(high, was);
                    }
                popped += now < low - room || now > high + room;
            }
        EXPECT_EQ(popped, 0u) << "cascade " << c << ", of " << moved << " texels that moved";
        EXPECT_TRUE(c == 0 || moved > 0);
    }
}

TEST(Reconfigure, AnySequenceStaysExact) {
    const auto system = walkable();
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
    const auto system = walkable();
    Walk walk(*system);
    walk.step();
    const MapSettings good = system->config();
    for (int bad = 0; bad < 6; ++bad) {
        MapSettings settings = good;
        if (bad == 0) settings.cascades = 9;
        if (bad == 1) settings.side = 7;
        if (bad == 2) settings.farDistance = std::nan("");
        if (bad == 3) settings.smallestCaster = -1;
        if (bad == 5) settings.levelError = 0;
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
