#include "world/streamer.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <set>

#include "random_world.h"
#include "world/bake.h"
#include "world/codec.h"
#include "world/database.h"

namespace {

using namespace world;
using world_tests::randomSource;
using world_tests::TempFolder;

constexpr uint64_t kPlenty = 1ull << 30;

/// Accepts boxes that overlap a column around a point, the way a camera wants chunks.
std::function<bool(const Box&)> around(glm::dvec3 p, double reach) {
    return [p, reach](const Box& b) {
        return b.min.x <= p.x + reach && b.max.x >= p.x - reach && b.min.z <= p.z + reach &&
               b.max.z >= p.z - reach;
    };
}

class StreamerTest : public ::testing::Test {
protected:
    void bakeAndOpen(const world_tests::RandomWorld& options) {
        ASSERT_TRUE(bake(randomSource(options), path(), {}));
        reopen();
    }
    void reopen() {
        Result<WorldStore> store = WorldStore::open(path());
        ASSERT_TRUE(store) << store.error().what;
        store_ = std::make_unique<WorldStore>(std::move(store.value()));
    }
    /// Runs SQL on the closed world.
    void cutInto(const std::string& sql) {
        store_.reset();
        {
            Result<Database> database = Database::openEmpty(path());
            ASSERT_TRUE(database && database.value().run(sql));
        }
        reopen();
    }
    std::string path() const { return folder_.file("w"); }

    TempFolder folder_;
    std::unique_ptr<WorldStore> store_;
};

/// What a streamer holds, from its events alone and from the store's list of rows.
struct Model {
    explicit Model(const WorldStore& world) : store(world) {
        const std::vector<BlobInfo> rows = store.listBlobs().value();
        for (const BlobInfo& b : rows) {
            if (b.key.kind == BlobKind::kMesh) meshBytes[static_cast<uint32_t>(b.key.x)] += b.rawBytes;
            if (b.key.kind == BlobKind::kInstances || b.key.kind == BlobKind::kTerrainMesh)
                chunkBytes[{b.key.x, b.key.y, b.key.z}] += b.rawBytes;
        }
    }
    void apply(const StreamEvents& events) {
        ASSERT_TRUE(std::is_sorted(events.departures.begin(), events.departures.end()));
        ASSERT_TRUE(std::is_sorted(events.meshArrivals.begin(), events.meshArrivals.end()));
        ASSERT_TRUE(std::is_sorted(events.meshDepartures.begin(), events.meshDepartures.end()));
        uint64_t read = 0;
        for (const ChunkKey key : events.departures) ASSERT_EQ(chunks.erase(key), 1u) << toString(key);
        for (const uint32_t id : events.meshDepartures) ASSERT_EQ(meshes.erase(id), 1u) << id;
        for (const uint32_t id : events.meshArrivals) {
            ASSERT_TRUE(meshes.insert(id).second) << id;
            read += meshBytes[id];
        }
        for (size_t i = 0; i < events.arrivals.size(); ++i) {
            const ChunkKey key = events.arrivals[i]->key;
            ASSERT_TRUE(i == 0 || events.arrivals[i - 1]->key < key);
            ASSERT_TRUE(chunks.insert(key).second) << toString(key);
            read += chunkBytes[key];
        }
        ASSERT_EQ(events.bytesRead, read);
    }
    /// Meshes are those of the chunks; sizes add up.
    void agrees(const Streamer& streamer) {
        std::set<uint32_t> used = pinned;
        uint64_t bytes = 0;
        for (const ChunkRecord& r : store.chunks()) {
            ASSERT_EQ(streamer.resident(r.key), chunks.contains(r.key)) << toString(r.key);
            if (!chunks.contains(r.key)) continue;
            used.insert(r.meshes.begin(), r.meshes.end());
            bytes += chunkBytes[r.key];
        }
        std::set<uint32_t> held = meshes;
        held.insert(pinned.begin(), pinned.end());
        ASSERT_EQ(held, used);
        for (const uint32_t id : used) {
            bytes += meshBytes[id];
            ASSERT_EQ(streamer.mesh(id).levels.size(), store.meshes()[id].levels.size());
        }
        ASSERT_EQ(streamer.residentBytes(), bytes);
        ASSERT_EQ(streamer.residentChunks(), chunks.size());
    }

