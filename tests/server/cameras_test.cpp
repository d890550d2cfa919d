// Several cameras over one world: each has the maps that it would have alone, and what lies in memory is what they
// see together.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>
#include <vector>

#include "server/shadow_system.h"
#include "tests/server/rays.h"
#include "tests/server/worlds.h"

namespace {

using cache::Cause;
using server::Camera;
using server::FrameReport;
using server::MapSettings;
using server::ShadowConfig;
using server::ShadowSystem;
using tests::streetsWorld;
using tests::systemOn;

ShadowConfig config(int cameras) {
    ShadowConfig config;
    config.cameras = cameras;
    config.cascades = 3;
    config.side = 128;
    config.farDistance = 30;
    config.restSeconds = 0.2;
    config.geometryBytes = 16 << 20;
    return config;
}

/// One walks, one circles and jumps, one stands; further ones stand elsewhere.
Camera cameraAt(int camera, int frame) {
    const double t = frame / 30.0;
    glm::dvec3 at(20.0 * camera - 50, 2, 40 - 15.0 * camera);
    if (camera == 0) at = {-40 + 0.9 * frame, 2, 3};
    if (camera == 1) at = {20 * std::sin(3 * t), 2, 20 * std::cos(3 * t) + (frame % 30 < 15 ? 0 : 50)};
    return {at, {1, 0, 0, 0}, 0, 1, {}};
}

/// Frames for some of those cameras.
class Party {
public:
    Party(ShadowSystem& system, std::vector<int> cameras) : system_(system), cameras_(std::move(cameras)) {
        mover_ = system.adopt("box " + world::toString(world::ChunkKey{0, 0, 0}) + " 0").value();
    }
    FrameReport step(glm::dvec3 sun = glm::dvec3(0)) {
        std::vector<Camera> others;
        for (const int camera : cameras_) others.push_back(cameraAt(camera, still_ ? 0 : frame_));
        const Camera first = others.front();
        others.erase(others.begin());
        server::ObjectUpdate update{mover_, system_.restPlacement(mover_)};
        update.placement.translation += glm::dvec3(0.05 * (frame_ % 40), 0, 0);
        const bool moves = frame_ % 40 < 20 && !still_;
        auto report = system_.advance({double(frame_++) / 30, first, std::span(&update, moves ? 1u : 0u), sun, others});
        EXPECT_TRUE(report) << report.error().what;
        return std::move(report.value());
    }
    void hold() { still_ = true; }
    void show(std::vector<int> cameras) { cameras_ = std::move(cameras); }

private:
    ShadowSystem& system_;
    std::vector<int> cameras_;
    server::ObjectId mover_ = 0;
    int frame_ = 0;
    bool still_ = false;
};

void expectExact(ShadowSystem& system) {
    const auto verified = system.verify();
    ASSERT_TRUE(verified) << verified.error().what;
    ASSERT_GT(verified.value().texels, 0u);
    ASSERT_EQ(verified.value().differing, 0u) << "cascade " << verified.value().first[0].cascade;
}

TEST(Cameras, EachHasTheMapsThatItWouldHaveAlone) {
    const auto together = systemOn(streetsWorld(), config(3));
    Party all(*together, {0, 1, 2});
    std::vector<std::unique_ptr<ShadowSystem>> alone;
    std::vector<Party> single;
    for (int k = 0; k < 3; ++k) {
        alone.push_back(systemOn(streetsWorld(), config(1)));
        single.emplace_back(*alone.back(), std::vector<int>{k});
    }
    ASSERT_EQ(together->cascades(), 9);
    for (int frame = 0; frame < 60; ++frame) {
        const FrameReport report = all.step();
        ASSERT_EQ(report.cascades.size(), 9u);
        ASSERT_TRUE(report.errors.empty());
        for (size_t k = 0; k < 3; ++k) {
            const FrameReport one = single[k].step();
            for (size_t c = 0; c < 3; ++c) {
                EXPECT_EQ(report.cascades[3 * k + c].window, one.cascades[c].window);
                EXPECT_EQ(report.cascades[3 * k + c].total.texels, one.cascades[c].total.texels) << "frame " << frame;
            }
        }
        if (frame % 6 > 0) continue;
        expectExact(*together);
        for (int k = 0; k < 3; ++k)
            for (int c = 0; c < 3; ++c)
                for (const auto kind : {gpu::MapKind::kCache, gpu::MapKind::kWorking})
                    ASSERT_EQ(together->mapHash(3 * k + c, kind).value(), alone[size_t(k)]->mapHash(c, kind).value())
                        << "frame " << frame << ", camera " << k << ", cascade " << c;
    }
    tests::expectSilence();
}

TEST(Cameras, ShareWhatTheySeeAlike) {
    std::vector<uint64_t> resident, geometry;
    for (const int count : {1, 2, 4, 8}) {
        const auto system = systemOn(streetsWorld(), config(count));
        std::vector<Camera> others(size_t(count) - 1, cameraAt(0, 0));
        for (size_t k = 0; k < others.size(); ++k) others[k].orientation = glm::angleAxis(double(k), glm::dvec3(0, 1, 0));
        FrameReport report;
        for (int frame = 0; frame < 3; ++frame)
            report = system->advance({frame / 30.0, cameraAt(0, 0), {}, glm::dvec3(0), others}).value();
        resident.push_back(report.residentBytes);
        geometry.push_back(report.geometryBytes);
    }
    for (size_t i = 1; i < resident.size(); ++i) {
        EXPECT_EQ(resident[i], resident[0]);
        EXPECT_EQ(geometry[i], geometry[0]);
    }
    tests::expectSilence();
}

TEST(Cameras, FarApartEachNeedsItsOwn) {
    const auto system = systemOn(streetsWorld(), config(2));
    Camera far = cameraAt(0, 0);
    far.position.x += 80;
    const uint64_t both = system->advance({0, cameraAt(0, 0), {}, glm::dvec3(0), std::span(&far, 1)}).value().residentBytes;
    const uint64_t one = systemOn(streetsWorld(), config(1))->advance({0, cameraAt(0, 0), {}}).value().residentBytes;
    const uint64_t other = systemOn(streetsWorld(), config(1))->advance({0, far, {}}).value().residentBytes;
    EXPECT_GT(both, one);
    EXPECT_GT(both, other);
    EXPECT_LE(both, one + other);
}

TEST(Cameras, ABudgetIsSharedAndNobodyStarves) {
    const auto system = systemOn(streetsWorld(), config(3));
    Party party(*system, {0, 1, 2});
    party.step();
    constexpr uint64_t kTexels = 3000;
    ASSERT_TRUE(system->setBudget({.texels = kTexels}));
    for (int frame = 0; frame < 30; ++frame) {
        const FrameReport report = party.step();
        uint64_t texels = 0;
        for (const auto& c : report.cascades) texels += c.total.texels;
        ASSERT_LE(texels, kTexels);
        if (frame % 10 == 0) expectExact(*system);
    }
    party.hold();
    uint64_t owed = 1;
    for (int frame = 0; owed > 0; ++frame) {
        ASSERT_LT(frame, 400);
        owed = 0;
        const FrameReport report = party.step();
        for (const auto& c : report.cascades) owed += c.unknownTexels + c.staleTexels;
    }
    ASSERT_TRUE(system->setBudget({}));
    const FrameReport free = party.step();
    for (const auto& c : free.cascades) EXPECT_EQ(c.total.texels, 0u);
    expectExact(*system);
    tests::expectSilence();
}

TEST(Cameras, OneTriangleAFrameServesThemInTurn) {
    const auto system = systemOn(streetsWorld(), config(3));
    Party party(*system, {0, 1, 2});
    party.hold();
    ASSERT_TRUE(system->setBudget({.triangles = 1}));
    std::vector<uint64_t> drawn(3);
    for (int frame = 0; frame < 12; ++frame) {
        const FrameReport report = party.step();
        for (size_t n = 0; n < report.cascades.size(); ++n) drawn[n / 3] += report.cascades[n].total.texels;
    }
    for (const uint64_t texels : drawn) EXPECT_GT(texels, 0u);
}

TEST(Cameras, ComeAndGoWhileTheFirstKeepTheirMaps) {
    const auto system = systemOn(streetsWorld(), config(2));
    Party party(*system, {2, 3});
    party.step();
    MapSettings settings = system->config();
    settings.cameras = 3;
    ASSERT_TRUE(system->reconfigure(settings));
    party.show({2, 3, 4});
    const FrameReport more = party.step();
    ASSERT_EQ(more.cascades.size(), 9u);
    for (size_t n = 0; n < 9; ++n)
        EXPECT_EQ(more.cascades[n].byCause[size_t(Cause::kStart)].texels, n < 6 ? 0u : 128u * 128u) << n;
    expectExact(*system);
    settings.cameras = 1;
    ASSERT_TRUE(system->reconfigure(settings));
    party.show({2});
    const FrameReport less = party.step();
    ASSERT_EQ(less.cascades.size(), 3u);
    for (const auto& c : less.cascades) EXPECT_EQ(c.total, cache::Cost{});
    expectExact(*system);
    settings.cameras = 9;
    const auto tooMany = system->reconfigure(settings);
    ASSERT_FALSE(tooMany);
    EXPECT_EQ(tooMany.error().what, "cameras: 9; give 1 to 8");
    tests::expectSilence();
}

TEST(Cameras, FollowASteppingSun) {
    ShadowConfig moving = config(2);
    moving.movingSun = true;
    const auto system = systemOn(streetsWorld(), moving);
    Party party(*system, {0, 1});
    glm::dvec3 sun = glm::normalize(glm::dvec3(0.5, -0.9, 0.3));
    uint64_t steps = 0;
    glm::dvec3 shown(0);
    for (int frame = 0; frame < 90; ++frame) {
        sun = glm::normalize(sun + glm::dvec3(0.0008, 0, 0));
        const FrameReport report = party.step(sun);
        steps += frame > 0 && report.sun.shown != shown ? 1 : 0;
        shown = report.sun.shown;
        if (frame % 10 == 0) expectExact(*system);
    }
    EXPECT_GT(steps, 0u);
    tests::expectSilence();
}

TEST(Cameras, AnswerForThemselves) {
    const auto system = systemOn(streetsWorld(), config(3));
    Party party(*system, {2, 3, 4});
    party.hold();
    party.step();
    const tests::WorldTriangles triangles = tests::trianglesOf(streetsWorld());
    for (int camera = 0; camera < 3; ++camera) {
        const glm::dvec3 eye = cameraAt(camera + 2, 0).position;
        std::vector<glm::dvec3> points;
        std::mt19937 rng(3);
        for (int i = 0; i < 200; ++i)
            points.push_back(eye + glm::dvec3(double(rng() % 200) / 20 - 5, double(rng() % 100) / 20, double(rng() % 200) / 20 - 5));
        const auto answers = system->lookup(points, {}, camera).value();
        int judged = 0, wrong = 0, dark = 0;
        for (size_t i = 0; i < points.size(); ++i) {
            ASSERT_GE(answers[i].cascade, 3 * camera);
            ASSERT_LT(answers[i].cascade, 3 * camera + 3);
            // Away from edges by two of the coarsest texels, and shaded by what is farther off than the bias.
            int lit = 0, shadowed = 0;
            for (const glm::dvec3 d : {glm::dvec3(0), {1, 0, 0}, {-1, 0, 0}, {0, 0, 1}, {0, 0, -1}}) {
                const double caster = tests::farthestCaster(triangles, points[i] + d, -system->config().sun);
                lit += caster == 0;
                shadowed += caster > 1;
            }
            if (lit != 5 && shadowed != 5) continue;
            ++judged;
            dark += shadowed == 5;
            wrong += (answers[i].light == server::Light::kShadowed) != (shadowed == 5);
        }
        EXPECT_GT(judged, 50);
        EXPECT_GT(dark, 5);
        EXPECT_EQ(wrong, 0) << "camera " << camera;
    }
}

TEST(Cameras, AFrameNamesTheOneThatIsWrong) {
    const auto system = systemOn(streetsWorld(), config(2));
    Camera bad = cameraAt(1, 0);
    const auto missing = system->advance({0, cameraAt(0, 0), {}});
    ASSERT_FALSE(missing);
    EXPECT_EQ(missing.error().what, "frame 0: 1 cameras; give 2, as many as its maps are made for");
    bad.position.y = NAN;
    const auto nowhere = system->advance({0, cameraAt(0, 0), {}, glm::dvec3(0), std::span(&bad, 1)});
    ASSERT_FALSE(nowhere);
    EXPECT_EQ(nowhere.error().what, "frame 0: camera 1: its position is not finite; give metres");
    bad = cameraAt(1, 0);
    EXPECT_TRUE(system->advance({0, cameraAt(0, 0), {}, glm::dvec3(0), std::span(&bad, 1)})) << "nothing has changed";
}

TEST(Cameras, SamePlansForAnyNumberOfThreads) {
    std::vector<std::vector<uint64_t>> hashes;
    for (const size_t threads : {1, 3}) {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        const auto system = systemOn(streetsWorld(), config(3));
        Party party(*system, {0, 1, 2});
        hashes.emplace_back();
        for (int frame = 0; frame < 20; ++frame) hashes.back().push_back(party.step().planHash);
    }
    EXPECT_EQ(hashes[0], hashes[1]);
}

}  // namespace
