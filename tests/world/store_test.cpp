#include "world/store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <map>
#include <thread>

#include "file_size_limit.h"
#include "random_world.h"
#include "world/blob.h"
#include "world/bytes.h"
#include "world/codec.h"
#include "world/database.h"
#include "world/hash.h"

namespace {

using namespace world;
using world_tests::FileSizeLimit;
using world_tests::randomSource;
using world_tests::readFile;
using world_tests::TempFolder;
using world_tests::writeFile;
using Bytes = std::vector<std::byte>;

Bytes randomBytes(size_t size, bool packable, std::mt19937& rng) {
    Bytes bytes(size);
    for (std::byte& b : bytes) b = std::byte(packable ? rng() % 3 : rng() & 255);
    return bytes;
}

/// A world of rows alone: whatever else is put, it opens.
void putTables(WorldWriter& writer, const std::string& source) {
    Header header;
    header.chunkSize = 10;
    header.source = source;
    ASSERT_TRUE(writer.put({.kind = BlobKind::kHeader}, encodeHeader(header)));
    ASSERT_TRUE(writer.put({.kind = BlobKind::kDirectory}, encodeDirectory({})));
    ASSERT_TRUE(writer.put({.kind = BlobKind::kMeshTable}, encodeMeshTable({})));
    ASSERT_TRUE(writer.put({.kind = BlobKind::kNames}, encodeNames({})));
}

void writeWorld(const std::string& path, const std::string& source = "rows") {
    Result<WorldWriter> writer = WorldWriter::create(path);
    ASSERT_TRUE(writer) << writer.error().what;
    putTables(writer.value(), source);
    ASSERT_TRUE(writer.value().finish());
}

void bakeWorld(const std::string& path, const world_tests::RandomWorld& options) {
    const Result<BakeStats> stats = bake(randomSource(options), path, {});
    ASSERT_TRUE(stats) << stats.error().what;
}

/// Runs SQL on a finished world, as somebody with a knife would.
void cutInto(const std::string& path, const std::string& sql) {
    Result<Database> database = Database::openEmpty(path);
    ASSERT_TRUE(database) << database.error().what;
    const Result<Done> done = database.value().run(sql);
    ASSERT_TRUE(done) << done.error().what;
}

void expectRefused(const std::string& path, ErrorCode code, const std::string& says) {
    const Result<WorldStore> store = WorldStore::open(path);
    ASSERT_FALSE(store) << says;
    EXPECT_EQ(store.error().code, code) << store.error().what;
    EXPECT_NE(store.error().what.find(says), std::string::npos) << store.error().what;
    EXPECT_NE(store.error().what.find(path), std::string::npos) << store.error().what;
    EXPECT_EQ(store.error().what.find('\n'), std::string::npos) << store.error().what;
}

TEST(Store, GivesBackEveryRow) {
    TempFolder folder;
    std::mt19937 rng(21);
    std::map<BlobKey, Bytes> rows;
    const auto any = [&rng] {
        return rng() % 8 == 0
                   ? (rng() % 2 ? std::numeric_limits<int32_t>::min() : std::numeric_limits<int32_t>::max())
                   : static_cast<int32_t>(rng() % 7) - 3;
    };
    Result<WorldWriter> writer = WorldWriter::create(folder.file("w.world"));
    ASSERT_TRUE(writer);
    putTables(writer.value(), "rows");
    while (rows.size() < 400) {
        const BlobKey key{any(), any(), any(), any(), static_cast<BlobKind>(4 + rng() % 4)};
        const size_t size = rows.empty() ? 0 : rng() % 5 == 0 ? rng() % 300000 : rng() % 900;
        if (!rows.emplace(key, randomBytes(size, rng() % 2, rng)).second) continue;
        ASSERT_TRUE(writer.value().put(key, rows[key]));
    }
    ASSERT_TRUE(writer.value().finish());
    EXPECT_EQ(folder.list(), std::vector<std::string>{"w.world"});

    const Result<WorldStore> store = WorldStore::open(folder.file("w.world"));
    ASSERT_TRUE(store) << store.error().what;
    EXPECT_EQ(store.value().header().source, "rows");
    std::atomic<int> wrong = 0;
    std::vector<std::thread> threads;
    for (int t = 0; t < 8; ++t)
        threads.emplace_back([&] {
            for (const auto& [key, bytes] : rows) {
                const Result<Bytes> raw = store.value().readBlob(key);
                if (!raw || raw.value() != bytes) ++wrong;
            }
        });
    for (std::thread& t : threads) t.join();
    EXPECT_EQ(wrong, 0);

    const Result<std::vector<BlobInfo>> list = store.value().listBlobs();
    ASSERT_TRUE(list);
    ASSERT_EQ(list.value().size(), rows.size() + 4);
    for (size_t i = 1; i < list.value().size(); ++i)
        EXPECT_TRUE(list.value()[i - 1].key < list.value()[i].key);
    for (const BlobInfo& info : list.value()) {
        const auto row = rows.find(info.key);
        if (row == rows.end()) continue;
        EXPECT_EQ(info.rawBytes, row->second.size());
        EXPECT_LE(info.storedBytes, row->second.size()) << "what does not shrink is stored as it is";
    }
    const Result<Bytes> none = store.value().readBlob({99, 99, 99, 0, BlobKind::kInstances});
    ASSERT_FALSE(none);
    EXPECT_EQ(none.error().code, ErrorCode::kNotFound);
}

TEST(Store, ContentHashSeesRowsAndNothingElse) {
    TempFolder folder;
    const auto hashOf = [&](const std::string& name, const std::vector<std::pair<BlobKey, Bytes>>& rows) {
        Result<WorldWriter> writer = WorldWriter::create(folder.file(name));
        for (const auto& [key, bytes] : rows) EXPECT_TRUE(writer.value().put(key, bytes));
        putTables(writer.value(), "rows");
        EXPECT_TRUE(writer.value().finish());
        return WorldStore::open(folder.file(name)).value().contentHash().value();
    };
    std::mt19937 rng(22);
    const Bytes a = randomBytes(1000, true, rng), b = randomBytes(3000, false, rng);
    const BlobKey k{1, 0, 2, 0, BlobKind::kLevelSet}, l{1, 0, 2, 1, BlobKind::kLevelSet};
    const uint64_t hash = hashOf("a", {{k, a}, {l, b}});
    EXPECT_EQ(hash, hashOf("b", {{l, b}, {k, a}})) << "order of writing";
    EXPECT_NE(hash, hashOf("c", {{k, b}, {l, a}}));
    EXPECT_NE(hash, hashOf("d", {{k, a}}));
    Bytes c = a;
    c[500] ^= std::byte{1};
    EXPECT_NE(hash, hashOf("e", {{k, c}, {l, b}}));
}

TEST(Store, AWriterThatStopsLeavesNothing) {
    TempFolder folder;
    const std::string path = folder.file("w.world");
    writeWorld(path, "old");
    const std::string before = readFile(path);
    {
        Result<WorldWriter> writer = WorldWriter::create(path);
        ASSERT_TRUE(writer);
        ASSERT_TRUE(writer.value().put({.kind = BlobKind::kHeader}, Bytes(100)));
        EXPECT_EQ(readFile(path), before);
        EXPECT_EQ(WorldStore::open(path).value().header().source, "old");
    }
    EXPECT_EQ(folder.list(), std::vector<std::string>{"w.world"});
    EXPECT_EQ(readFile(path), before);
    {
        Result<WorldWriter> writer = WorldWriter::create(path);
        ASSERT_TRUE(writer);
        ASSERT_TRUE(writer.value().put({.kind = BlobKind::kHeader}, Bytes(100)));
        const Result<Done> twice = writer.value().put({.kind = BlobKind::kHeader}, Bytes(100));
        ASSERT_FALSE(twice);
        EXPECT_EQ(folder.list(), std::vector<std::string>{"w.world"}) << "a dead writer has cleaned up";
    }
    writeWorld(path, "new");
    EXPECT_EQ(WorldStore::open(path).value().header().source, "new");
}

TEST(Store, TakesOverWhatAKilledBakeLeft) {
    TempFolder folder;
    for (const char* suffix : {".baking", ".baking-wal", ".baking-shm", ".baking-journal"})
        writeFile(folder.file("w.world") + suffix, std::string(5000, 'x'));
    writeWorld(folder.file("w.world"));
    EXPECT_EQ(folder.list(), std::vector<std::string>{"w.world"});
    EXPECT_TRUE(WorldStore::open(folder.file("w.world")));
}

TEST(Store, RefusesASecondWriter) {
    TempFolder folder;
    const std::string path = folder.file("w.world");
    Result<WorldWriter> first = WorldWriter::create(path);
    ASSERT_TRUE(first);
    const Result<WorldWriter> second = WorldWriter::create(path);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::kIo);
    EXPECT_NE(second.error().what.find("another bake"), std::string::npos) << second.error().what;
    putTables(first.value(), "first");
    ASSERT_TRUE(first.value().finish());
    EXPECT_TRUE(WorldStore::open(path));
}

