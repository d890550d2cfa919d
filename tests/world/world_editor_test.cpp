// tests/world/world_editor_test.cpp — edits in a world file: whole or not at all, beside readers, one writer.
#include "world/world_editor.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <thread>

#include "tests/world/hills_world.h"
#include "world/database.h"
#include "world/edited_terrain.h"
#include "world/mesh_changes.h"

namespace {

using namespace world;
using world_tests::readFile;
using world_tests::TempFolder;
using world_tests::writeFile;

constexpr int32_t kVoxels = 16;
constexpr double kVoxel = 2, kEdge = kVoxels * kVoxel;
constexpr int kAlong = 4;

void bakeHills(const std::string& path, double lift = 0) {
    const auto stats = bake(test::hillsWorld(kAlong, kVoxels, kVoxel, lift), path, {});
    ASSERT_TRUE(stats) << stats.error().what;
}

TerrainEdit dig(glm::dvec3 at, double radius) { return {EditKind::kDig, Sphere{at, radius}}; }

void expectSound(const std::string& path) {
    const Result<WorldStore> store = WorldStore::open(path);
    ASSERT_TRUE(store) << store.error().what;
    for (const Error& finding : store.value().check()) ADD_FAILURE() << finding.what;
}

TEST(WorldEditor, LeavesASoundWorldWithTheEditsInIt) {
    TempFolder folder;
    const std::string path = folder.file("w");
    bakeHills(path);
    std::map<ChunkKey, std::shared_ptr<const EditedChunk>> last;
    Result<WorldStore> before = WorldStore::open(path);
    ASSERT_TRUE(before);
    const uint64_t hash = before.value().contentHash().value();
    {
        Result<WorldEditor> editor = WorldEditor::open(path);
        ASSERT_TRUE(editor) << editor.error().what;
        EditedTerrain terrain(before.value(), &editor.value());
        // The first at a corner of four, the last deep below all that the world held.
        for (const glm::dvec3 at : {glm::dvec3(kEdge, 0, kEdge), glm::dvec3(40, 5, 100), glm::dvec3(70, -10, 50),
                                    glm::dvec3(40, 2, 100), glm::dvec3(50, -70, 50)}) {
            const auto changed = terrain.apply(dig(at, 14));
            ASSERT_TRUE(changed) << changed.error().what;
            EXPECT_FALSE(changed.value().empty());
            if (last.empty()) {
                EXPECT_EQ(changed.value().size(), 4u);
            }
            for (const auto& chunk : changed.value()) last[chunk->record.key] = chunk;
            EXPECT_EQ(folder.list(), std::vector<std::string>{"w"}) << "between edits the world is one file";
        }
    }
    expectSound(path);
    const Result<WorldStore> after = WorldStore::open(path);
    ASSERT_TRUE(after);
    EXPECT_NE(after.value().contentHash().value(), hash);
    EXPECT_LT(after.value().header().bounds.min.y, before.value().header().bounds.min.y - 10);
    for (const ChunkRecord& record : after.value().chunks()) {
        const Chunk chunk = after.value().readChunk(record.key).value();
        EXPECT_EQ(chunk.instances.size(), 2u);
        const auto edited = last.find(record.key);
        const bool wasEdited = edited != last.end();
        const Chunk old = before.value().readChunk(record.key).value();  // which reads what is there now
        const Mesh& expected = wasEdited ? edited->second->terrain : old.terrain;
        EXPECT_TRUE(test::sameMesh(chunk.terrain, expected)) << toString(record.key);
        EXPECT_EQ(record.bounds, wasEdited ? edited->second->record.bounds : before.value().find(record.key)->bounds);
        EXPECT_TRUE(test::sameMesh(old.terrain, expected)) << toString(record.key);
    }
    EXPECT_GT(last.size(), 6u);
    EXPECT_LT(last.size(), after.value().chunks().size());
}

TEST(WorldEditor, EditsGoOnFromWhereTheFileIs) {
    TempFolder folder;
    bakeHills(folder.file("once"));
    writeFile(folder.file("twice"), readFile(folder.file("once")));
    const TerrainEdit first = dig({kEdge, 0, kEdge}, 9), second{EditKind::kFill, Box{{25, -5, 25}, {45, 9, 45}}};
    const auto applyTo = [&](const std::string& name, std::vector<TerrainEdit> edits) {
        const Result<WorldStore> store = WorldStore::open(folder.file(name));
        Result<WorldEditor> editor = WorldEditor::open(folder.file(name));
        ASSERT_TRUE(store && editor);
        EditedTerrain terrain(store.value(), &editor.value());
        for (const TerrainEdit& edit : edits) ASSERT_TRUE(terrain.apply(edit));
    };
    applyTo("once", {first, second});
    applyTo("twice", {first});
    applyTo("twice", {second});
    EXPECT_EQ(WorldStore::open(folder.file("once")).value().contentHash().value(),
              WorldStore::open(folder.file("twice")).value().contentHash().value());
    expectSound(folder.file("once"));
}

TEST(WorldEditor, ReadersBesideItSeeBeforeOrAfter) {
    TempFolder folder;
    const std::string path = folder.file("w");
    bakeHills(path);
    const Result<WorldStore> store = WorldStore::open(path);
    ASSERT_TRUE(store);
    Result<WorldEditor> editor = WorldEditor::open(path);
    ASSERT_TRUE(editor);
    EditedTerrain terrain(store.value(), &editor.value());
    const ChunkKey key{1, 0, 1};
    std::atomic<bool> over = false;
    std::atomic<int> reads = 0, opens = 0;
    std::vector<std::string> complaints;
    std::mutex mutex;
    const auto complain = [&](const std::string& what) {
        const std::lock_guard lock(mutex);
        complaints.push_back(what);
    };
    std::vector<std::thread> threads;
    for (int t = 0; t < 3; ++t)
        threads.emplace_back([&] {
            // Directory rows and level rows that belong to different edits would not fit each other.
            for (; !over; ++reads)
                if (const auto chunk = store.value().readChunk(key); !chunk) complain(chunk.error().what);
        });
    threads.emplace_back([&] {
        for (; !over; ++opens)
            if (const auto another = WorldStore::open(path); !another) complain(another.error().what);
    });
    int edits = 0;
    for (; edits < 25 || (reads < 100 || opens < 20); ++edits) {
        const auto changed = terrain.apply({edits % 2 ? EditKind::kFill : EditKind::kDig,
                                            Sphere{{48 + edits % 5, edits % 7 - 3, 48}, 4.0 + edits % 9}});
        if (!changed) complain(changed.error().what);
        if (edits > 1000) break;
    }
    over = true;
    for (std::thread& t : threads) t.join();
    EXPECT_GE(reads, 100);
    EXPECT_GE(opens, 20);
    for (const std::string& complaint : complaints) ADD_FAILURE() << complaint;
    expectSound(path);
}

TEST(WorldEditor, KeepsOthersOut) {
    TempFolder folder;
    const std::string path = folder.file("w");
    bakeHills(path);
    {
        const Result<WorldEditor> first = WorldEditor::open(path);
        ASSERT_TRUE(first);
        const Result<WorldEditor> second = WorldEditor::open(path);
        ASSERT_FALSE(second);
        EXPECT_EQ(second.error().code, ErrorCode::kIo);
        EXPECT_NE(second.error().what.find(path + ": cannot be edited"), std::string::npos) << second.error().what;
    }
    EXPECT_TRUE(WorldEditor::open(path)) << "the lock goes with its owner";
    EXPECT_EQ(folder.list(), std::vector<std::string>{"w"});
}

TEST(WorldEditor, RefusesWhatIsNoWorldInTheStoresWords) {
    TempFolder folder;
    writeFile(folder.file("text"), "no world");
    for (const char* name : {"text", "nothing"}) {
        const auto editor = WorldEditor::open(folder.file(name));
        const auto store = WorldStore::open(folder.file(name));
        ASSERT_FALSE(editor);
        EXPECT_EQ(editor.error().what, store.error().what);
        EXPECT_EQ(editor.error().code, store.error().code);
    }
    EXPECT_EQ(readFile(folder.file("text")), "no world");
    EXPECT_EQ(folder.list(), std::vector<std::string>{"text"});
}

TEST(WorldEditor, SeesThatTheWorldWasReplaced) {
    TempFolder folder;
    const std::string path = folder.file("w");
    bakeHills(path);
    const Result<WorldStore> store = WorldStore::open(path);
    Result<WorldEditor> editor = WorldEditor::open(path);
    ASSERT_TRUE(store && editor);
    EditedTerrain terrain(store.value(), &editor.value());
    ASSERT_TRUE(terrain.apply(dig({20, 0, 20}, 8)));
    bakeHills(path, 3);
    const std::string baked = readFile(path);
    const auto lost = terrain.apply(dig({20, 0, 20}, 9));
    ASSERT_FALSE(lost);
    EXPECT_EQ(lost.error().code, ErrorCode::kIo);
    EXPECT_NE(lost.error().what.find("was replaced"), std::string::npos) << lost.error().what;
    EXPECT_EQ(readFile(path), baked);
}

TEST(WorldEditor, AFullDiskLeavesTheWorldAndTheEditorAsTheyWere) {
    TempFolder folder;
    const std::string path = folder.file("w");
    bakeHills(path);
    const Result<WorldStore> store = WorldStore::open(path);
    Result<WorldEditor> editor = WorldEditor::open(path);
    ASSERT_TRUE(store && editor);
    EditedTerrain terrain(store.value(), &editor.value());
    ASSERT_TRUE(terrain.apply(dig({20, 0, 20}, 8)));
    const uint64_t before = WorldStore::open(path).value().contentHash().value();
    const TerrainEdit edit{EditKind::kFill, Sphere{{64, 0, 64}, 15}};
    int failures = 0;
    // No file may grow beyond so many bytes: none at all, the journal, the world.
    for (const rlim_t limit : {0, 5000, 60000}) {
        rlimit old{};
        ::getrlimit(RLIMIT_FSIZE, &old);
        const auto handler = std::signal(SIGXFSZ, SIG_IGN);
        const rlimit tight{limit, old.rlim_max};
        ::setrlimit(RLIMIT_FSIZE, &tight);
        const auto full = terrain.apply(edit);
        ::setrlimit(RLIMIT_FSIZE, &old);
        std::signal(SIGXFSZ, handler);
        if (full) break;
        ++failures;
        EXPECT_EQ(full.error().code, ErrorCode::kIo) << full.error().what;
        EXPECT_EQ(WorldStore::open(path).value().contentHash().value(), before) << limit;
        expectSound(path);
    }
    EXPECT_GE(failures, 2);
    const auto made = terrain.apply(edit);
    ASSERT_TRUE(made) << made.error().what;
    EXPECT_NE(WorldStore::open(path).value().contentHash().value(), before);
    expectSound(path);
}

TEST(WorldEditor, AnEditThatWasCutShortIsTakenBack) {
    TempFolder folder;
    const std::string path = folder.file("w"), torn = folder.file("torn");
    bakeHills(path);
    const uint64_t before = WorldStore::open(path).value().contentHash().value();
    {
        // As a process leaves it that dies when it has begun to write the file: with the journal's pages in place.
        Result<Database> database = Database::openEditable(path);
        ASSERT_TRUE(database);
        ASSERT_TRUE(database.value().run("PRAGMA cache_size=1; PRAGMA cache_spill=1; BEGIN IMMEDIATE; DELETE FROM blob WHERE kind=6"));
        ASSERT_TRUE(std::filesystem::exists(path + "-journal"));
        std::filesystem::copy_file(path, torn);
        std::filesystem::copy_file(path + "-journal", torn + "-journal");
        ASSERT_TRUE(database.value().run("ROLLBACK"));
    }
    EXPECT_NE(readFile(torn), readFile(path)) << "there is something to take back";
    const Result<WorldStore> store = WorldStore::open(torn);
    ASSERT_TRUE(store) << store.error().what;
    EXPECT_EQ(store.value().contentHash().value(), before);
    EXPECT_FALSE(std::filesystem::exists(torn + "-journal"));
    expectSound(torn);
}

TEST(EditedTerrain, SaysWhereThereIsNoTerrain) {
    TempFolder folder;
    bakeHills(folder.file("w"));
    const Result<WorldStore> store = WorldStore::open(folder.file("w"));
    EditedTerrain terrain(store.value());
    const auto outside = terrain.apply(dig({-200, 0, 0}, 5));
    ASSERT_FALSE(outside);
    EXPECT_EQ(outside.error().code, ErrorCode::kNotFound);
    const auto nothing = terrain.apply(dig({64, 58, 64}, 2));
    ASSERT_TRUE(nothing) << "air in air";
    EXPECT_TRUE(nothing.value().empty());
    const auto border = terrain.apply({EditKind::kFill, Sphere{{-2, 0, 40}, 8}});
    ASSERT_TRUE(border) << "half of it outside the world";
    EXPECT_EQ(border.value().size(), 2u) << "no chunk comes to be";
}

TEST(EditedTerrain, SaysWhereLevelsChanged) {
    TempFolder folder;
    bakeHills(folder.file("w"));
    const Result<WorldStore> store = WorldStore::open(folder.file("w"));
    EditedTerrain terrain(store.value());
    std::map<ChunkKey, Mesh> before;
    for (const ChunkRecord& record : store.value().chunks())
        before[record.key] = store.value().readChunk(record.key).value().terrain;
    int levels = 0;
    for (int n = 0; n < 6; ++n) {
        const auto changed = terrain.apply({n % 2 ? EditKind::kFill : EditKind::kDig, Sphere{{50 + 5 * n, 3, 60}, 6}});
        ASSERT_TRUE(changed);
        for (const auto& chunk : changed.value()) {
            Mesh& old = before[chunk->record.key];
            const size_t both = std::min(old.levels.size(), chunk->terrain.levels.size());
            ASSERT_EQ(chunk->changes.size(), std::max(old.levels.size(), chunk->terrain.levels.size()));
            for (size_t k = 0; k < both; ++k, ++levels)
                EXPECT_EQ(chunk->changes[k], changedBox(old.levels[k], chunk->terrain.levels[k]));
            old = chunk->terrain;
        }
    }
    EXPECT_GT(levels, 10);
}

}  // namespace
