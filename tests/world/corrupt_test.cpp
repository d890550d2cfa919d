// tests/world/corrupt_test.cpp — rows of a real world, damaged one at a time in every column and at many
// lengths: each is refused by name before it is parsed, and all that does not need it is there as before.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "random_world.h"
#include "world/database.h"
#include "world/procedural.h"
#include "world/store.h"
#include "world/streamer.h"

namespace {

using namespace world;
using world_tests::readFile;
using world_tests::TempFolder;
using world_tests::writeFile;

/// How a row is damaged: SQL for its columns, and what the error says of it.
struct Damage {
    std::string set, says;
};

class Corrupt : public ::testing::Test {
protected:
    void SetUp() override {
        Result<BakeSource> source =
            openProcedural(7, {.size = 1024, .chunkSize = 64, .voxel = 4, .instances = 4000});
        ASSERT_TRUE(source);
        // Around the road: some of the names are there.
        std::erase_if(source.value().chunks, [&](const ChunkKey& key) {
            const std::vector<std::string> names = source.value().make(key).value().names;
            return key.x % 2 != 0 ||
                   std::all_of(names.begin(), names.end(), [](auto& n) { return n.empty(); });
        });
        ASSERT_GE(source.value().chunks.size(), 3u);
        ASSERT_TRUE(bake(source.value(), folder_.file("w"), {}));
        whole_ = readFile(folder_.file("w"));
        const Result<WorldStore> store = WorldStore::open(folder_.file("w"));
        ASSERT_TRUE(store);
        const std::vector<BlobInfo> rows = store.value().listBlobs().value();
        // The last of each kind: levels of detail above 0 are among them.
        for (const BlobInfo& row : rows) victims_[row.key.kind] = row;
        ASSERT_EQ(victims_.size(), 8u) << "every kind of row";
    }

    /// The world with `set` done to a row.
    void damage(const BlobKey& key, const std::string& set) const {
        writeFile(path(), whole_);
        Result<Database> database = Database::openEmpty(path());
        ASSERT_TRUE(database);
        const auto is = [](const char* column, int64_t value) {
            return std::string(column) + "=" + std::to_string(value);
        };
        const Result<Done> done = database.value().run(
            "PRAGMA synchronous=OFF; PRAGMA journal_mode=OFF; UPDATE blob SET " + set + " WHERE " +
            is("x", key.x) + " AND " + is("y", key.y) + " AND " + is("z", key.z) + " AND " +
            is("lod", key.lod) + " AND " + is("kind", static_cast<int64_t>(key.kind)));
        ASSERT_TRUE(done) << done.error().what;
    }

    /// The damaged row is refused, by name and with the reason, where it is read; everything else reads.
    void refusesOnly(const BlobKey& key, const std::string& says) const {
        const std::string name = toString(key) + ": ";
        const auto named = [&](const Error& error) {
            EXPECT_EQ(error.code, ErrorCode::kBadData) << error.what;
            EXPECT_NE(error.what.find(name + says), std::string::npos)
                << error.what << "\nexpected " << name << says;
        };
        const Result<WorldStore> opened = WorldStore::open(path());
        if (key.kind < BlobKind::kNames) {
            ASSERT_FALSE(opened) << name << says;
            named(opened.error());
            return;
        }
        ASSERT_TRUE(opened) << opened.error().what;
        const WorldStore& store = opened.value();
        const std::vector<Error> findings = store.check();
        EXPECT_TRUE(
            std::any_of(findings.begin(), findings.end(),
                        [&](const Error& e) { return e.what.find(toString(key)) != std::string::npos; }))
            << name << says;
        const Result<std::vector<NamedInstance>> names = store.names();
        EXPECT_EQ(bool(names), key.kind != BlobKind::kNames);
        if (!names) named(names.error());
        for (uint32_t id = 0; id < store.meshes().size(); ++id) {
            const Result<Mesh> mesh = store.readMesh(id);
            const bool hurt = key.kind == BlobKind::kMesh && key.x == static_cast<int32_t>(id);
            EXPECT_EQ(bool(mesh), !hurt) << "mesh " << id;
            if (!mesh) named(mesh.error());
        }
        for (const ChunkRecord& record : store.chunks()) {
            const Result<Chunk> chunk = store.readChunk(record.key);
            EXPECT_EQ(bool(chunk), !needs(record, key)) << toString(record.key);
            if (!chunk) named(chunk.error());
        }
    }

    /// Whether a chunk's own rows, which make it a `Chunk`, hold the row.
    static bool needs(const ChunkRecord& record, const BlobKey& key) {
        return (key.kind == BlobKind::kInstances || key.kind == BlobKind::kTerrainMesh) &&
               record.key == ChunkKey{key.x, key.y, key.z};
    }

    /// All chunks are wanted: those that need the row are named, the others arrive.
    void streamsTheRest(const BlobKey& key) const {
        const Result<WorldStore> store = WorldStore::open(path());
        ASSERT_TRUE(store) << store.error().what;
        std::set<ChunkKey> expected, arrived;
        for (const ChunkRecord& record : store.value().chunks()) {
            const bool usesMesh =
                key.kind == BlobKind::kMesh &&
                std::binary_search(record.meshes.begin(), record.meshes.end(), static_cast<uint32_t>(key.x));
            if (!needs(record, key) && !usesMesh) expected.insert(record.key);
        }
        Streamer streamer(store.value(), {});
        streamer.want([](const Box&) { return std::optional(Want{}); }, 0);
        const StreamEvents events = streamer.advance(0);
        for (const auto& chunk : events.arrivals) arrived.insert(chunk->key);
        EXPECT_EQ(arrived, expected) << toString(key);
        EXPECT_EQ(events.errors.empty(), expected.size() == store.value().chunks().size());
        for (const Error& error : events.errors)
            EXPECT_NE(error.what.find(toString(key)), std::string::npos) << error.what;
    }