TEST(Store, RefusesPlacesThatCannotBeWritten) {
    TempFolder folder;
    for (const std::string& path : {folder.file("no/such/folder/w.world"), folder.file(""), std::string()}) {
        const Result<WorldWriter> writer = WorldWriter::create(path);
        ASSERT_FALSE(writer) << path;
        EXPECT_EQ(writer.error().code, ErrorCode::kIo);
    }
    EXPECT_TRUE(folder.list().empty());
}

TEST(Store, NamesWhatIsNoWorld) {
    TempFolder folder;
    expectRefused(folder.file("none"), ErrorCode::kNotFound, "no such file");
    std::filesystem::create_directory(folder.file("dir"));
    expectRefused(folder.file("dir"), ErrorCode::kBadData, "is not a file");
    writeFile(folder.file("empty"), "");
    expectRefused(folder.file("empty"), ErrorCode::kBadData, "is empty");
    writeFile(folder.file("text"), std::string(9000, 'a'));
    expectRefused(folder.file("text"), ErrorCode::kBadData, "is not a world");
    writeFile(folder.file("short"), "SQLite for");
    expectRefused(folder.file("short"), ErrorCode::kBadData, "is truncated");

    writeFile(folder.file("other"), "");
    cutInto(folder.file("other"), "CREATE TABLE blob(x)");
    expectRefused(folder.file("other"), ErrorCode::kBadData, "not a world");
    cutInto(folder.file("other"),
            "PRAGMA application_id=" + std::to_string(kApplicationId) + "; PRAGMA user_version=" + std::to_string(kWorldVersion));
    expectRefused(folder.file("other"), ErrorCode::kBadData, "its tables are not those of a world");

    writeWorld(folder.file("more"));
    cutInto(folder.file("more"), "CREATE VIEW v AS SELECT 1");
    expectRefused(folder.file("more"), ErrorCode::kBadData, "its tables are not those of a world");
    writeWorld(folder.file("view"));
    cutInto(folder.file("view"), "ALTER TABLE blob RENAME TO b; CREATE VIEW blob AS SELECT * FROM b");
    expectRefused(folder.file("view"), ErrorCode::kBadData, "its tables are not those of a world");

    writeWorld(folder.file("wal"));
    cutInto(folder.file("wal"), "PRAGMA journal_mode=WAL");
    const std::vector<std::string> before = folder.list();
    expectRefused(folder.file("wal"), ErrorCode::kBadData, "keeps another journal");
    EXPECT_EQ(folder.list(), before) << "nothing is made beside it";

    writeWorld(folder.file("newer"));
    cutInto(folder.file("newer"), "PRAGMA user_version=" + std::to_string(kWorldVersion + 1));
    expectRefused(folder.file("newer"), ErrorCode::kBadData,
                  "was written by a newer Gnomon (version 3, this one reads up to 2): update Gnomon");
    writeWorld(folder.file("older"));
    cutInto(folder.file("older"), "PRAGMA user_version=1");
    expectRefused(folder.file("older"), ErrorCode::kBadData, "is of version 1, which this Gnomon does not read");
    Result<WorldWriter> writer = WorldWriter::create(folder.file("header"));
    ByteWriter header;
    header.u32(kWorldVersion + 5);
    ASSERT_TRUE(writer.value().put({.kind = BlobKind::kHeader}, header.take()));
    ASSERT_TRUE(writer.value().finish());
    expectRefused(folder.file("header"), ErrorCode::kBadData, "was written by a newer Gnomon (version 7");

    for (const char* kind : {"0", "1", "2"}) {
        writeWorld(folder.file("gap"));
        cutInto(folder.file("gap"), std::string("DELETE FROM blob WHERE kind=") + kind);
        expectRefused(folder.file("gap"), ErrorCode::kBadData, "the row is missing");
    }
}

