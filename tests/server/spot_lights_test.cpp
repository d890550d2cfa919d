// Spot lights in a living world: exact in every frame, idle at rest, honest about bad numbers, and in agreement
// with rays.
#include "server/spot_lights.h"

#include <tbb/global_control.h>

#include <array>
#include <bit>
#include <cmath>
#include <random>

#include "tests/server/rays.h"
#include "tests/server/worlds.h"

namespace {

using cache::Cause;
using culling::SpotLight;
using server::FrameReport;
using server::ObjectUpdate;
using server::ShadowConfig;
using server::ShadowSystem;
using tests::streetsWorld;
using tests::systemOn;
using server::SpotAnswer;
using server::SpotId;

ShadowConfig spotConfig() {
    ShadowConfig config;
    config.cascades = 2;
    config.side = 64;
    config.farDistance = 30;
    config.restSeconds = 0.5;
    config.geometryBytes = 16 << 20;
    return config;
}

/// Lamps and boxes that come, go, move, turn and rest around a camera that walks and jumps.
class Life {
public:
    Life(ShadowSystem& system, glm::dvec3 origin, uint32_t seed) : system_(system), origin_(origin), rng_(seed) {}

    FrameReport step() {
        const bool restless = frame_ % 60 < 35;  // then all rest, and turn static
        std::vector<ObjectUpdate> updates;
        if (restless) {
            if (dice(5) == 0 && lights_.size() < 5) lights_.push_back(require(system_.addSpot(lamp(64 << dice(2)))));
            if (dice(25) == 0 && !lights_.empty()) {
                require(system_.removeSpot(lights_.front()));
                lights_.erase(lights_.begin());
            }
            if (dice(6) == 0 && !lights_.empty()) moveOne();
            if (dice(3) == 0 && objects_.size() < 25)
                objects_.push_back(require(system_.spawn(dice(2), somewhere(), {.atRest = dice(2) == 0})));
            if (dice(5) == 0 && !objects_.empty()) {
                require(system_.remove(objects_.front()));
                objects_.erase(objects_.begin());
            }
            for (const server::ObjectId object : objects_)
                if (dice(12) == 0) updates.push_back({object, somewhere()});
            eye_ = origin_ + (frame_ % 20 == 0 ? glm::dvec3(uniform(-60, 60), 2, uniform(-60, 60)) : eye_ - origin_);
        }
        return require(system_.advance({double(frame_++) / 30, {eye_, {1, 0, 0, 0}}, updates}));
    }
    uint64_t moves() const { return moves_; }

private:
    template <class T>
    static T require(world::Result<T> result) {
        if (!result) throw std::runtime_error(result.error().what);
        return std::move(result.value());
    }
    uint32_t dice(uint32_t n) { return uint32_t(rng_()) % n; }
    double uniform(double a, double b) { return a + (b - a) * double(rng_()) / 4294967295.0; }
    world::Placement somewhere() {
        return tests::placedAt(origin_ + glm::dvec3(uniform(-15, 15), uniform(0, 6), uniform(-15, 15)), uniform(0.5, 2));
    }
    SpotLight lamp(int side) {
        return {origin_ + glm::dvec3(uniform(-12, 12), uniform(2, 14), uniform(-12, 12)),
                {uniform(-1, 1), uniform(-1, 0.3), uniform(-1, 1)}, uniform(0.2, 1.3), 0.1, uniform(10, 40), side};
    }
    void moveOne() {
        const SpotId id = lights_[dice(uint32_t(lights_.size()))];
        const SpotLight now = require(system_.viewSpot(id)).space.light;
        SpotLight next = lamp(now.side);
        if (dice(2) == 0) {  // or only turn
            next.position = now.position;
            next.range = now.range;
            next.halfAngle = now.halfAngle;
        }
        require(system_.moveSpot(id, next));
        ++moves_;
    }

