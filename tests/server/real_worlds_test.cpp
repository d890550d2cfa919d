// Real worlds and recorded paths: exact, and each deliberate defect seen there.
#include <filesystem>
#include <optional>

#include "culling/light_space.h"
#include "tests/server/worlds.h"
#include "tools/mover_feed.h"
#include "tools/replay.h"
#include "world/dem.h"
#include "world/gltf.h"
#include "world/movers.h"
#include "world/path.h"
#include "world/procedural.h"
#include "world/procedural_path.h"

namespace {

namespace fs = std::filesystem;
using server::ShadowConfig;
using server::ShadowSystem;

const std::string kData = std::string(GNOMON_SOURCE_DIR) + "/../shared/data/";

struct Outcome {
    uint64_t verified = 0, differing = 0, hidden = 0;
    std::vector<uint64_t> hashes;  ///< of both maps of every cascade, on verified frames
};

/// Plays frames [begin, end) of a path, verifying every `every`-th, until a difference shows.
Outcome play(const world::WorldStore& store, const ShadowConfig& config, const std::vector<world::Pose>& path,
             const std::vector<world::MoverTrack>& tracks, size_t begin, size_t end, uint64_t every) {
    auto system = ShadowSystem::create(tests::validatedDevice(), store, config);
    if (!system) throw std::runtime_error(system.error().what);
    auto feed = tools::MoverFeed::create(*system.value(), tracks);
    if (!feed) throw std::runtime_error(feed.error().what);
    Outcome outcome;
    tools::ReplayInput input;
    input.poses.assign(path.begin() + std::ptrdiff_t(begin), path.begin() + std::ptrdiff_t(end));
    input.firstNumber = begin;
    input.verifyEvery = every;
    const auto done = tools::replay(*system.value(), input, &feed.value(), nullptr,
                                    [&](const tools::ReplayFrame& frame) -> world::Result<world::Done> {
        for (const auto& c : frame.report.cascades) outcome.hidden += c.clustersHidden;
        for (const tools::MapHashes& h : frame.hashes) {
            outcome.hashes.push_back(h.cache);
            outcome.hashes.push_back(h.working);
        }
        if (!frame.verify) return world::Done{};
        ++outcome.verified;
        outcome.differing += frame.verify->differing;
        if (outcome.differing > 0) return world::Error{world::ErrorCode::kBadData, "differs"};
        return world::Done{};
    });
    if (!done && outcome.differing == 0) throw std::runtime_error(done.error().what);
    return outcome;
}

/// Plays with certificates and without: no texel differs from a redraw, nor between the two.
///   returns  clusters hidden
uint64_t expectExact(const world::WorldStore& store, ShadowConfig config, const std::vector<world::Pose>& path,
                     const std::vector<world::MoverTrack>& tracks, size_t begin, size_t end, uint64_t every) {
    const Outcome exact = play(store, config, path, tracks, begin, end, every);
    EXPECT_EQ(exact.differing, 0u);
    EXPECT_GE(exact.verified, (end - begin) / every);
    config.occlusion = false;
    const Outcome off = play(store, config, path, tracks, begin, end, every);
    EXPECT_EQ(off.differing, 0u);
    EXPECT_EQ(off.hidden, 0u);
    EXPECT_EQ(exact.hashes, off.hashes);
    tests::expectSilence();
    return exact.hidden;
}

/// The frame before the longest step of a path: its recorded jump.
size_t longestStep(const std::vector<world::Pose>& path) {
    size_t at = 1;
    for (size_t i = 2; i < path.size(); ++i)
        if (glm::length(path[i].position - path[i - 1].position) >
            glm::length(path[at].position - path[at - 1].position))
            at = i;
    return at;
}

ShadowConfig quick() {
    ShadowConfig config;
    config.side = 512;  // a quarter of the texels of a default map
    config.geometryBytes = 64 << 20;
    return config;
}

class GameWorld : public ::testing::TestWithParam<const char*> {
protected:
    void SetUp() override {
        if (!fs::exists(kData)) GTEST_SKIP() << "no ../shared";
        const std::string name = GetParam(), folder = kData + "stk/" + name;
        store_.emplace(tests::baked(world::openGltf(folder + "/world.glb", {}).value(), name + ".world"));
        path_ = world::readTum(folder + (name == "candela_city" ? "/paths/standard_expert_candela_city.tum"
                                                                : "/paths/challenge_cocoa_temple_novice.tum"))
                    .value();
        tracks_ = world::readMovers(folder + "/movers.csv").value();
    }
    std::optional<world::WorldStore> store_;
    std::vector<world::Pose> path_;
    std::vector<world::MoverTrack> tracks_;
};

TEST_P(GameWorld, IsExactAroundARecordedJump) {
    const size_t jump = longestStep(path_);
    EXPECT_GT(expectExact(*store_, quick(), path_, tracks_, jump - 10, jump + 10, 2), 0u);
}

TEST_P(GameWorld, ShowsEachDefect) {
    // The recorded movers are few and hide nothing: every seventh named caster leaves, a few a frame.
    for (const auto sabotage : {cache::Sabotage::kLiteralScroll, cache::Sabotage::kDeafDeparture,
                                cache::Sabotage::kStickyCertificate}) {
        ShadowConfig config = quick();
        config.sabotage = sabotage;
        const auto system = std::move(ShadowSystem::create(tests::validatedDevice(), *store_, config).value());
        const auto names = store_->names().value();
        std::vector<server::ObjectId> objects;
        for (size_t i = 0; i < names.size(); i += 7) objects.push_back(system->adopt(names[i].name).value());
        bool caught = false;
        for (size_t frame = 0; frame < 60 && !caught; ++frame) {
            std::vector<server::ObjectUpdate> updates;
            for (size_t i = frame; i < objects.size(); i += 60) {
                updates.push_back({objects[i], system->restPlacement(objects[i])});
                updates.back().placement.translation.y += 1000;  // away
            }
            const world::Pose& pose = path_[100 + 2 * frame];
            const auto report = system->advance({pose.time, {pose.position, pose.orientation}, updates});
            ASSERT_TRUE(report) << report.error().what;
            if (frame % 4 == 3) caught = system->verify().value().differing > 0;
        }
        EXPECT_TRUE(caught) << GetParam() << ", sabotage " << int(sabotage);
    }
}

INSTANTIATE_TEST_SUITE_P(Stk, GameWorld, ::testing::Values("candela_city", "cocoa_temple"),
                         [](const auto& world) { return std::string(world.param); });

TEST(Benalla, IsExactInFullUtmCoordinates) {
    if (!fs::exists(kData)) GTEST_SKIP() << "no ../shared";
    const auto path = world::readTum(kData + "benalla/paths/9crx3101.tum").value();
    const size_t begin = 2000;
    const glm::dvec3 p = path[begin].position;
    world::DemOptions options;  // 12 km x 12 km around the place where the replay starts
    options.bounds = {{p.x - 6000, -p.z - 6000, p.x + 6000, -p.z + 6000}};
    const world::WorldStore store =
        tests::baked(world::openDem(kData + "benalla/dem.tif", options).value(), "benalla.world");
    ShadowConfig config = quick();
    config.farDistance = 5000;
    config.sun = culling::sunFromAngles(5.6, 0.1);  // low, so that the hills cast
    expectExact(store, config, path, {}, begin, begin + 30, 3);

    config.sabotage = cache::Sabotage::kLiteralScroll;
    EXPECT_GT(play(store, config, path, {}, begin, begin + 30, 3).differing, 0u);
}

TEST(Procedural, IsExactWithMoversOverDrivingAndTheJump) {
    world::ProceduralOptions options;
    options.size = 1024;
    options.voxel = 4;
    options.instances = 4000;
    const world::WorldStore store = tests::baked(world::openProcedural(7, options).value(), "procedural.world");
    const auto path = world::proceduralPath(7, options);
    const auto tracks = world::proceduralMovers(7, options);
    const size_t jump = longestStep(path);
    ShadowConfig config = quick();
    config.farDistance = 200;
    EXPECT_GT(expectExact(store, config, path, tracks, jump - 20, jump + 10, 3), 0u);

    config.sabotage = cache::Sabotage::kLiteralScroll;
    EXPECT_GT(play(store, config, path, tracks, jump - 20, jump + 10, 3).differing, 0u);
}

}  // namespace