TEST(Store, RefusesEveryTruncationAndAnyTail) {
    TempFolder folder;
    bakeWorld(folder.file("w"), {.chunksAside = 2, .meshes = 2, .instances = 3, .meshSide = 3});
    const std::string whole = readFile(folder.file("w"));
    const std::string path = folder.file("cut");
    for (size_t length = whole.size(); length-- > 0;) {
        if (length == whole.size() - 1) writeFile(path, whole);
        std::filesystem::resize_file(path, length);
        const Result<WorldStore> store = WorldStore::open(path);
        ASSERT_FALSE(store) << "cut to " << length << " of " << whole.size();
        ASSERT_EQ(store.error().code, ErrorCode::kBadData) << store.error().what;
    }
    for (const size_t more : {1, 100, 4096}) {
        writeFile(path, whole + std::string(more, '\0'));
        expectRefused(path, ErrorCode::kBadData, "bytes follow its end");
    }
}

// A flipped bit is seen, or it is where it does not matter: then the world is the same.
TEST(Store, SeesEveryFlippedBitThatMatters) {
    TempFolder folder;
    bakeWorld(folder.file("w"), {.chunksAside = 2, .meshes = 2, .instances = 3, .meshSide = 3});
    const std::string whole = readFile(folder.file("w"));
    const uint64_t hash = WorldStore::open(folder.file("w")).value().contentHash().value();
    const std::string path = folder.file("flipped");
    std::mt19937 rng(23);
    size_t seen = 0, harmless = 0;
    writeFile(path, whole);
    std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
    const auto set = [&file](size_t at, char byte) {
        file.seekp(static_cast<std::streamoff>(at));
        file.put(byte).flush();
    };
    // Every byte of the headers, every fifth or so of the rest: a whole world would take a minute.
    size_t tried = 0;
    for (size_t at = 0; at < whole.size(); at += at < 200 ? 1 : 1 + rng() % 9) {
        set(tried, whole[tried]);
        tried = at;
        set(at, static_cast<char>(whole[at] ^ 1 << rng() % 8));
        const Result<WorldStore> store = WorldStore::open(path);
        if (!store || !store.value().check().empty()) {
            ++seen;
            continue;
        }
        ++harmless;
        const Result<uint64_t> again = store.value().contentHash();
        ASSERT_TRUE(again && again.value() == hash) << "byte " << at;
    }
    EXPECT_GT(seen, 500u);
    EXPECT_GT(harmless, 500u) << "unused parts of pages";
    EXPECT_EQ(folder.list(), (std::vector<std::string>{"flipped", "w"}));
}

