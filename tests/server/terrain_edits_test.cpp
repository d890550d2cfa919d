// Terrain edits in a running system: exact after each, drawn only where they changed something, in agreement with rays,
// and with the chunk whenever it comes again.
#include "server/terrain_edits.h"

#include <sys/resource.h>
#include <tbb/global_control.h>

#include <csignal>
#include <limits>
#include <random>

#include "tests/server/rays.h"
#include "tests/server/worlds.h"
#include "tests/world/hills_world.h"

namespace {

using cache::Cause;
using server::FrameReport;
using server::Light;
using server::ShadowConfig;
using server::ShadowSystem;
using tests::systemOn;
using world::Capsule;
using world::EditKind;
using world::Sphere;
using world::TerrainEdit;

constexpr int kChunks = 5;
constexpr int32_t kSide = 32;
constexpr double kVoxel = 2, kEdge = kSide * kVoxel;
const glm::dvec3 kMiddle(160, 10, 160);

ShadowConfig editConfig() {
    ShadowConfig config;
    config.cascades = 3;
    config.side = 128;
    config.farDistance = 60;
    config.geometryBytes = 64 << 20;
    return config;
}

const std::string& hillsPath() {
    static const std::string path = [] {
        (void)tests::baked(world::test::hillsWorld(kChunks, kSide, kVoxel), "edits_hills.world");
        return tests::temporary("edits_hills.world");
    }();
    return path;
}

const world::WorldStore& hills() {
    static const world::WorldStore store = std::move(world::WorldStore::open(hillsPath()).value());
    return store;
}

FrameReport frame(ShadowSystem& system, glm::dvec3 eye, glm::dvec3 sun = glm::dvec3(0)) {
    server::FrameInput input;
    input.camera.position = eye;
    input.sun = sun;
    auto report = system.advance(input);
    if (!report) throw std::runtime_error(report.error().what);
    for (const world::Error& error : report.value().errors) ADD_FAILURE() << error.what;
    return report.value();
}

uint64_t differing(ShadowSystem& system) {
    auto report = system.verify();
    if (!report) throw std::runtime_error(report.error().what);
    EXPECT_GT(report.value().texels, 0u);
    return report.value().differing;
}

uint64_t texelsOf(const FrameReport& report, Cause cause) {
    uint64_t texels = 0;
    for (const cache::CascadeStatistics& c : report.cascades) texels += c.byCause[size_t(cause)].texels;
    return texels;
}

uint64_t staticTexels(const FrameReport& report) {
    uint64_t texels = 0;
    for (const cache::CascadeStatistics& c : report.cascades) texels += c.total.texels;
    return texels;
}

/// Seeded edits of the ground within `reach` [m] of `around`.
class Edits {
public:
    Edits(glm::dvec3 around, double reach, uint32_t seed) : around_(around), reach_(reach), rng_(seed) {}
    TerrainEdit next() {
        glm::dvec3 p;
        do p = around_ + glm::dvec3(uniform(-reach_, reach_), uniform(-35, 15), uniform(-reach_, reach_));
        while (std::abs(world::test::hillsWithCave(p)) > 4);
        const glm::dvec3 half(uniform(1, 6), uniform(1, 6), uniform(1, 6));
        TerrainEdit edit{rng_() % 2 ? EditKind::kDig : EditKind::kFill, Sphere{p, uniform(1, 8)}};
        if (rng_() % 3 == 0) edit.shape = world::Box{p - half, p + half};
        if (rng_() % 3 == 0) edit.shape = Capsule{p - half, p + half, uniform(1, 4)};
        return edit;
    }

private:
    double uniform(double a, double b) { return a + (b - a) * double(rng_()) / 4294967296.0; }
    glm::dvec3 around_;
    double reach_;
    std::mt19937 rng_;
};

/// Inside a hill: a cave and points on its floor.
const glm::dvec3 kCave(250, -4, 170);
std::vector<glm::dvec3> cavePoints() {
    std::vector<glm::dvec3> points;
    for (double x = -12; x <= 12; x += 1.5)
        for (double z = -2.5; z <= 2.5; z += 1.25) points.push_back(kCave + glm::dvec3(x, -2.5, z));
    return points;
}

/// What rays say of the points, where all around a point agree; else kUnknown.
std::vector<Light> truth(const world::WorldStore& store, const std::vector<glm::dvec3>& points) {
    const tests::WorldTriangles triangles = tests::terrainTrianglesOf(store);
    const glm::dvec3 toSun = -store.header().sun;
    std::vector<Light> answers;
    for (const glm::dvec3 p : points) {
        int shadowed = 0;
        for (const glm::dvec2 d : {glm::dvec2(0), glm::dvec2(2, 0), glm::dvec2(-2, 0), glm::dvec2(0, 2), glm::dvec2(0, -2)})
            shadowed += tests::shadowed(triangles, p + glm::dvec3(d.x, 0, d.y), toSun);
        answers.push_back(shadowed == 5 ? Light::kShadowed : shadowed == 0 ? Light::kLit : Light::kUnknown);
    }
    return answers;
}

TEST(TerrainEdits, OpenACaveToTheLight) {
    const std::string path = tests::temporary("edits_cave.world");
    std::filesystem::copy_file(hillsPath(), path);
    auto editor = world::WorldEditor::open(path);
    auto store = world::WorldStore::open(path);
    ASSERT_TRUE(editor && store);
    const auto system = systemOn(store.value(), editConfig(), &editor.value());
    const std::vector<glm::dvec3> points = cavePoints();
    const TerrainEdit edits[] = {
        {EditKind::kDig, Capsule{kCave - glm::dvec3(14, 0, 0), kCave + glm::dvec3(14, 0, 0), 5}},
        {EditKind::kDig, Capsule{kCave, kCave - store.value().header().sun * 40.0, 4}},  // a shaft along the light
        {EditKind::kFill, Sphere{kCave - store.value().header().sun * 16.0, 7}},         // a plug in it
    };
    const auto lit = [&]() -> size_t {
        const std::vector<Light> expected = truth(store.value(), points);
        const auto answers = system->lookup(points);
        EXPECT_TRUE(answers);
        size_t sure = 0, found = 0;
        for (size_t i = 0; i < points.size(); ++i) {
            if (expected[i] == Light::kUnknown) continue;
            ++sure;
            found += expected[i] == Light::kLit;
            EXPECT_EQ(answers.value()[i].light, expected[i]) << "point " << i;
        }
        EXPECT_GT(sure, points.size() / 2);
        EXPECT_EQ(differing(*system), 0u);
        return found;
    };
    frame(*system, kCave);
    for (size_t n = 0; n < 3; ++n) {
        ASSERT_TRUE(system->edit(edits[n]));
        EXPECT_EQ(frame(*system, kCave).edits, 1u);
        const size_t seen = lit();
        EXPECT_TRUE(n == 1 ? seen > 5 : seen == 0) << seen << " points are lit after edit " << n;
    }
    tests::expectSilence();
}

TEST(TerrainEdits, AreExactAndCostWhatTheyChange) {
    ShadowConfig config = editConfig();
    const auto system = systemOn(hills(), config);
    culling::SpotLight lamp;
    lamp.position = kMiddle + glm::dvec3(5, 25, 0);
    lamp.direction = {0, -1, 0};
    lamp.halfAngle = 0.7;
    lamp.range = 60;
    lamp.side = 64;
    ASSERT_TRUE(system->addSpot(lamp));
    frame(*system, kMiddle);
    const auto whole = uint64_t(config.cascades) * uint64_t(config.side) * uint64_t(config.side);
    Edits edits(kMiddle, 50, 11);
    uint64_t drawn = 0, lamps = 0;
    for (int n = 0; n < 40; ++n) {
        ASSERT_TRUE(system->edit(edits.next()));
        const FrameReport report = frame(*system, kMiddle);
        EXPECT_EQ(report.edits, 1u);
        EXPECT_EQ(texelsOf(report, Cause::kEdit), staticTexels(report)) << "nothing else happened";
        EXPECT_EQ(report.chunkArrivals + report.chunkDepartures, 0u);
        drawn += texelsOf(report, Cause::kEdit);
        lamps += report.spots[0].cost.statics.texels > 0 && report.spots[0].cost.cause == Cause::kEdit;
        ASSERT_EQ(differing(*system), 0u) << "edit " << n;
    }
    EXPECT_GT(drawn, 0u);
    EXPECT_LT(drawn, 40 * whole / 4) << "on average";
    EXPECT_GT(lamps, 5u);
    // In the air, and so far off that no map sees it: nothing.
    ASSERT_TRUE(system->edit({EditKind::kDig, Sphere{kMiddle + glm::dvec3(0, 60, 0), 5}}));
    ASSERT_TRUE(system->edit({EditKind::kDig, Sphere{{20, 10, 300}, 5}}));
    const FrameReport idle = frame(*system, kMiddle);
    EXPECT_EQ(idle.edits, 2u);
    EXPECT_FALSE(idle.submitted);
    EXPECT_FALSE(frame(*system, kMiddle).submitted);
    tests::expectSilence();
}

TEST(TerrainEdits, StayExactWithBudgetsSleepersAndAMovingSun) {
    ShadowConfig config = editConfig();
    config.movingSun = true;
    const auto system = systemOn(hills(), config);
    Edits edits(kMiddle, 60, 12);
    std::mt19937 rng(13);
    double turn = 1;
    uint64_t owed = 0;
    for (int n = 0; n < 150; ++n) {
        server::FrameInput input;
        input.time = n / 30.0;
        input.camera.position = kMiddle + glm::dvec3(20 * std::sin(n / 20.0), 0, n / 4.0);
        if (n % 50 > 25) input.camera.verticalFov = 0.9;
        turn += n % 60 < 30 ? 0.002 : 0;
        input.sun = glm::normalize(glm::dvec3(std::cos(turn), -1, std::sin(turn)));
        server::Budget budget;
        if (n % 40 > 10) budget.texels = 3000;
        ASSERT_TRUE(system->setBudget(budget));
        for (uint32_t k = rng() % 3; k > 0 && n > 2; --k) ASSERT_TRUE(system->edit(edits.next()));
        auto report = system->advance(input);
        ASSERT_TRUE(report) << report.error().what;
        for (const auto& c : report.value().cascades) owed += c.staleTexels;
        if (n % 3 == 0) {
            ASSERT_EQ(differing(*system), 0u) << "frame " << n;
        }
    }
    EXPECT_GT(owed, 0u);
    tests::expectSilence();
}

TEST(TerrainEdits, ADeafEditIsSeen) {
    ShadowConfig config = editConfig();
    config.sabotage = cache::Sabotage::kDeafDeparture;
    const auto system = systemOn(hills(), config);
    frame(*system, kMiddle);
    ASSERT_EQ(differing(*system), 0u);
    ASSERT_TRUE(system->edit({EditKind::kFill, Sphere{kMiddle, 12}}));
    frame(*system, kMiddle);
    EXPECT_GT(differing(*system), 0u);
    tests::expectSilence();
}

TEST(TerrainEdits, TakeDownWhatTheOldGroundProved) {
    ShadowConfig config = editConfig();
    // What lies buried in the middle of a chunk comes to light.
    const glm::dvec3 middle(2.5 * kEdge, 0, 2.5 * kEdge);
    const world::Chunk chunk = hills().readChunk({2, 0, 2}).value();
    const glm::dvec3 buried = chunk.instances[1].placement.translation;
    for (const bool sticky : {false, true}) {
        if (sticky) config.sabotage = cache::Sabotage::kStickyCertificate;
        const auto system = systemOn(hills(), config);
        while (frame(*system, middle).rays > 0) {  // a frame has its share of the search
        }
        ASSERT_EQ(differing(*system), 0u);
        ASSERT_TRUE(system->edit({EditKind::kDig, Sphere{buried + glm::dvec3(0, 10, 0), 11}}));
        EXPECT_EQ(frame(*system, middle).revocations > 0, !sticky);
        EXPECT_EQ(differing(*system) > 0, sticky);
    }
    tests::expectSilence();
}

TEST(TerrainEdits, ComeAgainWithTheirChunk) {
    ShadowConfig config = editConfig();
    config.farDistance = 20;  // so that chunks come and go
    const std::string path = tests::temporary("edits_again.world");
    std::filesystem::copy_file(hillsPath(), path);
    for (const bool written : {false, true}) {
        auto store = world::WorldStore::open(path);
        ASSERT_TRUE(store);
        std::optional<world::WorldEditor> editor;
        if (written) editor.emplace(std::move(world::WorldEditor::open(path).value()));
        const glm::dvec3 here(70, 10, 70), away(300, 10, 300);
        const TerrainEdit edit{EditKind::kDig, Sphere{here - glm::dvec3(0, 12, 0), 9}};  // within the world's bounds
        const auto hashes = [&](ShadowSystem& system) {
            std::vector<uint64_t> all;
            for (int c = 0; c < config.cascades; ++c) all.push_back(system.mapHash(c, gpu::MapKind::kCache).value());
            return all;
        };
        const auto make_ = [&] { return systemOn(store.value(), config, editor ? &*editor : nullptr); };
        std::vector<uint64_t> unedited, expected;
        {
            const auto system = systemOn(store.value(), config);
            frame(*system, here);
            unedited = hashes(*system);
            ASSERT_TRUE(system->edit(edit));
            frame(*system, here);
            expected = hashes(*system);
            EXPECT_NE(expected, unedited);
        }
        // While the chunk is in memory; while it is not, but was; before it ever was.
        for (const int when : {0, 1, 2}) {
            if (written && when > 0) break;  // the file has it now
            const auto system = make_();
            if (when < 2) frame(*system, here);
            if (when == 0) {
                ASSERT_TRUE(system->edit(edit));
                frame(*system, here);
            }
            EXPECT_GT(frame(*system, away).chunkArrivals, 0u);
            if (when > 0) {
                ASSERT_TRUE(system->edit(edit));
            }
            EXPECT_GT(frame(*system, here).chunkArrivals, 0u);
            EXPECT_EQ(hashes(*system), expected) << "case " << when;
            EXPECT_EQ(differing(*system), 0u);
        }
        if (!written) continue;
        // And in the next life of the world.
        const auto reopened = world::WorldStore::open(path);
        ASSERT_TRUE(reopened);
        const auto system = systemOn(reopened.value(), config);
        frame(*system, here);
        EXPECT_EQ(hashes(*system), expected);
        for (const world::Error& finding : reopened.value().check()) ADD_FAILURE() << finding.what;
    }
    tests::expectSilence();
}

TEST(TerrainEdits, CallInAChunkThatGrewIntoTheLight) {
    ShadowConfig config = editConfig();
    config.farDistance = 20;
    config.sun = glm::normalize(glm::dvec3(1, -0.25, 0));
    const auto system = systemOn(hills(), config);
    // The light that reaches the eye passes 67 m above the tower's foot, where nothing was that high.
    const glm::dvec3 eye(300, 0, 160), foot(32, 0, 160);
    EXPECT_GT(frame(*system, eye).chunkArrivals, 0u);
    EXPECT_EQ(frame(*system, eye).chunkArrivals, 0u);
    ASSERT_TRUE(system->edit({EditKind::kFill, Capsule{foot, foot + glm::dvec3(0, 54, 0), 4}}));
    EXPECT_EQ(frame(*system, eye).chunkArrivals, 1u);
    EXPECT_EQ(differing(*system), 0u);
    tests::expectSilence();
}

TEST(TerrainEdits, GiveTheSamePlansOnAnyNumberOfThreads) {
    std::vector<uint64_t> expected;
    for (const size_t threads : {1, 2, 7}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        const auto system = systemOn(hills(), editConfig());
        Edits edits(kMiddle, 50, 14);
        std::vector<uint64_t> hashes;
        for (int n = 0; n < 12; ++n) {
            for (int k = n % 4; k > 0; --k) ASSERT_TRUE(system->edit(edits.next()));
            hashes.push_back(frame(*system, kMiddle + glm::dvec3(n, 0, 0)).planHash);
            hashes.push_back(system->mapHash(1, gpu::MapKind::kCache).value());
        }
        if (expected.empty()) expected = hashes;
        EXPECT_EQ(hashes, expected) << threads << " threads";
    }
    tests::expectSilence();
}

TEST(TerrainEdits, BadOnesAreRefusedAtOnce) {
    const auto system = systemOn(hills(), editConfig());
    frame(*system, kMiddle);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const auto code = [&](const TerrainEdit& edit) {
        const auto done = system->edit(edit);
        EXPECT_FALSE(done);
        return done.error().code;
    };
    EXPECT_EQ(code({EditKind::kDig, Sphere{{nan, 0, 0}, 1}}), world::ErrorCode::kUsage);
    EXPECT_EQ(code({EditKind::kDig, Sphere{kMiddle, -1}}), world::ErrorCode::kUsage);
    EXPECT_EQ(code({EditKind::kDig, Sphere{kMiddle, kEdge}}), world::ErrorCode::kLimit);
    EXPECT_EQ(code({EditKind::kDig, Sphere{{-500, 0, 0}, 1}}), world::ErrorCode::kNotFound);
    const FrameReport report = frame(*system, kMiddle);
    EXPECT_EQ(report.edits, 0u);
    EXPECT_FALSE(report.submitted);
    tests::expectSilence();
}

TEST(TerrainEdits, AnEditThatCannotBeWrittenChangesNothing) {
    const std::string path = tests::temporary("edits_full.world");
    std::filesystem::copy_file(hillsPath(), path);
    auto editor = world::WorldEditor::open(path);
    auto store = world::WorldStore::open(path);
    ASSERT_TRUE(editor && store);
    const auto system = systemOn(store.value(), editConfig(), &editor.value());
    frame(*system, kMiddle);
    rlimit old{};
    ::getrlimit(RLIMIT_FSIZE, &old);
    const auto handler = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit none{0, old.rlim_max};  // a full disk
    ::setrlimit(RLIMIT_FSIZE, &none);
    ASSERT_TRUE(system->edit({EditKind::kFill, Sphere{kMiddle, 12}}));
    const auto report = system->advance({0, {kMiddle, {1, 0, 0, 0}}, {}});
    ::setrlimit(RLIMIT_FSIZE, &old);
    std::signal(SIGXFSZ, handler);
    ASSERT_TRUE(report);
    ASSERT_EQ(report.value().errors.size(), 1u);
    EXPECT_EQ(report.value().errors[0].code, world::ErrorCode::kIo);
    EXPECT_EQ(report.value().edits, 0u);
    EXPECT_FALSE(report.value().submitted) << "the ground is as it was";
    ASSERT_TRUE(system->edit({EditKind::kFill, Sphere{kMiddle, 12}}));
    EXPECT_GT(texelsOf(frame(*system, kMiddle), Cause::kEdit), 0u);
    EXPECT_EQ(differing(*system), 0u);
    tests::expectSilence();
}

TEST(TerrainEdits, CountToTheMemoryBudget) {
    uint64_t need = 0;
    {
        const auto roomy = systemOn(hills(), editConfig());
        need = frame(*roomy, kMiddle).residentBytes;
    }
    ShadowConfig config = editConfig();
    config.residentBytes = need + need / 2;  // what is there must shrink
    const auto system = systemOn(hills(), config);
    frame(*system, kMiddle);
    Edits edits(kMiddle, 150, 5);
    std::vector<world::Error> errors;
    uint64_t most = 0, made = 0;
    for (int i = 0; i < 60 && errors.empty(); ++i) {
        ASSERT_TRUE(system->edit(edits.next()));
        server::FrameInput input;
        input.camera.position = kMiddle;
        const FrameReport report = system->advance(input).value();
        most = std::max(most, report.residentBytes);
        made += report.edits;
        errors = report.errors;
        ASSERT_LE(report.residentBytes, config.residentBytes);
        if (i % 5 == 0 || !errors.empty()) {
            ASSERT_EQ(differing(*system), 0u) << "edit " << i;
        }
    }
    ASSERT_EQ(errors.size(), 1u) << "after " << made << " edits " << most << " of " << config.residentBytes << " bytes";
    EXPECT_EQ(errors[0].code, world::ErrorCode::kLimit);
    EXPECT_NE(errors[0].what.find("raise --memory-budget"), std::string::npos) << errors[0].what;
    EXPECT_GT(made, 2u);
    EXPECT_GT(most, need) << "what was edited counts";
    const FrameReport still = frame(*system, kMiddle);
    EXPECT_EQ(staticTexels(still), 0u) << "an edit that failed changed nothing";
    tests::expectSilence();
}

}  // namespace
