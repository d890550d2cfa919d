// Stored truths: what comes back is what was traced, to the last bit, or it is traced anew.
#include "tools/truth_store.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "tests/toy_scene.h"
#include "tests/world/random_world.h"
#include "world/blob.h"

namespace {

using culling::Sunlight;
using culling::TruthFrame;
using tools::TruthQuestion;
using tools::TruthStore;
using world_tests::TempFolder;

constexpr double kReach = 40, kDisk = 0.05;  // [m], [rad]
constexpr int kDirections = 20;
constexpr uint64_t kKey = 0xfedcba9812345678u, kLater = 7;

template <class T>
T taken(world::Result<T> result) {
    CHECK(result);
    return std::move(result.value());
}

/// A box on the ground, seen by a small camera: with sky, and a point in each state.
struct TracedBox {
    TracedBox() {
        const uint32_t ground = truth->addMesh(tests::sheetMesh(200, 1).levels[0]).value();
        const uint32_t box = truth->addMesh(tests::boxMesh({2, 4, 2}).levels[0]).value();
        CHECK(truth->add(0, ground, {}) && truth->add(1, box, tests::placedAt({0, 2, 0})));
    }
    world::Result<TruthFrame> frame() { return truth->trace(view, 15, 10, kReach, sun); }
    world::Result<std::vector<Sunlight>> revisit(const TruthFrame& before) {
        std::vector<culling::SurfacePoint> points;
        for (size_t i = 0; i < before.states.size(); ++i)
            if (before.states[i] != Sunlight::kSky) points.push_back(surfaceAt(before, i));
        return truth->revisit(points, view, kReach, sun, {});
    }
    std::unique_ptr<culling::Truth> truth = std::move(culling::Truth::create().value());
    const culling::View view{{-6, 3, 6}, glm::angleAxis(-0.8, glm::dvec3(0, 1, 0)), 1, 1.5};
    const glm::dvec3 sun{-0.6, -1, -0.3};
};

template <class T>
std::function<world::Result<T>()> never() {
    return []() -> world::Result<T> {
        ADD_FAILURE() << "traced";
        return T{};
    };
}

TEST(TruthStore, GivesBackWhatWasTraced) {
    const TempFolder folder;
    TracedBox scene;
    const TruthFrame frame = scene.frame().value();
    const std::set<Sunlight> states(frame.states.begin(), frame.states.end());
    ASSERT_EQ(states.size(), 4u) << "a scene without one of the states proves less";
    const std::vector<Sunlight> seen = scene.revisit(frame).value();
    const std::vector<float> shares = scene.truth->sunShares(frame, kDisk, kDirections).value();
    {
        TruthStore store = taken(TruthStore::open(folder.file("truths")));
        EXPECT_EQ(store.frame(kKey, [&] { return scene.frame(); }).value(), frame);
        EXPECT_EQ(store.revisit(kKey, kLater, [&] { return scene.revisit(frame); }).value(), seen);
        const auto disk = [&] { return scene.truth->sunShares(frame, kDisk, kDirections); };
        EXPECT_EQ(store.sunShares(kKey, kDisk, kDirections, disk).value(), shares);
        EXPECT_EQ(store.frame(kKey, never<TruthFrame>()).value(), frame);
        EXPECT_EQ(store.traced(), 3u);
        EXPECT_EQ(store.found(), 1u);
    }
    TruthStore store = taken(TruthStore::open(folder.file("truths")));
    TruthStore other = taken(TruthStore::open(folder.file("truths")));  // two at a time
    EXPECT_EQ(store.frame(kKey, never<TruthFrame>()).value(), frame);
    EXPECT_EQ(other.revisit(kKey, kLater, never<std::vector<Sunlight>>()).value(), seen);
    EXPECT_EQ(store.sunShares(kKey, kDisk, kDirections, never<std::vector<float>>()).value(), shares);
    // Others, that nobody traced yet.
    EXPECT_EQ(store.frame(kLater, [&] { return scene.frame(); }).value(), frame);
    EXPECT_EQ(other.frame(kLater, never<TruthFrame>()).value(), frame);
    for (const auto& [before, after] : {std::pair(kLater, kKey), {kKey, kKey}, {kLater, kLater}})
        EXPECT_EQ(store.revisit(before, after, [&] { return scene.revisit(frame); }).value(), seen);
    for (const auto& [radius, directions] : {std::pair(kDisk, kDirections + 1), {kDisk * 2, kDirections}})
        EXPECT_TRUE(store.sunShares(kKey, radius, directions, [&] { return world::Result(shares); }));
    EXPECT_EQ(store.found(), 2u);
    EXPECT_EQ(store.traced(), 6u);
    EXPECT_TRUE(store.damage().empty());
}

TEST(TruthStore, TracesAnewWhatIsDamagedAndSaysSo) {
    const TempFolder folder;
    TracedBox scene;
    const TruthFrame frame = scene.frame().value();
    TruthStore store = taken(TruthStore::open(folder.file("truths")));
    const auto trace = [&] { return scene.frame(); };
    ASSERT_TRUE(store.frame(kKey, trace));

    world::Database db = taken(world::Database::openEmpty(folder.file("truths")));
    world::BlobKey key;
    std::vector<std::byte> stored, raw;
    {
        world::Statement row = taken(db.prepare("SELECT * FROM blob"));
        ASSERT_TRUE(row.step().value());
        key = {int32_t(row.integer(0)), int32_t(row.integer(1)), int32_t(row.integer(2)), int32_t(row.integer(3)),
               world::BlobKind(row.integer(4))};
        stored.assign(row.bytes(8).begin(), row.bytes(8).end());
        raw = world::unpackBlob(key, row.integer(5), row.integer(6), uint64_t(row.integer(7)), stored).value();
    }
    const auto damaged = [&](const std::string& what) {
        const uint64_t before = store.traced();
        EXPECT_EQ(store.frame(kKey, trace).value(), frame) << what;
        EXPECT_EQ(store.traced(), before + 1) << what;
        ASSERT_EQ(store.damage().size(), before) << what;
        EXPECT_NE(store.damage().back().find("truth fedcba9812345678"), std::string::npos) << store.damage().back();
        EXPECT_EQ(store.frame(kKey, never<TruthFrame>()).value(), frame) << what;
    };
    for (size_t i = 0; i < stored.size(); i += 11) {
        std::vector<std::byte> flipped = stored;
        flipped[i] ^= std::byte(1 << i % 8);
        world::Statement update = taken(db.prepare("UPDATE blob SET data=?"));
        update.bind(0, flipped);
        ASSERT_TRUE(update.step());
        damaged("byte " + std::to_string(i));
    }
    for (const char* change : {"codec=1-codec", "codec=9", "raw_size=raw_size+1", "raw_size=-1", "checksum=checksum+1",
                               "data=''", "data=x'28b52ffd'"}) {
        ASSERT_TRUE(db.run(std::string("UPDATE blob SET ") + change));
        damaged(change);
    }
    // Rows that are well sealed and say too little, or too much, or nonsense.
    const auto sealed = [&](const std::vector<std::byte>& bytes, const std::string& what) {
        const world::PackedBlob blob = world::packBlob(key, bytes).value();
        world::Statement update = taken(db.prepare("UPDATE blob SET codec=?, raw_size=?, checksum=?, data=?"));
        update.bind(0, int64_t(blob.codec));
        update.bind(1, int64_t(blob.rawSize));
        update.bind(2, int64_t(blob.checksum));
        update.bind(3, blob.data);
        ASSERT_TRUE(update.step());
        damaged(what);
    };
    for (size_t length = 0; length < raw.size(); length += length < 80 ? 1 : 97)
        sealed({raw.begin(), raw.begin() + std::ptrdiff_t(length)}, "cut at " + std::to_string(length));
    std::vector<std::byte> longer = raw;
    longer.push_back(std::byte(0));
    sealed(longer, "a byte more");
    const size_t states = 4 + 4 + 24 + 24, pixels = frame.states.size();
    for (const auto& [at, value] : {std::pair(size_t(0), 0xff), {size_t(3), 0x7f}, {size_t(3), 0x80}, {states, 4},
                                    {states + pixels, int(culling::kEdgeSteps) + 1}}) {
        std::vector<std::byte> nonsense = raw;
        nonsense[at] = std::byte(value);
        sealed(nonsense, "byte " + std::to_string(at) + " is " + std::to_string(value));
    }
}

TEST(TruthStore, AnotherQuestionHasAnotherKey) {
    TruthQuestion question{5, {{1, 2, 3}, {1, 0, 0, 0}, 1, 1.5}, 64, 36, 100, {0.1, -1, 0.2}, {{3, {}}, {8, {}}}};
    std::set<uint64_t> keys{tools::keyOf(question)};
    EXPECT_TRUE(keys.contains(tools::keyOf(question)));
    size_t questions = 1;
    const auto with = [&](auto change) {
        TruthQuestion other = question;
        change(other);
        keys.insert(tools::keyOf(other));
        EXPECT_EQ(keys.size(), ++questions) << "question " << questions;
    };
    with([](TruthQuestion& q) { q.world = 6; });
    for (int k = 0; k < 3; ++k) {
        with([&](TruthQuestion& q) { q.view.eye[k] += 1e-9; });
        with([&](TruthQuestion& q) { q.sun[k] += 1e-9; });
        with([&](TruthQuestion& q) { q.moved[1].placement.translation[k] += 1e-9; });
        for (int j = 0; j < 3; ++j) with([&](TruthQuestion& q) { q.moved[1].placement.linear[k][j] += 1e-3f; });
    }
    for (int k = 0; k < 4; ++k) with([&](TruthQuestion& q) { q.view.orientation[k] += 1e-9; });
    with([](TruthQuestion& q) { q.view.verticalFov += 1e-9; });
    with([](TruthQuestion& q) { q.view.aspect += 1e-9; });
    with([](TruthQuestion& q) { q.width = 65; });
    with([](TruthQuestion& q) { q.height = 65; });
    with([](TruthQuestion& q) { q.farDistance += 1e-9; });
    with([](TruthQuestion& q) { q.moved[0].id = 4; });
    with([](TruthQuestion& q) { q.moved.pop_back(); });
    with([](TruthQuestion& q) { q.moved.clear(); });
}

TEST(TruthStore, KeepsNothingOfATraceThatFails) {
    const TempFolder folder;
    TracedBox scene;
    TruthStore store = taken(TruthStore::open(folder.file("truths")));
    const auto failed = store.frame(
        kKey, [] { return world::Result<TruthFrame>(world::Error{world::ErrorCode::kDevice, "no rays today"}); });
    ASSERT_FALSE(failed);
    EXPECT_EQ(failed.error().what, "no rays today");
    EXPECT_TRUE(store.frame(kKey, [&] { return scene.frame(); }));
    EXPECT_EQ(store.traced(), 1u);
}

TEST(TruthStore, RefusesOtherFilesAndLeavesThemAlone) {
    const TempFolder folder;
    const std::string text = folder.file("text"), foreign = folder.file("foreign");
    world_tests::writeFile(text, std::string(5000, 'x'));
    world_tests::writeFile(foreign, "");
    {
        world::Database db = taken(world::Database::openEmpty(foreign));
        ASSERT_TRUE(db.run(std::string("PRAGMA application_id=1196314445; ") + world::kBlobTable));
    }
    for (const std::string& file : {text, foreign}) {
        const std::string before = world_tests::readFile(file);
        const auto store = TruthStore::open(file);
        ASSERT_FALSE(store);
        EXPECT_EQ(store.error().code, world::ErrorCode::kBadData) << store.error().what;
        EXPECT_NE(store.error().what.find("no store of truths"), std::string::npos) << store.error().what;
        EXPECT_EQ(world_tests::readFile(file), before);
    }
    const auto nowhere = TruthStore::open(folder.file("no/such/folder"));
    ASSERT_FALSE(nowhere);
    EXPECT_EQ(nowhere.error().code, world::ErrorCode::kIo);
}

}  // namespace