// Damage in many places at once, as a bad disk makes it: no crash, no hang, no answer that is not true.
TEST(Store, SurvivesWreckedPages) {
    TempFolder folder;
    bakeWorld(folder.file("w"), {.chunksAside = 4, .meshes = 3, .meshSide = 4});
    const std::string whole = readFile(folder.file("w"));
    const uint64_t hash = WorldStore::open(folder.file("w")).value().contentHash().value();
    std::mt19937 rng(24);
    for (int step = 0; step < 400; ++step) {
        std::string bytes = whole;
        // The first 100 bytes stay: else most are refused before SQLite sees them.
        for (uint32_t n = 1 + rng() % 40; n > 0; --n) {
            const size_t at = 100 + rng() % (bytes.size() - 200), length = 1 + rng() % 64;
            const size_t from = rng() % (bytes.size() - 100);
            for (size_t i = 0; i < length && at + i < bytes.size(); ++i)
                bytes[at + i] = n % 2 ? static_cast<char>(rng()) : whole[from + i];
        }
        writeFile(folder.file("wreck"), bytes);
        const Result<WorldStore> store = WorldStore::open(folder.file("wreck"));
        if (!store || !store.value().check().empty()) continue;
        ASSERT_EQ(store.value().contentHash().value(), hash) << "step " << step;
    }
}