    const WorldStore& store;
    std::map<uint32_t, uint64_t> meshBytes;
    std::map<ChunkKey, uint64_t> chunkBytes;
    std::set<ChunkKey> chunks;
    std::set<uint32_t> meshes, pinned;
};

TEST_F(StreamerTest, HoldsWhatIsWantedAndKept) {
    for (const int far : {0, 31250}) {  // 1000 km out
        bakeAndOpen({.seed = 51, .chunksAside = 12, .firstChunk = far, .meshes = 30, .instances = 6});
        std::vector<std::string> logs;
        for (const size_t threads : {1, 2, 5}) {
            const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
            Streamer streamer(*store_, kPlenty);
            Model model(*store_);
            std::set<ChunkKey> expected;
            std::mt19937 rng(52);
            std::uniform_real_distribution<double> stride(-40, 40);
            const glm::dvec3 low(far * 32.0, 0, far * 32.0), high = low + glm::dvec3(12 * 32.0, 0, 12 * 32.0);
            glm::dvec3 p = (low + high) * 0.5;
            std::string log;
            for (int step = 0; step < 150; ++step) {
                p += glm::dvec3(stride(rng), 0, stride(rng)) * (step % 11 == 0 ? 8.0 : 1.0);
                p = glm::clamp(p, low, high);
                const auto want = around(p, 50), keep = around(p, 70);
                for (const ChunkRecord& r : store_->chunks()) {
                    if (!keep(r.bounds)) expected.erase(r.key);
                    if (want(r.bounds)) expected.insert(r.key);
                }
                const Result<StreamEvents> events = streamer.advance(want, keep);
                ASSERT_TRUE(events) << events.error().what;
                ASSERT_TRUE(events.value().errors.empty());
                ASSERT_NO_FATAL_FAILURE(model.apply(events.value())) << "step " << step;
                ASSERT_EQ(model.chunks, expected) << "step " << step;
                ASSERT_NO_FATAL_FAILURE(model.agrees(streamer)) << "step " << step;
                for (const auto& chunk : events.value().arrivals) {
                    ASSERT_EQ(chunk->instances.size(),
                              store_->readChunk(chunk->key).value().instances.size());
                    log += " in " + toString(chunk->key);
                }
                for (const ChunkKey key : events.value().departures) log += " out " + toString(key);
                for (const uint32_t id : events.value().meshArrivals) log += " mesh " + std::to_string(id);
                for (const uint32_t id : events.value().meshDepartures)
                    log += " no mesh " + std::to_string(id);
                if (step % 5 == 0) {  // nothing moved, nothing to do
                    const Result<StreamEvents> again = streamer.advance(want, keep);
                    ASSERT_TRUE(again && again.value().arrivals.empty() && again.value().departures.empty() &&
                                again.value().meshArrivals.empty() && again.value().meshDepartures.empty());
                }
            }
            logs.push_back(log);
            const auto none = [](const Box&) { return false; };
            ASSERT_NO_FATAL_FAILURE(model.apply(streamer.advance(none, none).value()));
            EXPECT_TRUE(model.chunks.empty() && model.meshes.empty());
            EXPECT_EQ(streamer.residentBytes(), 0u);
        }
        EXPECT_GT(logs[0].size(), 1000u);
        EXPECT_EQ(logs[0], logs[1]);
        EXPECT_EQ(logs[0], logs[2]);
    }
}

TEST_F(StreamerTest, BudgetIsAskedBeforeAnythingChanges) {
    bakeAndOpen({.seed = 53, .chunksAside = 10, .meshes = 20});
    const auto all = [](const Box&) { return true; };
    const auto none = [](const Box&) { return false; };
    Streamer plenty(*store_, kPlenty);
    ASSERT_TRUE(plenty.advance(all, all));
    const uint64_t whole = plenty.residentBytes();

    Streamer exact(*store_, whole);
    EXPECT_TRUE(exact.advance(all, all));
    EXPECT_EQ(exact.residentBytes(), whole);

    Streamer tight(*store_, whole - 1);
    const auto some = around({0, 0, 0}, 40);
    ASSERT_TRUE(tight.advance(some, all));
    const size_t before = tight.residentChunks();
    const uint64_t bytes = tight.residentBytes();
    ASSERT_GT(before, 0u);
    const Result<StreamEvents> refused = tight.advance(all, all);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kLimit);
    EXPECT_NE(refused.error().what.find("--memory-budget"), std::string::npos) << refused.error().what;
    EXPECT_NE(refused.error().what.find(" MiB"), std::string::npos);
    EXPECT_EQ(tight.residentChunks(), before);
    EXPECT_EQ(tight.residentBytes(), bytes);
    EXPECT_TRUE(tight.advance(none, none)) << "it goes on after a refusal";
    EXPECT_EQ(tight.residentBytes(), 0u);
}

