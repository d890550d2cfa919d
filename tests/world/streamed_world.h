// tests/world/streamed_world.h — a random world with a streamer over it, and a model of what the streamer holds.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "random_world.h"
#include "world/bake.h"
#include "world/database.h"
#include "world/streamer.h"

namespace world_tests {

using namespace world;

inline constexpr double kNever = std::numeric_limits<double>::infinity();
inline constexpr float kAnyError = 1e9f;

/// Wants boxes that overlap a square column around a point the way a camera does: those within `reach` now, finely
/// within half of it, and keeps those within `keep`.
inline Wants around(glm::dvec3 p, double reach, double keep) {
    return [=](const Box& b) -> std::optional<Want> {
        const glm::dvec2 gap(std::max({b.min.x - p.x, p.x - b.max.x, 0.0}), std::max({b.min.z - p.z, p.z - b.max.z, 0.0}));
        const double away = std::max(gap.x, gap.y);
        if (away > keep) return std::nullopt;
        return Want{away <= reach ? 0 : kNever, glm::length(gap), away <= reach / 2 ? 0 : kAnyError};
    };
}

inline std::optional<Want> all(const Box&) { return Want{}; }
inline std::optional<Want> none(const Box&) { return std::nullopt; }

/// One step in which something is wanted anew.
inline StreamEvents step(Streamer& streamer, const Wants& wants, double now = 0) {
    streamer.want(wants, now);
    return streamer.advance(now);
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
    /// What all chunks and meshes take, or their geometry alone.
    uint64_t whole() const {
        Streamer streamer(*store_, {});
        (void)step(streamer, all);
        return streamer.residentBytes();
    }

    TempFolder folder_;
    std::unique_ptr<WorldStore> store_;
};

/// What a streamer holds, from its events alone and from what is decoded.
struct Model {
    explicit Model(const WorldStore& world) : store(world) {}
    static uint64_t bytesOf(const Mesh& mesh) {
        uint64_t bytes = 0;
        for (const MeshLevel& l : mesh.levels)
            bytes += l.positions.size() * sizeof(glm::vec3) + l.indices.size() * sizeof(uint32_t) +
                     l.clusters.size() * sizeof(Cluster);
        return bytes;
    }
    static uint64_t bytesOf(const Chunk& chunk) {
        return chunk.instances.size() * sizeof(Instance) + bytesOf(chunk.terrain);
    }
    static uint64_t geometryOf(const Mesh& mesh) {
        uint64_t bytes = 0;
        for (const MeshLevel& l : mesh.levels)
            bytes += l.positions.size() * sizeof(glm::vec3) + l.indices.size() * sizeof(uint32_t);
        return bytes;
    }
    void apply(const StreamEvents& events) {
        ASSERT_TRUE(std::is_sorted(events.departures.begin(), events.departures.end()));
        ASSERT_TRUE(std::is_sorted(events.meshArrivals.begin(), events.meshArrivals.end()));
        ASSERT_TRUE(std::is_sorted(events.meshDepartures.begin(), events.meshDepartures.end()));
        for (const ChunkKey key : events.departures) ASSERT_EQ(chunks.erase(key), 1u) << toString(key);
        for (const uint32_t id : events.meshDepartures) ASSERT_EQ(meshes.erase(id), 1u) << id;
        for (const uint32_t id : events.meshArrivals) ASSERT_TRUE(meshes.insert(id).second) << id;
        for (size_t i = 0; i < events.arrivals.size(); ++i) {
            const auto& chunk = events.arrivals[i];
            ASSERT_TRUE(i == 0 || events.arrivals[i - 1]->key < chunk->key);
            const auto before = chunks.find(chunk->key);
            if (before != chunks.end()) {
                ASSERT_NE(before->second->firstLevel, chunk->firstLevel);
            }
            chunks[chunk->key] = chunk;
        }
    }
    /// Meshes are those of the chunks; sizes add up while nothing is being read.
    void agrees(const Streamer& streamer) {
        std::set<uint32_t> used = pinned;
        uint64_t bytes = 0, geometry = 0;
        for (const ChunkRecord& r : store.chunks()) {
            ASSERT_EQ(streamer.resident(r.key), chunks.contains(r.key)) << toString(r.key);
            if (!chunks.contains(r.key)) continue;
            used.insert(r.meshes.begin(), r.meshes.end());
            const Chunk& chunk = *chunks.at(r.key);
            ASSERT_EQ(chunk.terrain.levels.size(), r.terrain.size() - chunk.firstLevel);
            bytes += bytesOf(chunk);
            geometry += geometryOf(chunk.terrain);
        }
        std::set<uint32_t> held = meshes;
        held.insert(pinned.begin(), pinned.end());
        // A chunk that left while it was being read lets go of its meshes when that has ended.
        ASSERT_TRUE(std::includes(held.begin(), held.end(), used.begin(), used.end()));
        if (streamer.settled()) {
            ASSERT_EQ(held, used);
        }
        for (const uint32_t id : held) {
            bytes += bytesOf(streamer.mesh(id));
            geometry += geometryOf(streamer.mesh(id));
            ASSERT_EQ(streamer.mesh(id).levels.size(), store.meshes()[id].levels.size());
        }
        ASSERT_EQ(streamer.geometryBytes(), geometry);
        if (streamer.settled()) {
            ASSERT_EQ(streamer.residentBytes(), bytes);
        }
        ASSERT_EQ(streamer.residentChunks(), chunks.size());
    }

    const WorldStore& store;
    std::map<ChunkKey, std::shared_ptr<const Chunk>> chunks;
    std::set<uint32_t> meshes, pinned;
};

}  // namespace world_tests
