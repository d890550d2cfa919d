// tests/world/streamer_clocks_test.cpp — chunks that come late: the virtual disk, failing reads, the live clock.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <limits>
#include <random>
#include <set>
#include <string>
#include <thread>

#include "streamed_world.h"
#include "world/streamer.h"

namespace {

using namespace world;
using namespace world_tests;

/// What a drive under the virtual clock did, step by step, and what it did in all.
struct Drive {
    std::string log;
    uint64_t errors = 0, read = 0, again = 0, lacks = 0, refined = 0, uploaded = 0;
    std::set<ChunkKey> there;
};

Drive drive(const WorldStore& store, const StreamerConfig& config, int steps, int rest) {
    Drive d;
    Streamer streamer(store, config);
    Model model(store);
    for (int s = 0; s < steps + rest; ++s) {
        const double now = s / 30.0;
        const glm::dvec3 p(-64 + 2.0 * std::min(s, steps), 0, 60);
        if (s % 4 == 0 && s <= steps) streamer.want(around(p, 60, 90), now);
        const StreamEvents events = streamer.advance(now);
        for (const auto& chunk : events.arrivals) d.refined += model.chunks.contains(chunk->key);
        const uint64_t before = streamer.geometryBytes();
        model.apply(events);
        model.agrees(streamer);
        d.errors += events.errors.size();
        d.read += events.bytesRead;
        d.again += events.bytesAgain;
        d.lacks += streamer.lacking().size();
        d.uploaded = std::max(d.uploaded, before);
        for (const auto& chunk : events.arrivals) d.log += " in " + toString(chunk->key) + std::to_string(chunk->firstLevel);
        for (const ChunkKey key : events.departures) d.log += " out " + toString(key);
        d.log += " read " + std::to_string(events.bytesRead);
    }
    EXPECT_TRUE(streamer.settled());
    for (const auto& entry : model.chunks) d.there.insert(entry.first);
    return d;
}

TEST_F(StreamerTest, TheVirtualDiskIsLateTheSameWayEveryTime) {
    bakeAndOpen({.seed = 62, .chunksAside = 10, .meshes = 30});
    StreamerConfig lockStep, slow;
    slow.clock = Clock::kVirtual;
    slow.disk.latency = 0.1;
    const Drive there = drive(*store_, lockStep, 120, 90);
    EXPECT_EQ(there.lacks, 0u);
    std::vector<Drive> drives;
    for (const size_t threads : {1, 2, 5}) {
        const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
        drives.push_back(drive(*store_, slow, 120, 90));
    }
    EXPECT_EQ(drives[0].log, drives[1].log);
    EXPECT_EQ(drives[0].log, drives[2].log);
    EXPECT_GT(drives[0].lacks, 0u);
    EXPECT_GT(drives[0].refined, 3u) << "coarse levels come first";
    EXPECT_EQ(drives[0].there, there.there) << "once the eye rests all that is wanted is there";
    slow.disk.seed = 2;
    EXPECT_NE(drive(*store_, slow, 120, 90).log, drives[0].log);

    StreamerConfig quick = slow;
    quick.disk.latency = 0.001;
    EXPECT_LT(drive(*store_, quick, 120, 90).lacks, drives[0].lacks / 2);

    StreamerConfig stalls = quick;
    stalls.disk.stallShare = 0.2;
    stalls.disk.stallSeconds = 0.5;
    const Drive stalled = drive(*store_, stalls, 120, 120);
    EXPECT_GT(stalled.lacks, drive(*store_, quick, 120, 90).lacks);
    EXPECT_EQ(stalled.there, there.there);
}

TEST_F(StreamerTest, FailedReadsAreTriedAgainAndCorruptChunksAreNot) {
    bakeAndOpen({.seed = 62, .chunksAside = 10, .meshes = 30});
    StreamerConfig config;
    config.clock = Clock::kVirtual;
    const Drive sound = drive(*store_, config, 120, 90);
    config.disk.failShare = 0.2;
    const Drive failing = drive(*store_, config, 120, 300);
    EXPECT_EQ(failing.errors, 0u);
    EXPECT_EQ(failing.there, sound.there);
    EXPECT_GT(failing.lacks, sound.lacks);

    config.disk.failShare = 0;
    config.disk.corruptShare = 0.2;
    const Drive corrupt = drive(*store_, config, 120, 90);
    EXPECT_GT(corrupt.errors, 1u);
    EXPECT_LT(corrupt.there.size(), sound.there.size());
    for (const ChunkKey key : corrupt.there) EXPECT_TRUE(sound.there.contains(key));

    config.disk.failShare = 1;
    const Drive dead = drive(*store_, config, 120, 300);
    EXPECT_TRUE(dead.there.empty());
    EXPECT_GT(dead.errors, 1u) << "it is given up, and said";
}

TEST_F(StreamerTest, HandsOutNoMoreThanAFrameMayUpload) {
    bakeAndOpen({.seed = 63, .chunksAside = 10, .meshes = 30});
    StreamerConfig config;
    config.clock = Clock::kVirtual;
    config.handOutBytes = 1;
    Streamer streamer(*store_, config);
    streamer.want(all, 0);
    size_t most = 0;
    for (int s = 0; s < 600 && !(s > 0 && streamer.settled()); ++s)
        most = std::max(most, streamer.advance(s / 30.0).arrivals.size());
    EXPECT_EQ(most, 1u);
    EXPECT_TRUE(streamer.lacking().empty());
    EXPECT_EQ(streamer.residentChunks(), store_->chunks().size());
}

TEST_F(StreamerTest, CountsWhatPlacingInstancesCosts) {
    bakeAndOpen({.seed = 63, .chunksAside = 10, .meshes = 30});
    StreamerConfig config;
    config.clock = Clock::kVirtual;
    for (const uint64_t instances : {20, 40}) {
        config.handOutBytes = instances * kPlacingBytes;
        Streamer streamer(*store_, config);
        streamer.want(all, 0);
        size_t severalAtOnce = 0;
        std::set<ChunkKey> known;
        for (int s = 0; s < 600 && !(s > 0 && streamer.settled()); ++s) {
            uint64_t placed = 0;
            const StreamEvents events = streamer.advance(s / 30.0);
            size_t fresh = 0;  // the others are refined
            for (const auto& chunk : events.arrivals) {
                if (!known.insert(chunk->key).second) continue;
                placed += chunk->instances.size();
                ++fresh;
            }
            if (fresh > 1) {
                EXPECT_LE(placed, instances);
                ++severalAtOnce;
            }
        }
        EXPECT_GT(severalAtOnce, 0u);
        EXPECT_EQ(streamer.residentChunks(), store_->chunks().size());
    }
}

TEST_F(StreamerTest, TheLiveClockNeitherWaitsNorLoses) {
    bakeAndOpen({.seed = 64, .chunksAside = 10, .meshes = 30});
    StreamerConfig config;
    config.clock = Clock::kLive;
    for (int run = 0; run < 5; ++run) {
        Streamer streamer(*store_, config);
        Model model(*store_);
        std::mt19937 rng(65);
        std::uniform_real_distribution<double> place(-64, 256);
        for (int s = 0; s < 300; ++s) {
            if (s % 10 == 0) streamer.want(around({place(rng), 0, place(rng)}, 60, 80), s);
            ASSERT_NO_FATAL_FAILURE(model.apply(streamer.advance(s)));
            ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
        }
        if (run == 4) break;  // the last one ends amid its reads
        streamer.want(all, 300);
        for (double now = 300; now < 400000 && (!streamer.settled() || now == 300); ++now) {
            ASSERT_NO_FATAL_FAILURE(model.apply(streamer.advance(now)));
            std::this_thread::yield();
        }
        ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
        EXPECT_TRUE(streamer.lacking().empty());
    }
}

TEST(DiskModel, RefusesNumbersOutOfRange) {
    EXPECT_TRUE(requireDisk({}));
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (const double bad : {-1.0, nan, std::numeric_limits<double>::infinity()}) {
        DiskModel latency, stall, bandwidth, share, spread;
        latency.latency = stall.stallSeconds = bandwidth.bandwidth = share.failShare = spread.spread = bad;
        for (const DiskModel& disk : {latency, stall, bandwidth, share, spread}) {
            const auto done = requireDisk(disk);
            ASSERT_FALSE(done);
            EXPECT_EQ(done.error().code, ErrorCode::kUsage);
        }
    }
    DiskModel channels;
    channels.channels = 0;
    EXPECT_FALSE(requireDisk(channels));
}

}  // namespace