TEST_F(StreamerTest, HysteresisGivesWayToTheBudget) {
    bakeAndOpen({.seed = 54, .chunksAside = 10, .meshes = 20});
    const auto all = [](const Box&) { return true; };
    Streamer probe(*store_, kPlenty);
    uint64_t most = 0;
    for (int x = -2; x < 8; ++x) {
        const auto want = around({x * 32.0 + 16, 0, 96}, 40);
        ASSERT_TRUE(probe.advance(want, want));
        most = std::max(most, probe.residentBytes());
    }
    // Room for any one place: everything is kept until that is too much, then only what is wanted.
    Streamer streamer(*store_, most);
    Model model(*store_);
    bool gaveWay = false;
    for (int x = -2; x < 8; ++x) {
        const auto want = around({x * 32.0 + 16, 0, 96}, 40);
        const Result<StreamEvents> events = streamer.advance(want, all);
        ASSERT_TRUE(events) << events.error().what;
        gaveWay = gaveWay || !events.value().departures.empty();
        ASSERT_NO_FATAL_FAILURE(model.apply(events.value()));
        ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
        EXPECT_LE(streamer.residentBytes(), most);
        for (const ChunkRecord& r : store_->chunks())
            EXPECT_TRUE(!want(r.bounds) || streamer.resident(r.key));
    }
    EXPECT_TRUE(gaveWay);
}

TEST_F(StreamerTest, AsksAboutWhatIsNearAlone) {
    std::vector<size_t> asked, chunks;
    for (const int aside : {16, 48}) {
        bakeAndOpen({.seed = 59, .chunksAside = aside, .meshes = 3, .instances = 2});
        chunks.push_back(store_->chunks().size());
        Streamer streamer(*store_, kPlenty);
        const auto area = around({8 * 32.0, 0, 8 * 32.0}, 60);
        size_t calls = 0;
        const auto want = [&](const Box& b) {
            ++calls;
            return area(b);
        };
        ASSERT_GT(streamer.advance(want, want).value().arrivals.size(), 8u);
        asked.push_back(calls);
        calls = 0;
        EXPECT_TRUE(streamer.advance(want, want).value().arrivals.empty());
        EXPECT_EQ(calls, asked.back() + streamer.residentChunks());
    }
    EXPECT_GT(chunks[1], 8 * chunks[0]);
    EXPECT_LT(asked[1], asked[0] + 100);  // a few large cells more
}

TEST_F(StreamerTest, ABadChunkIsOneErrorAndTheRestGoesOn) {
    bakeAndOpen({.seed = 55, .chunksAside = 10, .meshes = 20});
    const ChunkKey bad = store_->chunks()[7].key;
    cutInto("UPDATE blob SET checksum=checksum+1 WHERE kind=5 AND x=" + std::to_string(bad.x) +
            " AND z=" + std::to_string(bad.z));
    const auto all = [](const Box&) { return true; };
    const auto none = [](const Box&) { return false; };
    Streamer streamer(*store_, kPlenty);
    Model model(*store_);
    const Result<StreamEvents> events = streamer.advance(all, all);
    ASSERT_TRUE(events);
    ASSERT_EQ(events.value().errors.size(), 1u);
    EXPECT_EQ(events.value().errors[0].code, ErrorCode::kBadData);
    EXPECT_EQ(events.value().errors[0].what.find("chunk " + toString(bad) + " is left out: " + path() +
                                                 ": instances " + toString(bad)),
              0u)
        << events.value().errors[0].what;
    ASSERT_NO_FATAL_FAILURE(model.apply(events.value()));
    ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
    EXPECT_EQ(streamer.residentChunks(), store_->chunks().size() - 1);
    EXPECT_FALSE(streamer.resident(bad));

    ASSERT_NO_FATAL_FAILURE(model.apply(streamer.advance(none, none).value()));
    const Result<StreamEvents> again = streamer.advance(all, all);
    ASSERT_TRUE(again);
    EXPECT_TRUE(again.value().errors.empty()) << "not tried again";
    EXPECT_EQ(streamer.residentChunks(), store_->chunks().size() - 1);
}

