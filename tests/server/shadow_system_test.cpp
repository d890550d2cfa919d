// The whole system on a small world: exact every frame, the same for any number of threads, idle at
// rest, and each deliberate defect seen by its own verification.
#include "server/shadow_system.h"

#include <tbb/global_control.h>

#include <random>

#include "gpu/floor.h"
#include "tests/server/rays.h"
#include "tests/server/worlds.h"

namespace {

using server::FrameReport;
using server::ObjectUpdate;
using server::ShadowConfig;
using server::ShadowSystem;
using tests::streetsWorld;
using tests::systemOn;

ShadowConfig smallConfig() {
    ShadowConfig config;
    config.cascades = 3;
    config.side = 256;
    config.farDistance = 45;
    config.restSeconds = 0.5;
    config.geometryBytes = 16 << 20;
    return config;
}

/// A camera that walks, turns, stands and jumps, and objects that move, stop and start again.
class Wander {
public:
    Wander(ShadowSystem& system, glm::dvec3 origin) : system_(system), origin_(origin), eye_(origin) {
        const glm::i64vec2 base(glm::floor(glm::dvec2(origin.x, origin.z) / 16.0));
        for (int i = 0; i < 12; ++i) {
            const world::ChunkKey key{int32_t(base.x) + i % 3 - 1, 0, int32_t(base.y) + i / 3 - 2};
            auto id = system.adopt((i % 4 == 0 ? "roof " : "box ") + world::toString(key) + (i % 4 == 0 ? "" : " 0"));
            if (!id) throw std::runtime_error(id.error().what);
            objects_.push_back(id.value());
        }
    }
    FrameReport step() {
        const auto uniform = [this](double a, double b) { return a + (b - a) * double(rng_()) / 4294967295.0; };
        std::vector<ObjectUpdate> updates;
        for (const server::ObjectId object : objects_) {
            if (frame_ % 40 < 20 || rng_() % 3) continue;  // all rest for 20 frames, then some move
            ObjectUpdate update{object, system_.restPlacement(object)};
            update.placement.translation += glm::dvec3(uniform(-3, 3), uniform(0, 1), uniform(-3, 3));
            updates.push_back(update);
        }
        if (frame_ % 37 == 36) eye_ = origin_ + glm::dvec3(uniform(-60, 60), 2, uniform(-60, 60));
        else if (frame_ % 10 < 8) eye_ += glm::dvec3(uniform(-1, 1), 0, uniform(-1, 1));
        auto report = system_.advance({double(frame_) / 30, {eye_, {1, 0, 0, 0}}, updates});
        if (!report) throw std::runtime_error(report.error().what);
        ++frame_;
        return std::move(report.value());
    }

private:
    ShadowSystem& system_;
    glm::dvec3 origin_, eye_;
    std::vector<server::ObjectId> objects_;
    std::mt19937 rng_{17};
    int frame_ = 0;
};

TEST(ShadowSystem, ItsCastersCostWhatItsFramesCost) {
    ShadowConfig config = smallConfig();
    config.budget.triangles = 400;  // work is tried and taken back
    const auto system = systemOn(streetsWorld(), config);
    Wander walk(*system, glm::dvec3(0));
    uint64_t triangles = 0, limited = 0;
    for (int frame = 0; frame < 120; ++frame) {
        const FrameReport report = walk.step();
        ASSERT_EQ(system->plan().casters.size(), system->plan().transforms.size());
        cache::Cost all;
        for (const cache::CascadeStatistics& c : report.cascades) {
            all += c.total;
            limited += c.unknownTexels + c.staleTexels > 0;
        }
        triangles += all.triangles;
        const auto casters = system->dearestCasters(1000);
        cache::Cost sum;
        for (size_t k = 0; k < casters.size(); ++k) {
            sum.triangles += casters[k].triangles;
            sum.draws += casters[k].draws;
            EXPECT_FALSE(casters[k].name.empty());
            if (k > 0) {
                EXPECT_LE(casters[k].triangles, casters[k - 1].triangles);
                EXPECT_NE(casters[k].name, casters[k - 1].name);
            }
        }
        ASSERT_EQ(sum.triangles, all.triangles) << "frame " << frame;
        ASSERT_EQ(sum.draws, all.draws) << "frame " << frame;
        EXPECT_EQ(system->dearestCasters(1).size(), std::min<size_t>(casters.size(), 1));
    }
    EXPECT_GT(triangles, 10000u);
    EXPECT_GT(limited, 10u);
}

TEST(ShadowSystem, EveryFrameEqualsARedrawFromScratch) {
    const glm::dvec3 far(1e6, 0, -6.1e6);
    const world::WorldStore distant = tests::baked(tests::streets(far), "far.world");
    for (const bool away : {false, true}) {
        const auto system = systemOn(away ? distant : streetsWorld(), smallConfig());
        Wander walk(*system, away ? far : glm::dvec3(0));
        uint64_t certificates = 0, revoked = 0, departures = 0, promotions = 0;
        for (int frame = 0; frame < 120; ++frame) {
            const FrameReport report = walk.step();
            ASSERT_TRUE(report.errors.empty()) << report.errors[0].what;
            certificates += report.certificates;
            revoked += report.revocations;
            departures += report.chunkDepartures;
            for (const auto& c : report.cascades) {
                cache::Cost sum;
                for (const cache::Cost& cost : c.byCause) sum += cost;
                ASSERT_EQ(sum, c.total) << "frame " << frame;
                promotions += c.byCause[size_t(cache::Cause::kPromotion)].draws;
            }
            const auto verified = system->verify();
            ASSERT_TRUE(verified) << verified.error().what;
            ASSERT_EQ(verified.value().differing, 0u)
                << "frame " << frame << ", texel " << verified.value().first[0].texel.x << ", "
                << verified.value().first[0].texel.y << " of cascade " << verified.value().first[0].cascade;
        }
        EXPECT_GT(certificates, 0u);
        EXPECT_GT(revoked, 0u);
        EXPECT_GT(departures, 0u);
        EXPECT_GT(promotions, 0u);
    }
    tests::expectSilence();
}

TEST(ShadowSystem, MapsAnswerLikeRays) {
    const auto system = systemOn(streetsWorld(), smallConfig());
    const glm::dvec3 eye(3, 2, 1);
    ASSERT_TRUE(system->advance({0, {eye, {1, 0, 0, 0}}, {}}));
    const tests::WorldTriangles triangles = tests::trianglesOf(streetsWorld());
    std::mt19937 rng(3);
    int lit = 0, dark = 0;
    for (int c = 0; c < system->cascades(); ++c) {
        const server::CascadeView view = system->view(c);
        const std::vector<float> map = system->readMap(c, gpu::MapKind::kWorking).value();
        const int64_t side = smallConfig().side;
        for (int step = 0; step < 150; ++step) {
            const auto uniform = [&rng](double a, double b) { return a + (b - a) * double(rng()) / 4294967295.0; };
            const double reach = view.split * 0.7;
            const glm::dvec3 p(eye.x + uniform(-reach, reach), 0.02, eye.z + uniform(-reach, reach));
            const glm::dvec3 pLight = view.lightFromWorld * p;
            const cache::Texel at(glm::floor(glm::dvec2(pLight) / view.texel));
            ASSERT_TRUE((cache::TexelRect{view.window, view.window + side}.contains({at, at + int64_t(1)})));
            // Texels at a shadow's edge may answer either way: compare where their neighbours agree.
            int near = 0;
            for (int64_t y = -1; y <= 1; ++y)
                for (int64_t x = -1; x <= 1; ++x) {
                    const cache::Texel slot = (((at + cache::Texel(x, y)) % side) + side) % side;
                    // Bias: the ground itself lies 0.02 m below and slopes by a texel across the map.
                    const double depth = view.depthNear + double(map[size_t(slot.y * side + slot.x)]) * view.depthRange;
                    near += depth < pLight.z - 0.05 - 2 * view.texel;
                }
            if (near != 0 && near != 9) continue;
            ASSERT_EQ(near == 9, tests::shadowed(triangles, p, -system->config().sun)) << "cascade " << c << ", step " << step;
            ++(near == 9 ? dark : lit);
        }
    }
    EXPECT_GT(lit, 50);
    EXPECT_GT(dark, 20);
}

TEST(ShadowSystem, EachDefectIsSeen) {
    for (const cache::Sabotage sabotage : {cache::Sabotage::kLiteralScroll, cache::Sabotage::kDeafDeparture,
                                           cache::Sabotage::kStickyCertificate}) {
        ShadowConfig config = smallConfig();
        config.sabotage = sabotage;
        const auto system = systemOn(streetsWorld(), config);
        Wander walk(*system, glm::dvec3(0));
        bool caught = false;
        for (int frame = 0; frame < 120 && !caught; ++frame) {
            walk.step();
            const auto verified = system->verify();
            ASSERT_TRUE(verified);
            caught = verified.value().differing > 0;
            if (caught) {
                ASSERT_FALSE(verified.value().first.empty());
                EXPECT_FALSE(verified.value().first[0].casters.empty()) << "a difference must name casters";
            }
        }
        EXPECT_TRUE(caught) << "sabotage " << int(sabotage);
    }
    tests::expectSilence();
}

TEST(ShadowSystem, IsTheSameForAnyNumberOfThreads) {
    std::vector<std::vector<uint64_t>> runs;
    for (const size_t threads : {1, 2, 5}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        const auto system = systemOn(streetsWorld(), smallConfig());
        Wander walk(*system, glm::dvec3(0));
        std::vector<uint64_t> run;
        for (int frame = 0; frame < 60; ++frame) {
            const FrameReport r = walk.step();
            for (uint64_t v : {r.planHash, r.rays, r.certificates, r.revocations, r.bytesRead, r.bytesUploaded}) run.push_back(v);
            for (int c = 0; c < system->cascades(); ++c)
                for (const auto kind : {gpu::MapKind::kCache, gpu::MapKind::kWorking})
                    run.push_back(system->mapHash(c, kind).value());
        }
        runs.push_back(run);
    }
    EXPECT_EQ(runs[0], runs[1]);
    EXPECT_EQ(runs[0], runs[2]);
}

TEST(ShadowSystem, OcclusionChangesNoTexel) {
    ShadowConfig config = smallConfig();
    const auto exact = systemOn(streetsWorld(), config);
    config.occlusion = false;
    const auto off = systemOn(streetsWorld(), config);
    Wander a(*exact, glm::dvec3(0)), b(*off, glm::dvec3(0));
    uint64_t hidden = 0;
    for (int frame = 0; frame < 60; ++frame) {
        for (const auto& c : a.step().cascades) hidden += c.clustersHidden;
        b.step();
        for (int c = 0; c < exact->cascades(); ++c)
            for (const auto kind : {gpu::MapKind::kCache, gpu::MapKind::kWorking})
                ASSERT_EQ(exact->mapHash(c, kind).value(), off->mapHash(c, kind).value()) << "frame " << frame;
    }
    EXPECT_GT(hidden, 0u);
    tests::expectSilence();
}

TEST(ShadowSystem, NothingMovingSubmitsNothing) {
    const auto system = systemOn(streetsWorld(), smallConfig());
    const server::FrameInput input{0, {glm::dvec3(3, 2, 1), {1, 0, 0, 0}}, {}};
    ASSERT_TRUE(system->advance(input).value().submitted);
    for (int frame = 1; frame < 5; ++frame) {
        const FrameReport report = system->advance({frame / 30.0, input.camera, {}}).value();
        EXPECT_FALSE(report.submitted);
        EXPECT_EQ(report.bytesUploaded, 0u);
        for (const auto& c : report.cascades) EXPECT_EQ(c.total, cache::Cost{});
    }
}

TEST(ShadowSystem, RedrawMethodDrawsEverythingEveryFrame) {
    ShadowConfig config = smallConfig();
    config.method = server::Method::kRedraw;
    const auto system = systemOn(streetsWorld(), config);
    Wander walk(*system, glm::dvec3(0));
    for (int frame = 0; frame < 5; ++frame) {
        const FrameReport report = walk.step();
        const server::RedrawCosts costs = system->redrawCosts();
        for (size_t c = 0; c < costs.size(); ++c) EXPECT_EQ(report.cascades[c].total, costs[c]);
        EXPECT_EQ(system->verify().value().differing, 0u);
    }
}

TEST(ShadowSystem, BadItemsAreReportedAndTheFrameGoesOn) {
    const auto system = systemOn(streetsWorld(), smallConfig());
    EXPECT_FALSE(system->adopt("no such box"));
    const server::ObjectId box = system->adopt("box (0,0,0) 1").value();
    EXPECT_EQ(system->adopt("box (0,0,0) 1").value(), box);
    world::Placement broken = system->restPlacement(box);
    broken.translation.y = std::nan("");
    const ObjectUpdate updates[] = {{box, broken}, {box + 7, system->restPlacement(box)}};
    const auto report = system->advance({0, {glm::dvec3(0), {1, 0, 0, 0}}, updates});
    ASSERT_TRUE(report);
    EXPECT_EQ(report.value().errors.size(), 2u);
    EXPECT_EQ(system->verify().value().differing, 0u);
    EXPECT_FALSE(system->advance({0, {glm::dvec3(std::nan(""), 0, 0), {1, 0, 0, 0}}, {}}));
    EXPECT_FALSE(system->advance({0, {glm::dvec3(0, 0, -1e100), {1, 0, 0, 0}}, {}}));
    ASSERT_TRUE(system->remove(box));
    const auto gone = system->adopt("box (0,0,0) 1");
    ASSERT_FALSE(gone);
    EXPECT_NE(gone.error().what.find("removed"), std::string::npos) << gone.error().what;
}

TEST(ShadowSystem, RefusesWhatCannotWork) {
    ShadowConfig config = smallConfig();
    config.sun = {0, 1, 0};
    EXPECT_FALSE(ShadowSystem::create(tests::validatedDevice(), streetsWorld(), config));
    config = smallConfig();
    config.streaming.disk.channels = 0;
    const auto refused = ShadowSystem::create(tests::validatedDevice(), streetsWorld(), config);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().what.find("1024 channels"), std::string::npos) << refused.error().what;
}