    std::string path() const { return folder_.file("hurt"); }

    TempFolder folder_;
    std::string whole_;
    std::map<BlobKind, BlobInfo> victims_;
};

TEST_F(Corrupt, EveryColumnOfEveryKindOfRow) {
    const std::string sum = "its checksum does not match";
    const std::vector<Damage> damages = {
        {"codec=1-codec", sum},
        {"codec=2", "its codec is unknown"},
        {"codec=-1", "its codec is unknown"},
        {"codec=codec+4294967296", "its codec is unknown"},  // the same in 32 bits
        {"raw_size=raw_size+1", sum},
        {"raw_size=raw_size-1", sum},
        {"raw_size=raw_size+4294967296", "its size is out of range"},
        {"raw_size=0", sum},
        {"raw_size=-1", "its size is out of range"},
        {"raw_size=9223372036854775807", "its size is out of range"},
        {"checksum=checksum+1", sum},
        {"checksum=-checksum", sum},
        {"checksum=0", sum},
        {"checksum='text'", sum},
        {"data=x''", sum},
        {"data=CAST('text' AS TEXT)", sum},
        {"data=CAST(data||x'00' AS BLOB)", sum},
        {"data=zeroblob(length(data))", sum},
    };
    for (const auto& [kind, row] : victims_)
        for (const Damage& d : damages) {
            SCOPED_TRACE(toString(row.key) + " " + d.set);
            ASSERT_NO_FATAL_FAILURE(damage(row.key, d.set));
            ASSERT_NO_FATAL_FAILURE(refusesOnly(row.key, d.says));
        }
}

TEST_F(Corrupt, EveryKindOfRowInAnotherPlace) {
    for (const auto& [kind, row] : victims_)
        for (const char* column : {"x", "y", "z", "lod", "kind"}) {
            SCOPED_TRACE(toString(row.key) + " " + column);
            ASSERT_NO_FATAL_FAILURE(damage(row.key, std::string(column) + "=" + column + "+100"));
            if (kind != BlobKind::kLevelSet) {  // nothing reads a level set yet but whoever asks for its row
                ASSERT_NO_FATAL_FAILURE(refusesOnly(row.key, "the row is missing"));
            }
            if (kind < BlobKind::kNames) continue;
            BlobKey moved = row.key;
            for (auto [name, field] : {std::pair("x", &BlobKey::x),
                                       {"y", &BlobKey::y},
                                       {"z", &BlobKey::z},
                                       {"lod", &BlobKey::lod}})
                if (column == std::string(name)) moved.*field += 100;
            if (column == std::string("kind"))
                moved.kind = static_cast<BlobKind>(static_cast<int32_t>(kind) + 100);
            const Result<WorldStore> store = WorldStore::open(path());
            ASSERT_TRUE(store);
            EXPECT_EQ(store.value().readBlob(row.key).error().code, ErrorCode::kNotFound);
            const Result<std::vector<std::byte>> there = store.value().readBlob(moved);
            ASSERT_FALSE(there);
            EXPECT_NE(there.error().what.find("its checksum does not match"), std::string::npos)
                << there.error().what;
        }
}

TEST_F(Corrupt, EveryKindOfRowCutAtManyLengthsAndFlippedInManyPlaces) {
    std::mt19937 rng(71);
    for (const auto& [kind, row] : victims_) {
        const uint64_t size = row.storedBytes;
        std::set<uint64_t> lengths = {size - 1, size / 2};
        for (uint64_t n = 0; n < 16; ++n) lengths.insert(std::min(n, size - 1));
        for (int n = 0; n < 16; ++n) lengths.insert(rng() % size);
        for (const uint64_t length : lengths) {
            SCOPED_TRACE(toString(row.key) + " cut to " + std::to_string(length) + " of " +
                         std::to_string(size));
            ASSERT_NO_FATAL_FAILURE(damage(row.key, "data=substr(data,1," + std::to_string(length) + ")"));
            ASSERT_NO_FATAL_FAILURE(refusesOnly(row.key, "its checksum does not match"));
        }
        for (const uint64_t at : lengths) {
            SCOPED_TRACE(toString(row.key) + " flipped at " + std::to_string(at));
            // The byte becomes another one: SQL has no exclusive or of bytes.
            const std::string n = std::to_string(at + 1), byte = "substr(data," + n + ",1)";
            ASSERT_NO_FATAL_FAILURE(damage(
                row.key, "data=CAST(substr(data,1," + n + "-1)||(CASE " + byte +
                             " WHEN x'00' THEN x'01' ELSE x'00' END)||substr(data," + n + "+1) AS BLOB)"));
            ASSERT_NO_FATAL_FAILURE(refusesOnly(row.key, "its checksum does not match"));
        }
        if (kind > BlobKind::kMeshTable) {
            ASSERT_NO_FATAL_FAILURE(streamsTheRest(row.key));
        }
    }
}

}  // namespace