TEST_F(StreamerTest, ABadMeshKeepsItsChunksOut) {
    bakeAndOpen({.seed = 56, .chunksAside = 10, .meshes = 40, .instances = 4});
    cutInto("UPDATE blob SET checksum=checksum+1 WHERE kind=4 AND (x=3 OR x=17)");
    Streamer streamer(*store_, kPlenty);
    Model model(*store_);
    std::set<ChunkKey> left, spoiled;
    for (const ChunkRecord& r : store_->chunks())
        if (std::count(r.meshes.begin(), r.meshes.end(), 3u) +
                std::count(r.meshes.begin(), r.meshes.end(), 17u) >
            0)
            spoiled.insert(r.key);
    ASSERT_FALSE(spoiled.empty());
    std::mt19937 rng(57);
    std::uniform_real_distribution<double> place(-64, 256);
    for (int step = 0; step < 200; ++step) {
        const glm::dvec3 p(place(rng), 0, place(rng));
        const auto want = around(p, 60), keep = around(p, 80);
        const Result<StreamEvents> events = streamer.advance(want, keep);
        ASSERT_TRUE(events);
        for (const Error& e : events.value().errors) {
            EXPECT_NE(e.what.find("is left out: "), std::string::npos) << e.what;
            EXPECT_TRUE(e.what.find("mesh 3 level") != std::string::npos ||
                        e.what.find("mesh 17 level") != std::string::npos)
                << e.what;
        }
        ASSERT_NO_FATAL_FAILURE(model.apply(events.value())) << "step " << step;
        ASSERT_NO_FATAL_FAILURE(model.agrees(streamer)) << "step " << step;
        for (const ChunkRecord& r : store_->chunks())
            if (want(r.bounds)) {
                EXPECT_EQ(streamer.resident(r.key), !spoiled.contains(r.key));
                if (spoiled.contains(r.key)) left.insert(r.key);
            }
    }
    EXPECT_EQ(left, spoiled) << "the walk has met every spoiled chunk";
    const Result<Done> pinned = streamer.pin(3);
    ASSERT_FALSE(pinned);
    EXPECT_EQ(pinned.error().code, ErrorCode::kBadData);
}

TEST_F(StreamerTest, PinsStay) {
    bakeAndOpen({.seed = 58, .chunksAside = 6, .meshes = 10});
    const auto all = [](const Box&) { return true; };
    const auto none = [](const Box&) { return false; };
    Streamer streamer(*store_, kPlenty);
    Model model(*store_);
    ASSERT_TRUE(streamer.pin(2));
    ASSERT_TRUE(streamer.pin(2));
    model.pinned = {2};
    ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
    const Result<StreamEvents> in = streamer.advance(all, all);
    EXPECT_FALSE(std::count(in.value().meshArrivals.begin(), in.value().meshArrivals.end(), 2u));
    ASSERT_NO_FATAL_FAILURE(model.apply(in.value()));
    ASSERT_TRUE(streamer.pin(5));
    model.pinned.insert(5);
    ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
    const Result<StreamEvents> out = streamer.advance(none, none);
    for (const uint32_t id : {2u, 5u})
        EXPECT_FALSE(std::count(out.value().meshDepartures.begin(), out.value().meshDepartures.end(), id));
    EXPECT_EQ(streamer.residentChunks(), 0u);
    EXPECT_FALSE(streamer.mesh(2).levels.empty());
    EXPECT_FALSE(streamer.mesh(5).levels.empty());

    EXPECT_EQ(streamer.pin(1000).error().code, ErrorCode::kNotFound);
    Streamer poor(*store_, 10);
    EXPECT_EQ(poor.pin(0).error().code, ErrorCode::kLimit);
    EXPECT_EQ(poor.residentBytes(), 0u);
}

}  // namespace
