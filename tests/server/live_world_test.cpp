// Everything that a live world does to its maps: objects of every kind, budgets, sleeping cascades, guard
// bands; exact wherever a texel claims to be valid, and never wrong anywhere else.
#include <cmath>
#include <random>

#include "tests/server/rays.h"
#include "tests/server/worlds.h"
#include "tools/soak.h"

namespace {

using server::Budget;
using server::Light;
using server::ObjectTraits;
using server::ShadowConfig;
using server::ShadowSystem;
using tests::streetsWorld;
using tests::systemOn;

ShadowConfig lifeConfig() {
    ShadowConfig config;
    config.cascades = 3;
    config.side = 128;
    config.farDistance = 45;
    config.restSeconds = 0.5;
    config.geometryBytes = 16 << 20;
    config.movingSun = true;
    return config;
}

tools::SoakReport live(const ShadowConfig& config, uint64_t frames, uint32_t seed) {
    const auto system = systemOn(streetsWorld(), config);
    auto report = tools::soak(*system, streetsWorld(), {frames, 9, seed, 40}, [](const auto&, const auto&) { return world::Done{}; });
    if (!report) throw std::runtime_error(report.error().what);
    return report.value();
}

TEST(LiveWorld, StaysExactThroughMixedLife) {
    for (const int guard : {1, 6}) {
        ShadowConfig config = lifeConfig();
        config.guardBand = guard;
        if (guard > 1) {  // and with it what else can differ from the defaults
            config.format = gpu::DepthFormat::kD16;
            config.smallestCaster = 3;
        }
        const tools::SoakReport report = live(config, 1500, 3);
        EXPECT_EQ(report.differing, 0u);
        EXPECT_EQ(report.frames, 1500u);
        EXPECT_GT(report.texels, report.stale);
        // Nothing tame: all of it happened.
        EXPECT_GT(report.stale, 0u);
        EXPECT_GT(report.unknownTexels, 0u);
        EXPECT_GT(report.sleepers, 20u);
        EXPECT_GT(report.limitedFrames, 100u);
        EXPECT_GT(report.spawns, 50u);
        EXPECT_GT(report.removals, 20u);
        EXPECT_GT(report.jumps, 3u);
        EXPECT_GT(report.chunkDepartures, 0u);
        EXPECT_GT(report.sunRedraws, 5u);
        EXPECT_GT(report.sunSteps, report.sunRedraws + 5);
    }
    tests::expectSilence();
}

TEST(LiveWorld, DroppedCastersAreCountedAndProveNothing) {
    ShadowConfig config = lifeConfig();
    config.smallestCaster = 30;  // in the far cascade that is every caster but the grounds
    // A frame has its share of the search for certificates: later ones hide what the first had to draw.
    const auto hidden = [](ShadowSystem& system) {
        uint64_t clusters = 0;
        for (int frame = 1; frame <= 60; ++frame)
            clusters += system.advance({frame / 30.0, {{0.5 * frame, 2, 0}, {1, 0, 0, 0}}, {}}).value().cascades[2].clustersHidden;
        return clusters;
    };
    const auto system = systemOn(streetsWorld(), config);
    const auto report = system->advance({0, {{0, 2, 0}, {1, 0, 0, 0}}, {}}).value();
    EXPECT_EQ(report.cascades[0].castersDropped, 0u);
    EXPECT_GT(report.cascades[2].castersDropped, 100u);
    EXPECT_EQ(hidden(*system), 0u) << "only roofs hide anything here";
    EXPECT_EQ(system->verify().value().differing, 0u);
    config.smallestCaster = 0;
    EXPECT_GT(hidden(*systemOn(streetsWorld(), config)), 0u);
}

TEST(LiveWorld, TheSameSeedLivesTheSameLife) {
    const tools::SoakReport a = live(lifeConfig(), 200, 8), b = live(lifeConfig(), 200, 8), c = live(lifeConfig(), 200, 9);
    EXPECT_EQ(a.planHash, b.planHash);
    EXPECT_NE(a.planHash, c.planHash);
}

TEST(LiveWorld, EachDefectIsSeen) {
    for (const cache::Sabotage sabotage :
         {cache::Sabotage::kLiteralScroll, cache::Sabotage::kDeafDeparture, cache::Sabotage::kStickyCertificate,
          cache::Sabotage::kForgottenDebt, cache::Sabotage::kUnknownAsEmpty, cache::Sabotage::kMixedSuns,
          cache::Sabotage::kSleptMotion, cache::Sabotage::kDeafArrival, cache::Sabotage::kUnrestored,
          cache::Sabotage::kLostMaps}) {
        ShadowConfig config = lifeConfig();
        config.sabotage = sabotage;
        config.movingSun = sabotage == cache::Sabotage::kMixedSuns;  // a sun that steps drops all certificates
        const tools::SoakReport report = live(config, 3000, 3);
        EXPECT_GT(report.differing, 0u) << "sabotage " << int(sabotage);
        EXPECT_FALSE(report.first.empty());
    }
}

TEST(LiveWorld, AJumpWithinATenthOfItsNeedIsLateAndNeverWrong) {
    const auto rays = tests::trianglesOf(streetsWorld());
    ShadowConfig config = lifeConfig();
    config.guardBand = 1;  // windows follow each step, so that more of them is late
    for (const bool byTriangles : {false, true}) {
        const auto system = systemOn(streetsWorld(), config);
        const auto at = [&](double time, glm::dvec3 eye) {
            auto report = system->advance({time, {eye, {1, 0, 0, 0}}, {}});
            EXPECT_TRUE(report);
            return std::move(report.value());
        };
        uint64_t need = 0;
        const auto drawn = [&](const server::FrameReport& report) {
            uint64_t sum = 0;
            for (const auto& c : report.cascades) sum += byTriangles ? c.total.triangles : c.total.texels;
            return sum;
        };
        at(0, {-50, 2, -50});
        need = drawn(at(0.1, {50, 2, 50}));
        at(0.2, {-50, 2, -50});
        Budget budget;
        (byTriangles ? budget.triangles : budget.texels) = need / 10;
        ASSERT_TRUE(system->setBudget(budget));
        glm::dvec3 eye(50, 2, 50);
        std::mt19937 rng(5);
        const auto uniform = [&rng](double a, double b) { return a + (b - a) * double(rng()) / 4294967296.0; };
        bool resting = false;
        int fell = 0, judged = 0, shadows = 0;
        for (int frame = 0; !resting || frame < 40; ++frame) {
            ASSERT_LT(frame, 400) << "it never converges";
            if (frame > 12 && frame < 30) eye.x -= 6;  // before all is paid: near texels become unknown anew
            const auto report = at(0.3 + frame / 30.0, eye);
            ASSERT_LE(drawn(report), need / 10) << "frame " << frame;
            EXPECT_EQ(system->verify().value().differing, 0u) << "frame " << frame;
            resting = true;
            for (const auto& c : report.cascades) resting = resting && c.unknownTexels + c.staleTexels == 0;
            std::vector<glm::dvec3> points;
            for (int i = 0; i < 60; ++i)
                points.push_back(eye + glm::dvec3(uniform(-25, 25), -1.98, uniform(-25, 25)));
            const auto answers = system->lookup(points).value();
            for (size_t i = 0; i < points.size(); ++i) {
                if (answers[i].light == Light::kUnknown || answers[i].stale) continue;
                const server::CascadeView view = system->view(answers[i].cascade);
                fell += answers[i].fell;
                // A texel speaks for the ray through its centre; judged where no caster's edge is near it.
                const server::LookupBias bias;
                const glm::dvec3 pLight = view.lightFromWorld * points[i];
                const glm::dvec2 centre = (glm::floor(glm::dvec2(pLight) / view.texel) + 0.5) * view.texel;
                int dark = 0;
                for (const glm::dvec2 d : {glm::dvec2(0), glm::dvec2(1, 0), glm::dvec2(-1, 0), glm::dvec2(0, 1), glm::dvec2(0, -1)}) {
                    const glm::dvec3 from(centre + d * 0.05 * view.texel, pLight.z);
                    dark += tests::farthestCaster(rays, glm::transpose(view.lightFromWorld) * from, -system->config().sun) >
                            bias.texels * view.texel + bias.metres;
                }
                if (dark != 0 && dark != 5) continue;
                ++judged;
                shadows += dark == 5;
                EXPECT_EQ(answers[i].light, dark == 5 ? Light::kShadowed : Light::kLit)
                    << "frame " << frame << ", cascade " << int(answers[i].cascade);
            }
        }
        EXPECT_GT(fell, 10) << "lookups that a coarser cascade answered";
        EXPECT_GT(judged, 1000);
        EXPECT_GT(shadows, 100);
    }
    tests::expectSilence();
}

TEST(LiveWorld, SkyInViewPutsCascadesToSleep) {
    const auto system = systemOn(streetsWorld(), lifeConfig());
    const glm::dquat up = glm::angleAxis(1.4, glm::dvec3(1, 0, 0));
    server::FrameInput input{0, {{0, 40, 0}, up, 0.5, 1.5}, {}};
    const auto sky = system->advance(input).value();
    for (const auto& c : sky.cascades) EXPECT_TRUE(c.asleep);
    EXPECT_FALSE(system->view(0).drawn);
    EXPECT_EQ(system->verify().value().differing, 0u);
    const glm::dvec3 points[] = {{0, 0, 0}};
    EXPECT_EQ(system->lookup(points).value()[0].light, Light::kUnknown);
    input.time = 1;
    input.camera.orientation = glm::angleAxis(-1.5, glm::dvec3(1, 0, 0));  // at the ground, 40 m below
    const auto down = system->advance(input).value();
    EXPECT_TRUE(down.cascades[0].asleep) << "the first cascade ends above the ground";
    EXPECT_FALSE(down.cascades[2].asleep);
    EXPECT_GT(down.cascades[2].total.triangles, 0u);
    EXPECT_NE(system->lookup(points).value()[0].light, Light::kUnknown);
    input.camera.verticalFov = 0;
    const auto anywhere = system->advance(input).value();
    for (const auto& c : anywhere.cascades) EXPECT_FALSE(c.asleep);
    EXPECT_EQ(system->verify().value().stale, 0u);
}

TEST(LiveWorld, ObjectsThatDeformDirtyTheirMargin) {
    const auto system = systemOn(streetsWorld(), lifeConfig());
    const server::ObjectId id =
        system->spawn(0, tests::placedAt({0, 2, 0}), {.deforms = true, .margin = 2}).value();
    const server::ObjectId plain = system->spawn(0, tests::placedAt({10, 2, 0})).value();
    const auto frame = [&](double time, std::vector<server::ObjectUpdate> updates) {
        return system->advance({time, {{0, 2, 0}, {1, 0, 0, 0}}, updates}).value();
    };
    frame(0, {});
    const auto still = frame(0.1, {{plain, tests::placedAt({10, 2, 0})}});
    EXPECT_EQ(still.cascades[0].active.texels, 0u) << "an update without a change";
    const auto deformed = frame(0.2, {{id, tests::placedAt({0, 2, 0})}});
    const double texel = system->view(0).texel;
    EXPECT_GT(double(deformed.cascades[0].active.texels) * texel * texel, 5.0 * 4.0) << "5 m by about 4 m under this sun";
    // It never comes to rest; the other one does.
    uint64_t promoted = 0;
    for (int i = 0; i < 30; ++i) {
        const auto report = frame(1 + i, {});
        for (const auto& c : report.cascades) promoted += c.byCause[size_t(cache::Cause::kPromotion)].casters;
    }
    EXPECT_LE(promoted, 3u * 4) << "one object, once in each piece of three wrapped maps";
    EXPECT_GT(promoted, 0u);
    EXPECT_EQ(system->verify().value().differing, 0u);
}

TEST(LiveWorld, AHundredThatStopTogetherAreTakenInTurn) {
    ShadowConfig config = lifeConfig();
    config.promotionsPerFrame = 7;
    const auto system = systemOn(streetsWorld(), config);
    for (int i = 0; i < 100; ++i)
        ASSERT_TRUE(system->spawn(0, tests::placedAt({double(i % 10) * 2 - 10, 1, double(i / 10) * 2 - 10})));
    std::vector<uint64_t> arrivals;
    for (int frame = 0; frame < 60; ++frame) {
        const auto report = system->advance({frame / 30.0, {{0, 2, 0}, {1, 0, 0, 0}}, {}}).value();
        arrivals.push_back(report.cascades[2].byCause[size_t(cache::Cause::kPromotion)].casters);
    }
    uint64_t all = 0;
    for (uint64_t a : arrivals) {
        EXPECT_LE(a, 7u * 4) << "each at most once in each piece of the wrapped map";
        all += a;
    }
    EXPECT_GE(all, 90u);
    EXPECT_EQ(system->verify().value().differing, 0u);
}

TEST(LiveWorld, BadItemsChangeNothing) {
    const auto system = systemOn(streetsWorld(), lifeConfig());
    const double nan = std::nan("");
    const server::ObjectId box = system->spawn(0, tests::placedAt({1, 1, 1})).value();
    const server::FrameInput input{0, {{0, 2, 0}, {1, 0, 0, 0}}, {}};
    ASSERT_TRUE(system->advance(input));
    const auto hash = [&] { return system->mapHash(0, gpu::MapKind::kWorking).value(); };
    const uint64_t before = hash();
    using world::ErrorCode;
    const auto code = [](const auto& result) { return result ? std::string("none") : std::to_string(int(result.error().code)) + result.error().what; };
    const auto expect = [&](const std::string& got, ErrorCode code_, const std::string& word) {
        EXPECT_EQ(got.substr(0, 1), std::to_string(int(code_))) << got;
        EXPECT_NE(got.find(word), std::string::npos) << got;
    };
    expect(code(system->spawn(9999, tests::placedAt({0, 0, 0}))), ErrorCode::kNotFound, "mesh 9999");
    expect(code(system->spawn(0, tests::placedAt({nan, 0, 0}))), ErrorCode::kUsage, "finite");
    expect(code(system->spawn(0, tests::placedAt({0, 0, 0}, 1e12))), ErrorCode::kLimit, "1e8 m");
    expect(code(system->spawn(0, tests::placedAt({0, 0, 0}), {.margin = -1})), ErrorCode::kUsage, "margin");
    expect(code(system->spawn(0, tests::placedAt({0, 0, 0}), {.deforms = true, .atRest = true})), ErrorCode::kUsage, "deforms");
    expect(code(system->remove(77)), ErrorCode::kNotFound, "object 77");
    expect(code(system->setBudget({.texels = 0})), ErrorCode::kUsage, "budget");
    expect(code(system->setBudget({.ms = -3})), ErrorCode::kUsage, "budget");
    expect(code(system->setBudget({.ms = nan})), ErrorCode::kUsage, "budget");
    const server::ObjectUpdate updates[] = {{box, tests::placedAt({0, INFINITY, 0})},
                                            {box, tests::placedAt({0, 0, 3e9})},
                                            {box + 1, tests::placedAt({0, 0, 0})}};
    auto report = system->advance({0.1, input.camera, updates});
    ASSERT_TRUE(report);
    ASSERT_EQ(report.value().errors.size(), 3u);
    EXPECT_EQ(hash(), before);
    EXPECT_FALSE(system->advance({0.2, {{0, 2, 0}, {1, 0, 0, 0}, -1, 1}, {}}));
    EXPECT_FALSE(system->advance({0.2, {{0, 2, 0}, {1, 0, 0, 0}, 1, 0}, {}}));
    EXPECT_EQ(hash(), before);

    ASSERT_TRUE(system->remove(box));
    expect(code(system->remove(box)), ErrorCode::kNotFound, "removed");
    const server::ObjectUpdate late[] = {{box, tests::placedAt({5, 1, 5})}};
    report = system->advance({0.3, input.camera, late});
    ASSERT_EQ(report.value().errors.size(), 1u);
    EXPECT_NE(report.value().errors[0].what.find("removed"), std::string::npos);
    expect(code(system->remove(box + 1)), ErrorCode::kNotFound, "none of that number");
    EXPECT_NE(hash(), before) << "the box is gone";
    EXPECT_EQ(system->verify().value().differing, 0u);
    // Larger than the world, and served all the same.
    ASSERT_TRUE(system->spawn(0, tests::placedAt({0, 30, 0}, 2000), {.atRest = true}));
    ASSERT_TRUE(system->advance({0.4, input.camera, {}}));
    EXPECT_EQ(system->verify().value().differing, 0u);
}

TEST(LiveWorld, WhatDoesNotFitOnTheGpuIsRefusedWithoutATrace) {
    world::BakeSource source = tests::streets(glm::dvec3(0));
    world::Mesh large = tests::sheetMesh(9, 100);  // 20,000 triangles, 360 kB
    large.levels[0].clusters.clear();
    source.meshes.push_back(std::move(large));
    const auto mesh = uint32_t(source.meshes.size() - 1);
    const world::WorldStore store = tests::baked(source, "full.world");
    ShadowConfig config = lifeConfig();
    config.geometryBytes = 64 << 10;
    const auto made = ShadowSystem::create(tests::validatedDevice(), store, config);
    ASSERT_TRUE(made) << made.error().what;
    ShadowSystem& system = *made.value();
    const server::FrameInput input{0, {{3, 2, 1}, {1, 0, 0, 0}}, {}};
    ASSERT_TRUE(system.advance(input));
    for (const bool atRest : {false, true}) {
        const auto object = system.spawn(mesh, tests::placedAt({3, 3, 1}), {.atRest = atRest});
        ASSERT_FALSE(object);
        EXPECT_EQ(object.error().code, world::ErrorCode::kLimit) << object.error().what;
        const auto report = system.advance(input);
        ASSERT_TRUE(report) << report.error().what;
        EXPECT_FALSE(report.value().submitted);
        EXPECT_EQ(system.verify().value().differing, 0u);
    }
    ASSERT_TRUE(system.spawn(0, tests::placedAt({3, 3, 1}))) << "smaller ones still fit";
    EXPECT_TRUE(system.advance(input).value().submitted);
    EXPECT_EQ(system.verify().value().differing, 0u);
}

}  // namespace