/// Budgets too small for what the windows need leave chunks out, keep to the budget, and say where it shows.
TEST(ShadowSystem, WhatDoesNotFitIsMissingAndSaidToBe) {
    const auto whole = systemOn(streetsWorld(), smallConfig());
    Wander needs(*whole, glm::dvec3(0));
    const FrameReport full = needs.step();
    ASSERT_GT(full.chunkArrivals, 2u);
    EXPECT_EQ(full.missingChunks + full.coarseChunks, 0u);
    for (const bool onGpu : {false, true}) {
        ShadowConfig config = smallConfig();
        (onGpu ? config.geometryBytes : config.residentBytes) = (onGpu ? full.geometryBytes : full.residentBytes) * 3 / 4;
        const auto system = systemOn(streetsWorld(), config);
        Wander walk(*system, glm::dvec3(0));
        uint64_t missing = 0;
        for (int frame = 0; frame < 30; ++frame) {
            const FrameReport report = walk.step();
            EXPECT_TRUE(report.errors.empty());
            ASSERT_LE(report.residentBytes, config.residentBytes);
            ASSERT_LE(report.geometryBytes, config.geometryBytes);
            EXPECT_GT(report.missingChunks, 0u);
            for (const cache::CascadeStatistics& s : report.cascades) missing += s.missingTexels;
        }
        EXPECT_GT(missing, 0u);
        EXPECT_EQ(system->verify().value().differing, 0u);
        // Where a map differs from the whole world's, its texels say so.
        const auto truth = systemOn(streetsWorld(), smallConfig());
        Wander beside(*truth, glm::dvec3(0));
        for (int frame = 0; frame < 30; ++frame) beside.step();
        size_t wrong = 0;
        for (int c = 0; c < system->cascades(); ++c) {
            const auto held = system->readMap(c, gpu::MapKind::kWorking).value(),
                       right = truth->readMap(c, gpu::MapKind::kWorking).value();
            const auto states = system->texelStates(c, gpu::MapKind::kWorking);
            for (size_t i = 0; i < held.size(); ++i) {
                if (held[i] == right[i]) continue;
                ++wrong;
                ASSERT_EQ(states[i], server::TexelState::kStale);
            }
        }
        EXPECT_GT(wrong, 0u);
    }
    tests::expectSilence();
}

