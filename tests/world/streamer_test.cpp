// tests/world/streamer_test.cpp — what a streamer holds: what is wanted, as far as budgets go, and what can be read.
#include "world/streamer.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "streamed_world.h"

namespace {

using namespace world;
using namespace world_tests;

TEST_F(StreamerTest, HoldsWhatIsWantedAndKept) {
    for (const int far : {0, 31250}) {  // 1000 km out
        bakeAndOpen({.seed = 51, .chunksAside = 12, .firstChunk = far, .meshes = 30, .instances = 6});
        std::vector<std::string> logs;
        for (const size_t threads : {1, 2, 5}) {
            const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
            Streamer streamer(*store_, {});
            Model model(*store_);
            std::map<ChunkKey, size_t> expected;  // finest level
            std::mt19937 rng(52);
            std::uniform_real_distribution<double> stride(-40, 40);
            const glm::dvec3 low(far * 32.0, 0, far * 32.0), high = low + glm::dvec3(12 * 32.0, 0, 12 * 32.0);
            glm::dvec3 p = (low + high) * 0.5;
            std::string log;
            size_t refined = 0;
            for (int s = 0; s < 150; ++s) {
                p += glm::dvec3(stride(rng), 0, stride(rng)) * (s % 11 == 0 ? 8.0 : 1.0);
                p = glm::clamp(p, low, high);
                const Wants wants = around(p, 50, 70);
                for (const ChunkRecord& r : store_->chunks()) {
                    const auto want = wants(r.bounds);
                    if (!want) expected.erase(r.key);
                    if (!want || std::isinf(want->due)) continue;
                    const size_t coarsest = r.terrain.empty() ? 0 : r.terrain.size() - 1;
                    const size_t level = want->error > 0 ? coarsest : 0;
                    const auto known = expected.try_emplace(r.key, level).first;
                    refined += known->second > level;
                    known->second = std::min(known->second, level);
                }
                const StreamEvents events = step(streamer, wants);
                ASSERT_TRUE(events.errors.empty());
                ASSERT_NO_FATAL_FAILURE(model.apply(events)) << "step " << s;
                ASSERT_EQ(model.chunks.size(), expected.size()) << "step " << s;
                for (const auto& [key, level] : expected)
                    ASSERT_EQ(model.chunks.at(key)->firstLevel, level) << toString(key) << " step " << s;
                ASSERT_NO_FATAL_FAILURE(model.agrees(streamer)) << "step " << s;
                ASSERT_TRUE(streamer.settled() && streamer.lacking().empty());
                for (const auto& chunk : events.arrivals) {
                    ASSERT_EQ(chunk->instances.size(),
                              store_->readChunk(chunk->key).value().instances.size());
                    log += " in " + toString(chunk->key) + std::to_string(chunk->firstLevel);
                }
                for (const ChunkKey key : events.departures) log += " out " + toString(key);
                for (const uint32_t id : events.meshArrivals) log += " mesh " + std::to_string(id);
                for (const uint32_t id : events.meshDepartures) log += " no mesh " + std::to_string(id);
                log += " read " + std::to_string(events.bytesRead) + " again " + std::to_string(events.bytesAgain);
                if (s % 5 == 0) {  // nothing moved, nothing to do
                    const StreamEvents again = step(streamer, wants);
                    ASSERT_TRUE(again.arrivals.empty() && again.departures.empty() && again.bytesRead == 0 &&
                                again.meshArrivals.empty() && again.meshDepartures.empty());
                }
            }
            EXPECT_GT(refined, 5u);
            logs.push_back(log);
            ASSERT_NO_FATAL_FAILURE(model.apply(step(streamer, none)));
            EXPECT_TRUE(model.chunks.empty() && model.meshes.empty());
            EXPECT_EQ(streamer.residentBytes(), 0u);
            EXPECT_EQ(streamer.geometryBytes(), 0u);
        }
        EXPECT_GT(logs[0].size(), 1000u);
        EXPECT_EQ(logs[0], logs[1]);
        EXPECT_EQ(logs[0], logs[2]);
    }
}

TEST_F(StreamerTest, RefinedChunksHoldTheLevelsOfTheStore) {
    bakeAndOpen({.seed = 60, .chunksAside = 8, .meshes = 5});
    Streamer streamer(*store_, {});
    const auto coarse = [](const Box&) { return std::optional(Want{0, 0, kAnyError}); };
    (void)step(streamer, coarse);
    const StreamEvents events = step(streamer, all);
    ASSERT_FALSE(events.arrivals.empty());
    for (const auto& chunk : events.arrivals) {
        const Chunk whole = store_->readChunk(chunk->key).value();
        ASSERT_EQ(chunk->terrain.levels.size(), whole.terrain.levels.size());
        for (size_t k = 0; k < whole.terrain.levels.size(); ++k) {
            EXPECT_EQ(chunk->terrain.levels[k].positions, whole.terrain.levels[k].positions);
            EXPECT_EQ(chunk->terrain.levels[k].indices, whole.terrain.levels[k].indices);
        }
        EXPECT_EQ(chunk->terrain.bounds, whole.terrain.bounds);
        EXPECT_EQ(chunk->instances.size(), whole.instances.size());
    }
    EXPECT_EQ(events.bytesAgain, 0u) << "what is there is not read again";
}

/// Coarse levels of all before fine ones of any, the nearest first, and never more than the budget.
TEST_F(StreamerTest, DegradesToWhatFits) {
    bakeAndOpen({.seed = 53, .chunksAside = 10, .meshes = 20});
    const uint64_t needed = whole();
    for (const Clock clock : {Clock::kLockStep, Clock::kVirtual}) {
        for (const uint64_t part : {2, 3, 8, 1000}) {
            StreamerConfig config;
            config.memoryBytes = needed / part;
            config.clock = clock;
            Streamer streamer(*store_, config);
            Model model(*store_);
            std::mt19937 rng(61);
            std::uniform_real_distribution<double> place(-64, 256);
            for (int s = 0; s < 60; ++s) {
                const glm::dvec3 p(place(rng), 0, place(rng));
                const Wants wants = around(p, 1000, 1000);
                streamer.want(wants, s);
                for (double t = s; t < s + 0.9; t += 0.05) {
                    ASSERT_NO_FATAL_FAILURE(model.apply(streamer.advance(t)));
                    ASSERT_LE(streamer.residentBytes(), config.memoryBytes);
                }
                ASSERT_LE(streamer.peakBytes(), config.memoryBytes);
                ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
                size_t lacking = 0;
                for (uint32_t i = 0; i < store_->chunks().size(); ++i) {
                    const auto known = model.chunks.find(store_->chunks()[i].key);
                    lacking += known == model.chunks.end() || known->second->firstLevel > 0;
                }
                ASSERT_EQ(streamer.lacking().size(), lacking);
                ASSERT_GT(lacking, 0u);
            }
            if (part == 1000) {
                EXPECT_LE(model.chunks.size(), 2u);
            } else {
                EXPECT_GT(model.chunks.size(), 1u);
            }
        }
    }
    StreamerConfig config;
    config.geometryBytes = 40 << 10;
    Streamer small(*store_, config);
    (void)step(small, all);
    EXPECT_LE(small.geometryBytes(), config.geometryBytes);
    EXPECT_GT(small.geometryBytes(), config.geometryBytes / 2);
    EXPECT_FALSE(small.lacking().empty());
    const double since = small.lacking()[0].since;
    (void)step(small, all, 7);
    EXPECT_EQ(small.lacking()[0].since, since) << "it has lacked all the time";
}

TEST_F(StreamerTest, WhatIsKeptGivesWayToTheBudget) {
    bakeAndOpen({.seed = 54, .chunksAside = 10, .meshes = 20});
    Streamer probe(*store_, {});
    uint64_t most = 0, largest = 0;
    for (const ChunkRecord& r : store_->chunks()) {
        uint64_t bytes = r.instances * sizeof(Instance);
        for (const LevelRecord& l : r.terrain) bytes += memoryBytes(l);
        largest = std::max(largest, bytes);
    }
    for (int x = -2; x < 8; ++x) {
        (void)step(probe, around({x * 32.0 + 16, 0, 96}, 40, 40));
        most = std::max(most, probe.residentBytes());
    }
    // Room for any one place: everything is kept until that is too much, then only what is wanted.
    StreamerConfig config;
    config.memoryBytes = most + largest;
    Streamer streamer(*store_, config);
    Model model(*store_);
    bool gaveWay = false;
    for (int x = -2; x < 8; ++x) {
        const Wants wants = around({x * 32.0 + 16, 0, 96}, 40, 1e9);
        const StreamEvents events = step(streamer, wants);
        gaveWay = gaveWay || !events.departures.empty();
        ASSERT_NO_FATAL_FAILURE(model.apply(events));
        ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
        EXPECT_LE(streamer.peakBytes(), config.memoryBytes);
        for (const ChunkRecord& r : store_->chunks())
            EXPECT_TRUE(wants(r.bounds)->due > 0 || streamer.resident(r.key));
    }
    EXPECT_TRUE(gaveWay);
}

TEST_F(StreamerTest, AsksAboutWhatIsNearAlone) {
    std::vector<size_t> asked, chunks;
    for (const int aside : {16, 48}) {
        bakeAndOpen({.seed = 59, .chunksAside = aside, .meshes = 3, .instances = 2});
        chunks.push_back(store_->chunks().size());
        Streamer streamer(*store_, {});
        const Wants area = around({8 * 32.0, 0, 8 * 32.0}, 60, 60);
        size_t calls = 0;
        const auto want = [&](const Box& b) {
            ++calls;
            return area(b);
        };
        ASSERT_GT(step(streamer, want).arrivals.size(), 8u);
        asked.push_back(calls);
    }
    EXPECT_GT(chunks[1], 8 * chunks[0]);
    EXPECT_LT(asked[1], asked[0] + 100);  // a few large cells more
}

TEST_F(StreamerTest, ABadChunkIsOneErrorAndTheRestGoesOn) {
    bakeAndOpen({.seed = 55, .chunksAside = 10, .meshes = 20});
    const ChunkKey bad = store_->chunks()[7].key;
    cutInto("UPDATE blob SET checksum=checksum+1 WHERE kind=5 AND x=" + std::to_string(bad.x) +
            " AND z=" + std::to_string(bad.z));
    Streamer streamer(*store_, {});
    Model model(*store_);
    const StreamEvents events = step(streamer, all);
    ASSERT_EQ(events.errors.size(), 1u);
    EXPECT_EQ(events.errors[0].code, ErrorCode::kBadData);
    EXPECT_EQ(events.errors[0].what.find("chunk " + toString(bad) + " is left out: " + path() +
                                         ": instances " + toString(bad)),
              0u)
        << events.errors[0].what;
    ASSERT_NO_FATAL_FAILURE(model.apply(events));
    ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
    EXPECT_EQ(streamer.residentChunks(), store_->chunks().size() - 1);
    EXPECT_FALSE(streamer.resident(bad));
    ASSERT_EQ(streamer.lacking().size(), 1u);
    EXPECT_TRUE(streamer.lacking()[0].absent);
    EXPECT_EQ(store_->chunks()[streamer.lacking()[0].record].key, bad);

    ASSERT_NO_FATAL_FAILURE(model.apply(step(streamer, none)));
    EXPECT_TRUE(step(streamer, all).errors.empty()) << "not tried again";
    EXPECT_EQ(streamer.residentChunks(), store_->chunks().size() - 1);
}

TEST_F(StreamerTest, ABadMeshKeepsItsChunksOut) {
    bakeAndOpen({.seed = 56, .chunksAside = 10, .meshes = 40, .instances = 4});
    cutInto("UPDATE blob SET checksum=checksum+1 WHERE kind=4 AND (x=3 OR x=17)");
    Streamer streamer(*store_, {});
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
    for (int s = 0; s < 200; ++s) {
        const glm::dvec3 p(place(rng), 0, place(rng));
        const Wants wants = around(p, 60, 80);
        const StreamEvents events = step(streamer, wants);
        for (const Error& e : events.errors) {
            EXPECT_NE(e.what.find("is left out: "), std::string::npos) << e.what;
            EXPECT_TRUE(e.what.find("mesh 3 level") != std::string::npos ||
                        e.what.find("mesh 17 level") != std::string::npos)
                << e.what;
        }
        ASSERT_NO_FATAL_FAILURE(model.apply(events)) << "step " << s;
        ASSERT_NO_FATAL_FAILURE(model.agrees(streamer)) << "step " << s;
        for (const ChunkRecord& r : store_->chunks())
            if (const auto want = wants(r.bounds); want && want->due == 0) {
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
    Streamer streamer(*store_, {});
    Model model(*store_);
    ASSERT_TRUE(streamer.pin(2));
    ASSERT_TRUE(streamer.pin(2));
    model.pinned = {2};
    ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
    const StreamEvents in = step(streamer, all);
    EXPECT_FALSE(std::count(in.meshArrivals.begin(), in.meshArrivals.end(), 2u));
    ASSERT_NO_FATAL_FAILURE(model.apply(in));
    ASSERT_TRUE(streamer.pin(5));
    model.pinned.insert(5);
    ASSERT_NO_FATAL_FAILURE(model.agrees(streamer));
    const StreamEvents out = step(streamer, none);
    for (const uint32_t id : {2u, 5u})
        EXPECT_FALSE(std::count(out.meshDepartures.begin(), out.meshDepartures.end(), id));
    EXPECT_EQ(streamer.residentChunks(), 0u);
    EXPECT_FALSE(streamer.mesh(2).levels.empty());
    EXPECT_FALSE(streamer.mesh(5).levels.empty());

    EXPECT_EQ(streamer.pin(1000).error().code, ErrorCode::kNotFound);
    StreamerConfig config;
    config.memoryBytes = 10;
    Streamer poor(*store_, config);
    const Result<Done> refused = poor.pin(0);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kLimit);
    EXPECT_NE(refused.error().what.find("--memory-budget"), std::string::npos);
    EXPECT_EQ(poor.residentBytes(), 0u);
}

TEST_F(StreamerTest, ARefusedChunkIsAsBeforeAndComesWhenThereIsRoom) {
    bakeAndOpen({.seed = 66, .chunksAside = 10, .meshes = 30});
    Streamer streamer(*store_, {});
    const Wants here = around({0, 0, 0}, 80, 80);
    const StreamEvents events = step(streamer, here);
    ASSERT_GT(events.arrivals.size(), 3u);
    const auto withTerrain = std::find_if(events.arrivals.begin(), events.arrivals.end(),
                                          [](const auto& chunk) { return !chunk->terrain.levels.empty(); });
    ASSERT_NE(withTerrain, events.arrivals.end());
    const ChunkKey refused = (*withTerrain)->key;
    streamer.refuse(refused, nullptr, 0);
    EXPECT_FALSE(streamer.resident(refused));
    ASSERT_EQ(streamer.lacking().size(), 1u);
    const uint64_t room = streamer.geometryBytes();
    (void)step(streamer, here);
    EXPECT_LE(streamer.geometryBytes(), room);
    EXPECT_FALSE(streamer.lacking().empty());
    const StreamEvents after = step(streamer, around({0, 0, 0}, 40, 40));
    EXPECT_FALSE(after.departures.empty());
    (void)step(streamer, here);
    EXPECT_TRUE(streamer.resident(refused));
    EXPECT_TRUE(streamer.lacking().empty());
}

}  // namespace