    ShadowSystem& system_;
    glm::dvec3 origin_, eye_ = origin_;
    std::mt19937 rng_;
    std::vector<SpotId> lights_;
    std::vector<server::ObjectId> objects_;
    int frame_ = 0;
    uint64_t moves_ = 0;
};

TEST(SpotLights, EveryFrameEqualsARedrawFromScratch) {
    const glm::dvec3 far(1e6, 0, -6.1e6);
    const world::WorldStore distant = tests::baked(tests::streets(far), "far_spots.world");
    for (const bool away : {false, true}) {
        const auto system = systemOn(away ? distant : streetsWorld(), spotConfig());
        Life life(*system, away ? far : glm::dvec3(0), 5);
        std::array<uint64_t, cache::kCauses> redrawn{};
        uint64_t active = 0, idle = 0, texels = 0;
        for (int frame = 0; frame < 250; ++frame) {
            const FrameReport report = life.step();
            ASSERT_TRUE(report.errors.empty()) << report.errors[0].what;
            bool anything = false;
            for (const server::SpotReport& spot : report.spots) {
                if (spot.cost.statics.texels > 0) ++redrawn[size_t(spot.cost.cause)];
                else EXPECT_EQ(spot.cost.statics, cache::Cost{});
                active += spot.cost.active.triangles;
                anything = anything || spot.cost.active.texels > 0;
            }
            EXPECT_TRUE(report.submitted || !anything);
            idle += !anything && !report.spots.empty();
            if (frame % 3 == 0) continue;  // frames may be under way together
            const auto verified = system->verify();
            ASSERT_TRUE(verified) << verified.error().what;
            texels += verified.value().texels;
            ASSERT_EQ(verified.value().differing, 0u) << "frame " << frame << ", spot " << verified.value().first[0].spot;
        }
        for (const Cause cause : {Cause::kStart, Cause::kDeparture, Cause::kDemotion, Cause::kArrival, Cause::kPromotion})
            EXPECT_GT(redrawn[size_t(cause)], 5u) << cache::toString(cause);
        EXPECT_GT(life.moves(), 15u);
        EXPECT_GT(active, 1000u);
        EXPECT_GT(idle, 50u);
        EXPECT_GT(texels, 166u * 2 * 2 * 64 * 64 * 2) << "lights were not compared";
    }
    tests::expectSilence();
}

TEST(SpotLights, ALightThatIsDeafToDeparturesIsCaught) {
    ShadowConfig config = spotConfig();
    config.sabotage = cache::Sabotage::kDeafDeparture;
    const auto system = systemOn(streetsWorld(), config);
    Life life(*system, glm::dvec3(0), 5);
    uint64_t differing = 0;
    for (int frame = 0; frame < 250 && differing == 0; ++frame) {
        life.step();
        const auto report = system->verify().value();
        differing = report.differingSpots;
        EXPECT_GE(report.differing, differing);
    }
    EXPECT_GT(differing, 0u);

    // One box beyond all cascades, and the difference names the map.
    const auto plain = systemOn(streetsWorld(), config);
    const SpotId lamp = plain->addSpot({{-60, 30, -60}, {0, -1, 0}, 0.3, 0.1, 40, 64}).value();
    const auto box = plain->spawn(1, tests::placedAt({-60, 10, -60}), {.atRest = true}).value();
    const server::Camera camera{{0, 2, 0}, {1, 0, 0, 0}};
    ASSERT_TRUE(plain->spawn(1, tests::placedAt({-60, 5, -60}), {.atRest = true}));
    ASSERT_TRUE(plain->advance({0, camera, {}}));
    EXPECT_EQ(plain->verify().value().differing, 0u);
    ASSERT_TRUE(plain->remove(box));
    ASSERT_TRUE(plain->advance({1, camera, {}}));
    const auto report = plain->verify().value();
    EXPECT_GT(report.differingSpots, 0u);
    EXPECT_EQ(report.differingSpots, report.differing);
    ASSERT_EQ(report.first.size(), server::kReported);
    EXPECT_EQ(report.first[0].cascade, -1);
    EXPECT_EQ(report.first[0].spot, lamp);
    EXPECT_EQ(report.first[0].texel / int64_t(20), cache::Texel(1)) << "in the middle of the map";
    EXPECT_LT(report.first[0].cached, report.first[0].redrawn);
    const auto named = [](const server::Difference& d) { return !d.casters.empty(); };
    EXPECT_TRUE(std::any_of(report.first.begin(), report.first.end(), named)) << "what lies under it";
}

TEST(SpotLights, AreTheSameForAnyNumberOfThreads) {
    std::vector<std::vector<uint64_t>> runs;
    for (const size_t threads : {1, 2, 5}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        const auto system = systemOn(streetsWorld(), spotConfig());
        Life life(*system, glm::dvec3(0), 8);
        std::vector<uint64_t> run;
        for (int frame = 0; frame < 80; ++frame) {
            const FrameReport report = life.step();
            for (uint64_t v : {report.planHash, report.bytesUploaded}) run.push_back(v);
            for (const auto& spot : report.spots) {
                const auto map = system->readSpotMap(spot.id, gpu::MapKind::kWorking).value();
                for (const float depth : map) run.push_back(std::bit_cast<uint32_t>(depth));
            }
        }
        runs.push_back(run);
    }
    EXPECT_EQ(runs[0], runs[1]);
    EXPECT_EQ(runs[0], runs[2]);
}

TEST(SpotLights, AnswerLikeRays) {
    const auto system = systemOn(streetsWorld(), spotConfig());
    tests::WorldTriangles triangles = tests::trianglesOf(streetsWorld());
    std::erase_if(triangles, [](auto& t) { return glm::length(t[0]) > 60; });  // farther than any light here shines
    std::mt19937 rng(3);
    const auto uniform = [&rng](double a, double b) { return a + (b - a) * double(rng()) / 4294967295.0; };
    int lit = 0, dark = 0, outside = 0, edges = 0;
    for (int k = 0; k < 6; ++k) {
        const SpotLight light{{uniform(-10, 10), uniform(6, 14), uniform(-10, 10)},
                              {uniform(-0.8, 0.8), -1, uniform(-0.8, 0.8)}, uniform(0.3, 1.0), 0.1, 30, 512};
        const SpotId id = system->addSpot(light).value();
        ASSERT_EQ(system->lookupSpot(id, std::array{light.position}).value()[0], SpotAnswer::kUnknown);
        ASSERT_TRUE(system->advance({k + 0.0, {{0, 2, 0}, {1, 0, 0, 0}}, {}}));
        const culling::SpotSpace space = system->viewSpot(id).value().space;
        std::vector<glm::dvec3> points;
        for (int i = 0; i < 600; ++i) points.emplace_back(uniform(-25, 25), 0.02, uniform(-25, 25));
        const auto answers = system->lookupSpot(id, points).value();
        for (size_t i = 0; i < points.size(); ++i) {
            const glm::dvec3 p = points[i], toPoint = p - light.position;
            const double distance = glm::length(toPoint);
            const double angle = std::acos(glm::dot(toPoint, glm::normalize(light.direction)) / distance);
            const bool inCone = angle < light.halfAngle && distance < light.range;
            // Rounding may move a point across the cone's edge.
            const bool onEdge = std::abs(angle - light.halfAngle) < 1e-9 || std::abs(distance - light.range) < 1e-9;
            ASSERT_TRUE((answers[i] == SpotAnswer::kOutside) == !inCone || onEdge) << "light " << k << ", point " << i;
            if (!inCone) {
                ++outside;
                continue;
            }
            // A texel speaks for the ray through its centre: compare where rays through it and its eight
            // neighbours, stopped short of the point's plane, all say the same. What is nearer than the bias
            // along the axis casts no shadow.
            const glm::dvec3 pLight = space.toLight(p);
            const server::LookupBias bias;
            const double room = bias.texels * space.texelAt(pLight.z) + bias.metres;
            int hits = 0;
            for (int y = -1; y <= 1; ++y)
                for (int x = -1; x <= 1; ++x) {
                    const glm::dvec3 q = pLight + glm::dvec3(x, y, 0) * space.texelAt(pLight.z);
                    const glm::dvec3 ray = glm::transpose(space.lightFromWorld) * (q / q.z);  // by z along the axis
                    bool hit = false;
                    tests::eachHit(triangles, light.position, ray, [&](double z) {
                        hit = hit || (z > light.near && z < pLight.z - room);
                    });
                    hits += hit;
                }
            if (hits != 0 && hits != 9) {
                ++edges;
                continue;
            }
            ASSERT_EQ(answers[i], hits == 9 ? SpotAnswer::kShadowed : SpotAnswer::kLit)
                << "light " << k << ", point " << i << ", " << distance << " m away";
            ++(hits == 9 ? dark : lit);
        }
    }
    EXPECT_GT(lit, 150);
    EXPECT_GT(dark, 100);
    EXPECT_GT(outside, 300);
    EXPECT_LT(edges, (lit + dark) / 3) << "most points must be judged";
    tests::expectSilence();
}

TEST(SpotLights, NothingMovingSubmitsNothing) {
    const auto system = systemOn(streetsWorld(), spotConfig());
    const SpotId lamp = system->addSpot({{0, 9, 0}, {0, -1, 0}, 0.6, 0.1, 30, 128}).value();
    const auto box = system->spawn(0, tests::placedAt({0, 1, 0})).value();
    const auto frame = [&](double time, std::span<const ObjectUpdate> updates) {
        return system->advance({time, {{0, 2, 0}, {1, 0, 0, 0}}, updates}).value();
    };
    const auto costs = [&](const FrameReport& report) {
        EXPECT_EQ(report.spots.size(), 1u);
        EXPECT_EQ(report.spots[0].id, lamp);
        return report.spots[0].cost;
    };
    const auto first = costs(frame(0, {}));
    EXPECT_EQ(first.cause, Cause::kStart);
    EXPECT_GT(first.statics.triangles, 0u);
    EXPECT_EQ(first.active, (cache::Cost{128 * 128, 1, 12, 1}));
    for (int k = 1; k < 5; ++k) {  // the box is active still, and rests
        const FrameReport report = frame(0.05 * k, {});
        EXPECT_FALSE(report.submitted);
        EXPECT_EQ(report.bytesUploaded, 0u);
        EXPECT_EQ(costs(report).statics, cache::Cost{});
        EXPECT_EQ(costs(report).active, cache::Cost{});
    }
    const ObjectUpdate near[] = {{box, tests::placedAt({1, 1, 0})}}, away[] = {{box, tests::placedAt({20, 1, 0})}},
                       farther[] = {{box, tests::placedAt({22, 1, 0})}};
    EXPECT_EQ(costs(frame(0.3, near)).active.triangles, 12u);
    EXPECT_EQ(costs(frame(0.35, away)).active, (cache::Cost{128 * 128, 0, 0, 0})) << "it was in the cone";
    EXPECT_EQ(costs(frame(0.4, farther)).active, cache::Cost{});
    EXPECT_EQ(costs(frame(2, {})).statics, cache::Cost{}) << "it turned static far from the cone";
    EXPECT_EQ(system->verify().value().differing, 0u);

    ASSERT_TRUE(system->removeSpot(lamp));
    EXPECT_TRUE(frame(3, {}).spots.empty());
}

TEST(SpotLights, ARedrawingSystemDrawsThemInEveryFrame) {
    ShadowConfig config = spotConfig();
    config.method = server::Method::kRedraw;
    const auto system = systemOn(streetsWorld(), config);
    ASSERT_TRUE(system->addSpot({{0, 9, 0}, {0, -1, 0}, 0.6, 0.1, 30, 128}));
    for (int frame = 0; frame < 3; ++frame) {
        const auto report = system->advance({frame + 0.0, {{0, 2, 0}, {1, 0, 0, 0}}, {}}).value();
        EXPECT_GT(report.spots[0].cost.statics.triangles, 0u);
        EXPECT_TRUE(report.submitted);
    }
}

TEST(SpotLights, BadNumbersChangeNothing) {
    const auto system = systemOn(streetsWorld(), spotConfig());
    const SpotLight good{{0, 9, 0}, {0, -1, 0}, 0.6, 0.1, 30, 128};
    const server::Camera camera{{0, 2, 0}, {1, 0, 0, 0}};
    const SpotId lamp = system->addSpot(good).value();
    ASSERT_TRUE(system->advance({0, camera, {}}));
    const auto expect = [&](const auto& result, world::ErrorCode code, std::initializer_list<const char*> words) {
        ASSERT_FALSE(result);
        EXPECT_EQ(result.error().code, code) << result.error().what;
        for (const char* word : words) EXPECT_NE(result.error().what.find(word), std::string::npos) << result.error().what;
    };
    using world::ErrorCode;
    SpotLight bad = good;
    bad.position.x = std::nan("");
    expect(system->addSpot(bad), ErrorCode::kUsage, {"new spot light", "position", "give"});
    expect(system->moveSpot(lamp, bad), ErrorCode::kUsage, {"spot light 0", "position", "give"});
    bad = good;
    bad.halfAngle = 1.6;
    expect(system->moveSpot(lamp, bad), ErrorCode::kUsage, {"spot light 0", "half-angle 1.6", "give"});
    bad = good;
    bad.side = 256;
    expect(system->moveSpot(lamp, bad), ErrorCode::kUsage, {"spot light 0", "128", "remove"});
    expect(system->moveSpot(7, good), ErrorCode::kNotFound, {"spot light 7", "add"});
    expect(system->removeSpot(7), ErrorCode::kNotFound, {"spot light 7", "add"});
    expect(system->lookupSpot(7, {}), ErrorCode::kNotFound, {"spot light 7"});
    expect(system->viewSpot(7), ErrorCode::kNotFound, {"spot light 7"});
    expect(system->readSpotMap(7, gpu::MapKind::kCache), ErrorCode::kNotFound, {"spot light 7"});
    EXPECT_FALSE(system->advance({1, camera, {}}).value().submitted) << "one of them left a trace";

    std::vector<SpotId> more;
    for (size_t i = 1; i < server::kMostSpots; ++i) {
        bad = good;
        bad.side = 64;
        more.push_back(system->addSpot(bad).value());
    }
    expect(system->addSpot(good), ErrorCode::kLimit, {"new spot light", "64", "remove"});
    ASSERT_TRUE(system->removeSpot(more[3]));
    expect(system->removeSpot(more[3]), ErrorCode::kNotFound, {"removed"});
    const SpotId another = system->addSpot(good).value();
    EXPECT_EQ(another, more.back() + 1) << "ids are never given twice";
    const auto report = system->advance({2, camera, {}}).value();
    ASSERT_EQ(report.spots.size(), server::kMostSpots);
    for (size_t i = 1; i < report.spots.size(); ++i) EXPECT_LT(report.spots[i - 1].id, report.spots[i].id);
    EXPECT_EQ(system->verify().value().differing, 0u);
    tests::expectSilence();
}

/// Streets whose grounds have a fine level that no cascade of `small` draws.
world::BakeSource fineGrounds() {
    world::BakeSource source = tests::streets(glm::dvec3(0));
    world::Mesh& ground = source.meshes[2];
    ground.levels.insert(ground.levels.begin(), tests::sheetMesh(18, 100).levels[0]);
    ground.levels[0].clusters.clear();
    ground.levels[1].error = 0.1f;
    return source;
}

TEST(SpotLights, LevelsThatOnlyALightDrawsAreUploadedForIt) {
    const world::WorldStore store = tests::baked(fineGrounds(), "fine.world");
    const SpotLight light{{0, 9, 0}, {0, -1, 0}, 0.6, 0.1, 30, 128};
    const server::FrameInput still{0, {{0, 2, 0}, {1, 0, 0, 0}}, {}};
    const uint64_t fine = 100 * 100 * 2 * 3 * sizeof(uint32_t);
    ShadowConfig config = spotConfig();
    const auto system = systemOn(store, config);
    EXPECT_LT(system->advance(still).value().bytesUploaded, fine);
    ASSERT_TRUE(system->addSpot(light));
    const auto report = system->advance(still).value();
    EXPECT_GT(report.bytesUploaded, fine);
    EXPECT_GT(report.spots[0].cost.statics.triangles, 5000u);
    EXPECT_EQ(system->verify().value().differing, 0u);

    config.geometryBytes = fine;  // without its positions
    const auto tight = systemOn(store, config);
    SpotLight higher = light;
    higher.position.y = 29;  // where the coarse level will do
    ASSERT_TRUE(tight->addSpot(higher));
    const SpotId greedy = tight->addSpot(light).value();
    EXPECT_GT(tight->advance(still).value().missingChunks, 0u) << "all levels that a light may ask for are counted";
    ASSERT_TRUE(tight->removeSpot(greedy));
    EXPECT_EQ(tight->verify().value().differing, 0u);
    tests::expectSilence();
}

}  // namespace