/// Plans and geometry as the system hands them out, drawn by somebody else: chunks come and go on the
/// way, and with them the numbers of their geometry.
TEST(ShadowSystem, FramesOverlapWithoutADifference) {
    const auto waits = systemOn(streetsWorld(), smallConfig()), overlaps = systemOn(streetsWorld(), smallConfig());
    Wander first(*waits, glm::dvec3(0)), second(*overlaps, glm::dvec3(0));
    std::vector<FrameReport> reports;
    for (int frame = 0; frame < 80; ++frame) {
        FrameReport report = first.step();
        ASSERT_TRUE(waits->finish(report));
        EXPECT_EQ(report.gpu.submitted, report.submitted);
        reports.push_back(second.step());
        ASSERT_EQ(report.planHash, reports.back().planHash) << "frame " << frame;
        EXPECT_EQ(reports.back().gpu.wallMs, 0) << "nobody waited";
    }
    for (int c = 0; c < waits->cascades(); ++c)
        ASSERT_EQ(waits->mapHash(c, gpu::MapKind::kWorking).value(), overlaps->mapHash(c, gpu::MapKind::kWorking).value());
    EXPECT_EQ(overlaps->verify().value().differing, 0u);
    ASSERT_TRUE(overlaps->finish(reports[70])) << "some frames late";
    EXPECT_GT(reports[70].gpu.wallMs, 0);
    const auto tooLate = overlaps->finish(reports[0]);
    ASSERT_FALSE(tooLate);
    EXPECT_EQ(tooLate.error().code, world::ErrorCode::kUsage);
    EXPECT_NE(tooLate.error().what.find("frame 0"), std::string::npos);
    tests::expectSilence();
}

