// tests/world/resume_test.cpp — a bake that was killed goes on where it was, or begins anew, and the world is
// the same. A kill is the unfinished file as it lies on the disk in the middle of a bake, copied.
#include <gtest/gtest.h>

#include <atomic>

#include "file_size_limit.h"
#include "random_world.h"
#include "world/bake.h"
#include "world/store.h"

namespace {

using namespace world;
using world_tests::FileSizeLimit;
using world_tests::randomSource;
using world_tests::readFile;
using world_tests::TempFolder;
using world_tests::writeFile;
namespace fs = std::filesystem;

constexpr size_t kChunks = 64;

/// 64 chunks that fill some 20 MiB, two transactions and a half; `asked` counts calls of `make`.
BakeSource largeSource(uint32_t seed, std::atomic<size_t>& asked) {
    BakeSource source = randomSource({.seed = seed, .chunksAside = 8});
    source.make = [make = source.make, &asked](ChunkKey key) -> Result<SourceChunk> {
        ++asked;
        Result<SourceChunk> chunk = make(key);
        std::mt19937 rng(static_cast<uint32_t>(key.x * 100 + key.z));
        if (!chunk || key.x == 1) return chunk;
        if (!chunk.value().terrain)
            chunk.value().terrain.emplace(TerrainChunk{world_tests::randomMesh(4, rng), {}});
        chunk.value().terrain->levelSet.resize(400'000);
        for (std::byte& b : chunk.value().terrain->levelSet) b = std::byte(rng() & 255);
        return chunk;
    };
    return source;
}

uint64_t hashOf(const std::string& path) {
    const Result<WorldStore> store = WorldStore::open(path);
    EXPECT_TRUE(store) << store.error().what;
    if (!store) return 0;
    const Result<uint64_t> hash = store.value().contentHash();
    EXPECT_TRUE(hash) << hash.error().what;
    return hash ? hash.value() : 0;
}

class Resume : public ::testing::Test {
protected:
    /// Bakes to the end, keeping what a kill after each of `moments` [chunks] would have left, as
    /// MOMENT/w.baking.
    void SetUp() override {
        const Result<BakeStats> stats =
            bake(largeSource(51, asked_), folder_.file("w"), [&](size_t done, size_t) {
                if (done != 1 && done != 30 && done != 31 && done != 55 && done != kChunks) return;
                const fs::path to = folder_.file(std::to_string(done));
                fs::create_directory(to);
                for (const char* suffix : {".baking", ".baking-wal"})
                    fs::copy_file(folder_.file("w") + suffix, (to / "w").string() + suffix);
            });
        ASSERT_TRUE(stats) << stats.error().what;
        stats_ = stats.value();
        hash_ = hashOf(folder_.file("w"));
    }

    struct Outcome {
        Result<BakeStats> stats;
        std::string notices;
        size_t asked = 0;
    };
    Outcome bakeOn(const std::string& path) {
        asked_ = 0;
        Outcome outcome{Error{}, {}};
        outcome.stats = bake(largeSource(51, asked_), path, {},
                             [&](const std::string& line) { outcome.notices += line + "\n"; });
        outcome.asked = asked_;
        return outcome;
    }

    TempFolder folder_;
    std::atomic<size_t> asked_ = 0;
    BakeStats stats_;
    uint64_t hash_ = 0;
};

TEST_F(Resume, GoesOnWhereItWasKilled) {
    size_t before = kChunks + 1;
    for (const size_t moment : {size_t{1}, size_t{30}, size_t{31}, size_t{55}, kChunks}) {
        const std::string path = folder_.file(std::to_string(moment)) + "/w";
        size_t first = 0;
        asked_ = 0;
        std::string notices;
        const Result<BakeStats> stats = bake(
            largeSource(51, asked_), path,
            [&](size_t done, size_t total) {
                EXPECT_EQ(total, kChunks);
                if (first == 0) first = done;
            },
            [&](const std::string& line) { notices += line + "\n"; });
        ASSERT_TRUE(stats) << stats.error().what;
        EXPECT_EQ(hashOf(path), hash_) << moment;
        EXPECT_EQ(stats.value().chunks, stats_.chunks);
        EXPECT_EQ(stats.value().instances, stats_.instances);
        EXPECT_EQ(stats.value().terrainTriangles, stats_.terrainTriangles);
        EXPECT_LE(asked_, before) << "the later it was killed, the less is left";
        before = asked_;
        if (moment == 1) {
            EXPECT_EQ(asked_, kChunks) << "nothing was on the disk yet";
            EXPECT_EQ(notices, "");
            continue;
        }
        EXPECT_LT(asked_, kChunks) << moment;
        EXPECT_GE(asked_, kChunks - moment);
        EXPECT_EQ(first, kChunks - asked_) << "progress counts what was done before";
        EXPECT_EQ(notices, path + ".baking: goes on after " + std::to_string(first) + " of 64 chunks\n");
    }
    EXPECT_LT(before, kChunks / 2);
}

TEST_F(Resume, BeginsAnewForAnotherWork) {
    const auto anew = [&](const std::string& what, const std::function<void(BakeSource&)>& change) {
        const std::string path = folder_.file("55/w"), copy = folder_.file("other");
        for (const char* suffix : {".baking", ".baking-wal"})
            fs::copy_file(path + suffix, copy + suffix, fs::copy_options::overwrite_existing);
        BakeSource source = largeSource(51, asked_);
        change(source);
        std::string notices;
        asked_ = 0;
        ASSERT_TRUE(bake(source, copy, {}, [&](const std::string& line) { notices += line + "\n"; }));
        EXPECT_EQ(asked_, source.chunks.size()) << what;
        EXPECT_EQ(notices,
                  copy + ".baking is of another source, other options or another program: begins anew\n")
            << what;
        ASSERT_TRUE(bake(source, folder_.file("fresh"), {}));
        EXPECT_EQ(hashOf(copy), hashOf(folder_.file("fresh"))) << what;
    };
    anew("contents", [](BakeSource& s) { s.contents = 1; });
    anew("sun", [](BakeSource& s) { s.header.sun = glm::dvec3(1, 0, 0); });
    anew("mesh", [](BakeSource& s) { s.meshes[0].levels[0].positions[0].y += 1; });
    anew("chunks", [](BakeSource& s) { s.chunks.pop_back(); });
}

/// Damage: a world that comes of it is the right one, or says itself that it is damaged.
TEST_F(Resume, NeverTakesDamageForWork) {
    const std::string base = readFile(folder_.file("55/w.baking")),
                      wal = readFile(folder_.file("55/w.baking-wal"));
    const std::string path = folder_.file("hurt");
    std::mt19937 rng(52);
    size_t right = 0;
    for (int step = 0; step < 12; ++step) {
        std::string bytes = base, log = wal;
        std::string& victim = step % 2 == 0 ? bytes : log;
        if (step % 3 == 0)
            victim.resize(rng() % victim.size());
        else
            for (int n = 0; n < 40; ++n) victim[rng() % victim.size()] = static_cast<char>(rng());
        writeFile(path + ".baking", bytes);
        writeFile(path + ".baking-wal", log);
        Outcome outcome = bakeOn(path);
        if (!outcome.stats) {
            EXPECT_FALSE(fs::exists(path + ".baking")) << outcome.stats.error().what;
            outcome = bakeOn(path);
            ASSERT_TRUE(outcome.stats) << outcome.stats.error().what;
        }
        const Result<WorldStore> store = WorldStore::open(path);
        ASSERT_TRUE(store) << store.error().what;
        const Result<uint64_t> hash = store.value().contentHash();
        if (!hash) continue;
        EXPECT_EQ(hash.value(), hash_) << step;
        ++right;
    }
    EXPECT_GT(right, 0u);
}

TEST_F(Resume, BeginsAnewAfterWhatIsNoWork) {
    const std::string path = folder_.file("text");
    writeFile(path + ".baking", std::string(5000, 'x'));
    writeFile(path + ".baking-wal", std::string(5000, 'y'));
    const Outcome outcome = bakeOn(path);
    ASSERT_TRUE(outcome.stats) << outcome.stats.error().what;
    EXPECT_NE(outcome.notices.find("begins anew"), std::string::npos) << outcome.notices;
    EXPECT_EQ(hashOf(path), hash_);
}

TEST_F(Resume, GoesOnOnceTheDiskHasRoom) {
    const std::string path = folder_.file("full");
    {
        const FileSizeLimit limit(12'000'000);
        const Outcome full = bakeOn(path);
        ASSERT_FALSE(full.stats);
        EXPECT_EQ(full.stats.error().code, ErrorCode::kIo);
        EXPECT_NE(full.stats.error().what.find("free some space"), std::string::npos)
            << full.stats.error().what;
        EXPECT_NE(full.stats.error().what.find("goes on from where it was"), std::string::npos)
            << full.stats.error().what;
    }
    const Outcome rest = bakeOn(path);
    ASSERT_TRUE(rest.stats) << rest.stats.error().what;
    EXPECT_NE(rest.notices.find("goes on after"), std::string::npos) << rest.notices;
    EXPECT_LT(rest.asked, kChunks);
    EXPECT_EQ(hashOf(path), hash_);
}

TEST_F(Resume, ASourceThatFailsLeavesNothing) {
    const std::string path = folder_.file("55/w");
    BakeSource source = largeSource(51, asked_);
    source.make = [](ChunkKey) -> Result<SourceChunk> { return Error{ErrorCode::kIo, "tape tangled"}; };
    ASSERT_FALSE(bake(source, path, {}));
    EXPECT_FALSE(fs::exists(path + ".baking"));
    EXPECT_FALSE(fs::exists(path + ".baking-wal"));
}

}  // namespace