TEST(Store, SealsRowsToTheirKeys) {
    TempFolder folder;
    bakeWorld(folder.file("w"), {});
    // Two meshes of the same world change places: both rows are whole, both are in the wrong place.
    cutInto(folder.file("w"),
            "UPDATE blob SET x=100 WHERE kind=4 AND x=0; UPDATE blob SET x=0 WHERE kind=4 AND x=1; "
            "UPDATE blob SET x=1 WHERE kind=4 AND x=100");
    const Result<WorldStore> store = WorldStore::open(folder.file("w"));
    ASSERT_TRUE(store);
    for (const uint32_t id : {0u, 1u}) {
        const Result<Mesh> mesh = store.value().readMesh(id);
        ASSERT_FALSE(mesh);
        EXPECT_NE(mesh.error().what.find("mesh " + std::to_string(id) + " level 0: its checksum"),
                  std::string::npos)
            << mesh.error().what;
    }
    EXPECT_TRUE(store.value().readMesh(2));
}

/// The seal, from its description.
uint64_t sealOf(const BlobKey& key, int32_t codec, uint64_t rawSize, const Bytes& data) {
    ByteWriter w;
    for (const int32_t v : {key.x, key.y, key.z, key.lod, static_cast<int32_t>(key.kind), codec}) w.i32(v);
    w.u64(rawSize);
    return hashBytes(data, hashBytes(w.take()));
}

TEST(Blob, BelievesNoSizeEvenUnderAGoodSeal) {
    const BlobKey key{1, 2, 3, 4, BlobKind::kMesh};
    std::mt19937 rng(25);
    const Bytes raw = randomBytes(5000, true, rng);
    const PackedBlob blob = packBlob(key, raw).value();
    ASSERT_EQ(blob.codec, BlobCodec::kZstd);
    const auto unpack = [&](int64_t codec, uint64_t size, const Bytes& data) {
        return unpackBlob(key, codec, static_cast<int64_t>(size),
                          sealOf(key, static_cast<int32_t>(codec), size, data), data);
    };
    ASSERT_TRUE(unpack(1, 5000, blob.data));
    EXPECT_EQ(unpack(1, 5000, blob.data).value(), raw);
    for (const uint64_t size :
         {uint64_t{0}, uint64_t{4999}, uint64_t{5001}, kMaxBlobBytes, kMaxBlobBytes + 1, ~uint64_t{0}})
        EXPECT_FALSE(unpack(1, size, blob.data)) << size;
    EXPECT_FALSE(unpack(2, 5000, blob.data));
    EXPECT_FALSE(unpack(0, 5000, blob.data));
    for (size_t length = 0; length < blob.data.size(); ++length)
        EXPECT_FALSE(unpack(
            1, 5000, Bytes(blob.data.begin(), blob.data.begin() + static_cast<std::ptrdiff_t>(length))));
    for (size_t at = 0; at < blob.data.size(); ++at) {
        Bytes data = blob.data;
        data[at] ^= std::byte{16};
        const Result<Bytes> result = unpack(1, 5000, data);
        EXPECT_TRUE(!result || result.value().size() == 5000);
    }
}