TEST(ShadowSystem, ALongRestBetweenFramesInFlightIsNoMatter) {
    const auto system = systemOn(streetsWorld(), smallConfig());
    double x = 0;
    for (int frame = 0; frame < 100; ++frame) {
        if (frame < 4 || frame > 90) x += 0.7;
        const auto report = system->advance({frame / 30.0, {{x, 2, 1}, {1, 0, 0, 0}}, {}});
        ASSERT_TRUE(report) << report.error().what;
        ASSERT_EQ(report.value().submitted, frame < 4 || frame > 90) << "frame " << frame;
    }
    EXPECT_EQ(system->verify().value().differing, 0u);
}

TEST(ShadowSystem, PlansCanBeDrawnElsewhere) {
    ShadowConfig config = smallConfig();
    config.timestamps = false;
    const auto system = systemOn(streetsWorld(), config);
    gpu::ShadowMapsConfig maps;
    maps.cascades = config.cascades;
    maps.side = config.side;
    auto floor = gpu::Floor::create(tests::validatedDevice(), maps);
    ASSERT_TRUE(floor) << floor.error().what;
    Wander walk(*system, glm::dvec3(0));
    uint64_t departures = 0;
    for (int frame = 0; frame < 90; ++frame) {
        FrameReport report = walk.step();
        ASSERT_TRUE(system->finish(report));
        departures += report.chunkDepartures;
        for (const gpu::CascadeTimes& times : report.gpu.cascades) ASSERT_EQ(times.staticMs + times.activeMs, 0);
        const auto prepared = floor.value()->prepare(
            system->plan(),
            [&](cache::GeometryId id) -> const world::MeshLevel& { return system->geometry(id); });
        ASSERT_TRUE(prepared) << prepared.error().what;
        ASSERT_TRUE(floor.value()->run(prepared.value()));
        floor.value()->discard();
        if (frame % 10 != 9) continue;
        for (int c = 0; c < system->cascades(); ++c)
            for (const gpu::MapKind kind : {gpu::MapKind::kCache, gpu::MapKind::kWorking})
                ASSERT_EQ(system->readMap(c, kind).value(), floor.value()->read(c, kind).value())
                    << "frame " << frame << " cascade " << c;
    }
    EXPECT_GT(departures, 0u);
    tests::expectSilence();
}

}  // namespace