TEST(Store, OpensOddNamesAndFoldersWithoutWriting) {
    TempFolder folder;
    for (const char* name : {"a b.world", "what?.world", "50%41.world", "#1.world", "file:x", "ü.world"}) {
        writeWorld(folder.file(name), name);
        const Result<WorldStore> store = WorldStore::open(folder.file(name));
        ASSERT_TRUE(store) << store.error().what;
        EXPECT_EQ(store.value().header().source, name);
    }
    EXPECT_EQ(folder.list().size(), 6u);
    const std::filesystem::path here = std::filesystem::current_path();
    std::filesystem::current_path(folder.file(""));
    const Result<WorldStore> relative = WorldStore::open("a b.world");
    std::filesystem::current_path(here);
    ASSERT_TRUE(relative);
    EXPECT_TRUE(relative.value().contentHash()) << "the current folder may change";

    ::chmod(folder.file("").c_str(), 0555);
    ::chmod(folder.file("a b.world").c_str(), 0444);
    const Result<WorldStore> locked = WorldStore::open(folder.file("a b.world"));
    ASSERT_TRUE(locked);
    EXPECT_TRUE(locked.value().contentHash());
    EXPECT_EQ(folder.list().size(), 6u);
    ::chmod(folder.file("").c_str(), 0755);
}

TEST(Store, NeverMixesAWorldWithItsSuccessor) {
    TempFolder folder;
    const std::string path = folder.file("w");
    bakeWorld(path, {.seed = 1});
    const Result<WorldStore> store = WorldStore::open(path);
    ASSERT_TRUE(store);
    const BlobKey key{0, 0, 0, 0, BlobKind::kMesh};
    const Bytes old = store.value().readBlob(key).value();
    bakeWorld(path, {.seed = 2});
    ASSERT_NE(WorldStore::open(path).value().readBlob(key).value(), old);
    EXPECT_EQ(store.value().readBlob(key).value(), old) << "the connection that is open goes on";
    std::atomic<int> mixed = 0;
    std::vector<std::thread> threads;
    for (int t = 0; t < 8; ++t)
        threads.emplace_back([&] {
            for (int i = 0; i < 100; ++i) {
                const Result<Bytes> raw = store.value().readBlob(key);
                if (raw ? raw.value() != old : raw.error().what.find("was replaced") == std::string::npos)
                    ++mixed;
            }
        });
    for (std::thread& t : threads) t.join();
    EXPECT_EQ(mixed, 0);
}

TEST(Store, AFullDiskLeavesTheOldWorldAndNothingElse) {
    TempFolder folder;
    const std::string path = folder.file("w");
    writeWorld(path, "old");
    const std::string before = readFile(path);
    // From a disk with room for nothing to one that fills up in the last steps.
    for (const rlim_t limit : {0, 1000, 20000, 300000, 1000000, 2000000, 3000000}) {
        bool failed = false;
        {
            const FileSizeLimit full(limit);
            Result<WorldWriter> writer = WorldWriter::create(path);
            Result<Done> done = writer ? Result<Done>(Done{}) : Result<Done>(writer.error());
            std::mt19937 rng(26);
            for (int32_t i = 0; done && i < 300; ++i)
                done = writer.value().put({i, 0, 0, 0, BlobKind::kMesh}, randomBytes(10000, false, rng));
            if (done) done = writer.value().finish();
            failed = !done;
            if (failed) {
                EXPECT_EQ(done.error().code, ErrorCode::kIo) << limit << ": " << done.error().what;
                EXPECT_NE(done.error().what.find("free some space"), std::string::npos) << done.error().what;
            }
        }
        EXPECT_TRUE(failed) << limit;
        EXPECT_EQ(folder.list(), std::vector<std::string>{"w"}) << limit;
        EXPECT_EQ(readFile(path), before) << limit;
    }
}

TEST(Store, ToStringNamesTheRow) {
    EXPECT_EQ(toString(ChunkKey{12, 0, -4}), "(12,0,-4)");
    EXPECT_EQ(toString(BlobKey{.kind = BlobKind::kHeader}), "header");
    EXPECT_EQ(toString(BlobKey{7, 0, 0, 2, BlobKind::kMesh}), "mesh 7 level 2");
    EXPECT_EQ(toString(BlobKey{1, 0, -2, 0, BlobKind::kTerrainMesh}), "terrain mesh (1,0,-2) level 0");
    EXPECT_EQ(toString(BlobKey{1, 0, -2, 0, static_cast<BlobKind>(99)}), "unknown kind (1,0,-2) level 0");
}

}  // namespace
