// tests/world/procedural_test.cpp — the built-in world: the same for a seed, walkable, and hollow.
#include "world/procedural.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <map>
#include <random>
#include <set>
#include <tuple>

#include "world/procedural_field.h"
#include "world/procedural_meshes.h"
#include "world/procedural_path.h"
#include "world/terrain.h"

namespace world {
namespace {

bool same(const SourceChunk& a, const SourceChunk& b) {
    if (a.names != b.names || a.instances.size() != b.instances.size() ||
        a.terrain.has_value() != b.terrain.has_value())
        return false;
    for (size_t i = 0; i < a.instances.size(); ++i) {
        if (a.instances[i].mesh != b.instances[i].mesh ||
            !(a.instances[i].placement == b.instances[i].placement))
            return false;
    }
    return !a.terrain || a.terrain->levelSet == b.terrain->levelSet;
}

/// A world small enough to open often.
constexpr ProceduralOptions kSmall{.size = 1024, .chunkSize = 128, .voxel = 4, .instances = 3000};

TEST(Procedural, SameSeedSameWorldOnAnyThreads) {
    const Result<BakeSource> a = openProcedural(7, kSmall);
    ASSERT_TRUE(a);
    for (const int threads : {1, 2, 7}) {
        tbb::task_arena arena(threads);
        arena.execute([&] {
            const Result<BakeSource> b = openProcedural(7, kSmall);
            ASSERT_TRUE(b);
            ASSERT_EQ(a.value().chunks, b.value().chunks);
            for (size_t i = 0; i < a.value().chunks.size(); i += 9) {
                const ChunkKey key = a.value().chunks[i];
                ASSERT_TRUE(same(a.value().make(key).value(), b.value().make(key).value())) << toString(key);
            }
        });
    }
    const Result<BakeSource> other = openProcedural(8, kSmall);
    EXPECT_FALSE(same(a.value().make({0, 0, 0}).value(), other.value().make({0, 0, 0}).value()));
}

TEST(Procedural, HasTheSameInstancesInChunksOfAnySize) {
    using Key = std::tuple<double, double, double, uint32_t, float>;
    std::vector<std::set<Key>> worlds;
    for (const double chunkSize : {64.0, 256.0, 512.0}) {
        ProceduralOptions options = kSmall;
        options.chunkSize = chunkSize;
        const Result<BakeSource> source = openProcedural(7, options);
        ASSERT_TRUE(source);
        std::set<Key>& world = worlds.emplace_back();
        size_t count = 0;
        for (const ChunkKey& key : source.value().chunks) {
            const SourceChunk chunk = source.value().make(key).value();
            count += chunk.instances.size();
            for (const Instance& it : chunk.instances) {
                const glm::dvec3 t = it.placement.translation;
                world.insert({t.x, t.y, t.z, it.mesh, it.placement.linear[0][0]});
            }
        }
        EXPECT_EQ(count, kSmall.instances);
        EXPECT_EQ(world.size(), kSmall.instances);
    }
    EXPECT_EQ(worlds[0], worlds[1]);
    EXPECT_EQ(worlds[0], worlds[2]);
}

TEST(Procedural, RefusesOptionsThatMakeNoWorld) {
    const auto code = [](ProceduralOptions options) {
        const Result<BakeSource> source = openProcedural(1, options);
        return source ? ErrorCode::kIo : source.error().code;
    };
    EXPECT_EQ(code({.size = -1}), ErrorCode::kUsage);
    EXPECT_EQ(code({.size = 100}), ErrorCode::kUsage);
    EXPECT_EQ(code({.size = NAN}), ErrorCode::kUsage);
    EXPECT_EQ(code({.chunkSize = 0}), ErrorCode::kUsage);
    EXPECT_EQ(code({.chunkSize = 127}), ErrorCode::kUsage);
    EXPECT_EQ(code({.voxel = 100}), ErrorCode::kUsage);
    EXPECT_EQ(code({.voxel = 0.1}), ErrorCode::kUsage);
}

// The default world, opened once: its terrain is made chunk by chunk only where a test asks.
class ProceduralWorld : public testing::Test {
protected:
    static void SetUpTestSuite() {
        source_ = new BakeSource(openProcedural(7, {}).value());
        land_ = new Landscape(7, 4096);
    }
    static void TearDownTestSuite() {
        delete source_;
        delete land_;
    }
    static inline BakeSource* source_;
    static inline Landscape* land_;
};

TEST_F(ProceduralWorld, HasItsInstancesOnTheGround) {
    std::map<uint32_t, size_t> uses;
    size_t count = 0, mismatched = 0;
    std::set<std::string> names;
    for (const ChunkKey& key : source_->chunks) {
        // Terrain is not needed here, but is what takes the time: a few rows of chunks will do.
        if ((key.x + 16) % 11 != 0) continue;
        const SourceChunk chunk = source_->make(key).value();
        ASSERT_EQ(chunk.instances.size(), chunk.names.size());
        count += chunk.instances.size();
        for (size_t i = 0; i < chunk.instances.size(); ++i) {
            const Instance& it = chunk.instances[i];
            const glm::dvec3 t = it.placement.translation;
            ASSERT_LT(it.mesh, source_->meshes.size());
            ++uses[it.mesh];
            ASSERT_EQ(key, (ChunkKey{int(std::floor(t.x / 128)), 0, int(std::floor(t.z / 128))}));
            // At the ground: air just above, solid just below (bisection stops at 4 micrometres).
            ASSERT_GT(land_->sign(t + glm::dvec3(0, 0.05, 0)), 0) << toString(key) << " instance " << i;
            ASSERT_LT(land_->sign(t - glm::dvec3(0, 0.05, 0)), 0) << toString(key) << " instance " << i;
            if (!chunk.names[i].empty()) {
                ASSERT_TRUE(names.insert(chunk.names[i]).second);
            }
        }
        // The mesh agrees with the formula: a ray down the middle of each ground triangle ends near it.
        ASSERT_TRUE(chunk.terrain);
        const MeshLevel& level = chunk.terrain->mesh.levels[0];
        for (size_t v = 0; v < level.positions.size(); v += 97) {
            const glm::dvec3 p = glm::dvec3(level.positions[v]) + glm::dvec3(key.x, 0, key.z) * 128.0;
            const double up = land_->sign(p + glm::dvec3(0, 2, 0)),
                         down = land_->sign(p - glm::dvec3(0, 2, 0));
            mismatched += up < 0 && down < 0 && land_->groundHeight(p.x, p.z) < p.y + 2;  // skirts lie deeper
        }
    }
    EXPECT_GT(count, 2000u) << "three rows of 32 of 50,000 instances, more or less wooded";
    EXPECT_LT(mismatched, 30u);
    EXPECT_GE(uses.size(), 8u);
}

TEST_F(ProceduralWorld, HasFiftyThousandInstances) {
    // In a few large chunks, as `make` builds each one's terrain.
    const Result<BakeSource> source =
        openProcedural(7, {.size = 4096, .chunkSize = 2048, .voxel = 8, .instances = 50000});
    ASSERT_TRUE(source);
    size_t count = 0;
    std::map<uint32_t, size_t> uses;
    std::set<std::string> names;
    for (const ChunkKey& key : source.value().chunks) {
        const SourceChunk chunk = source.value().make(key).value();
        count += chunk.instances.size();
        for (const Instance& it : chunk.instances) ++uses[it.mesh];
        for (const std::string& name : chunk.names) {
            if (!name.empty()) names.insert(name);
        }
    }
    EXPECT_EQ(count, 50000u);
    EXPECT_EQ(names.size(), 24u);
    for (uint32_t mesh = 0; mesh < kProceduralMeshCount; ++mesh) EXPECT_GT(uses[mesh], 0u) << "mesh " << mesh;
    EXPECT_GT(uses[kConifer] + uses[kBroadleaf], 15000u);
    EXPECT_GT(uses[kHouse] + uses[kCottage], 60u);
}

TEST_F(ProceduralWorld, HasCavesAndOverhangs) {
    ASSERT_GE(land_->tunnels().size(), 20u);
    // Down through the ground above each tunnel's middle: in, out into the hollow, in again.
    size_t hollow = 0;
    for (const Landscape::Tunnel& tunnel : land_->tunnels()) {
        const glm::dvec3 middle = tunnel.axis[tunnel.axis.size() / 2];
        int crossings = 0;
        bool air = true;
        for (double y = land_->groundHeight(middle.x, middle.z) + 1; y > middle.y - 20; y -= 0.1) {
            const bool now = land_->sign({middle.x, y, middle.z}) > 0;
            crossings += now != air;
            air = now;
        }
        hollow += crossings >= 3;
    }
    EXPECT_GE(hollow, land_->tunnels().size() * 3 / 4);

    // The baked mesh has the cave as well: a ray down meets it more than twice.
    const glm::dvec3 middle = land_->tunnels()[0].axis[land_->tunnels()[0].axis.size() / 2];
    const ChunkKey key{int(std::floor(middle.x / 128)), 0, int(std::floor(middle.z / 128))};
    const SourceChunk chunk = source_->make(key).value();
    const MeshLevel& level = chunk.terrain->mesh.levels[0];
    const glm::dvec2 at(middle.x - key.x * 128.0, middle.z - key.z * 128.0);
    int hits = 0;
    for (size_t i = 0; i < level.indices.size(); i += 3) {
        glm::dvec2 p[3];
        for (size_t k = 0; k < 3; ++k) {
            const glm::vec3& v = level.positions[level.indices[i + k]];
            p[k] = glm::dvec2(v.x, v.z) - at;
        }
        const auto side = [](glm::dvec2 a, glm::dvec2 b) { return a.x * b.y - a.y * b.x > 0; };
        hits += side(p[0], p[1]) == side(p[1], p[2]) && side(p[1], p[2]) == side(p[2], p[0]);
    }
    EXPECT_GE(hits, 3);

    // Overhangs of cliffs, away from any tunnel.
    std::mt19937 rng(2);
    std::uniform_real_distribution<double> anywhere(-2000, 2000);
    int overhangs = 0;
    for (int n = 0; n < 200000 && overhangs < 5; ++n) {
        const double x = anywhere(rng), z = anywhere(rng);
        if (land_->slope(x, z) < 2) continue;
        bool free = true;
        for (const Landscape::Tunnel& t : land_->tunnels()) {
            free &= x < t.bounds.min.x - 1 || x > t.bounds.max.x + 1 || z < t.bounds.min.z - 1 ||
                    z > t.bounds.max.z + 1;
        }
        if (!free) continue;
        const double top = land_->groundHeight(x, z);
        bool air = false;
        for (double y = top - 1; y > top - 30; y -= 0.25) air |= land_->sign({x, y, z}) > 0;
        overhangs += air;
    }
    EXPECT_GE(overhangs, 5);
}

TEST_F(ProceduralWorld, PathStaysAboveTheGround) {
    const std::vector<Pose> path = proceduralPath(7, {});
    ASSERT_EQ(path.size(), 66u * 30 + 1);
    EXPECT_DOUBLE_EQ(path.back().time, 66);
    for (size_t i = 0; i < path.size(); ++i) {
        const Pose& p = path[i];
        ASSERT_NEAR(p.position.y - land_->groundHeight(p.position.x, p.position.z), 1.7, 1e-3)
            << "pose " << i;
        ASSERT_NEAR(glm::length(p.orientation), 1, 1e-9);
        if (i == 0) continue;
        ASSERT_GT(p.time, path[i - 1].time);
        const double speed = glm::distance(p.position, path[i - 1].position) * 30;
        const double turn =
            glm::degrees(
                2 * std::acos(std::min(1.0, std::abs(glm::dot(p.orientation, path[i - 1].orientation))))) *
            30;
        const double t = (p.time + path[i - 1].time) / 2;
        if (t < 12) {
            ASSERT_NEAR(speed, 1.5, 0.1) << t;
        } else if (t < 18) {
            ASSERT_LT(speed, 1e-6) << t;
            ASSERT_NEAR(turn, 210, 0.5) << t;
        } else if (t < 48 - 0.1) {
            ASSERT_NEAR(speed, 15, 0.9) << t;  // the way across to the middle of the road adds a little
            ASSERT_LT(turn, 15) << t;
        } else if (t < 48) {
            ASSERT_TRUE(speed < 16 || speed > 1000 * 30);
        } else if (t < 60) {
            ASSERT_NEAR(speed, 1.5, 0.1) << t;
        } else {
            ASSERT_EQ(speed, 0) << t;
        }
    }
    EXPECT_GT(glm::distance(path[48 * 30 - 1].position, path[48 * 30].position), 1000);
}

TEST_F(ProceduralWorld, PathIsFreeOfObstacles) {
    const std::vector<Pose> path = proceduralPath(7, {});
    std::set<ChunkKey> near;
    for (const Pose& p : path) {
        near.insert({int(std::floor(p.position.x / 128)), 0, int(std::floor(p.position.z / 128))});
    }
    for (const ChunkKey& key : near) {
        const SourceChunk chunk = source_->make(key).value();
        for (size_t i = 0; i < chunk.instances.size(); ++i) {
            if (!chunk.names[i].empty()) continue;
            const glm::dvec3 t = chunk.instances[i].placement.translation;
            for (size_t k = 0; k < path.size(); k += 3) {
                ASSERT_GT(std::hypot(path[k].position.x - t.x, path[k].position.z - t.z), 2.4)
                    << toString(key) << " instance " << i << " at " << path[k].time << " s";
            }
        }
    }
}

TEST_F(ProceduralWorld, MoversStartWhereTheWorldHasThem) {
    const std::vector<MoverTrack> tracks = proceduralMovers(7, {});
    ASSERT_EQ(tracks.size(), 24u);
    ASSERT_TRUE(
        std::is_sorted(tracks.begin(), tracks.end(), [](auto& a, auto& b) { return a.name < b.name; }));
    std::map<std::string, Placement> placed;
    std::set<ChunkKey> keys;
    for (const MoverTrack& track : tracks) {
        const glm::dvec3 p = track.samples.front().position;
        keys.insert({int(std::floor(p.x / 128)), 0, int(std::floor(p.z / 128))});
    }
    for (const ChunkKey& key : keys) {
        const SourceChunk chunk = source_->make(key).value();
        for (size_t i = 0; i < chunk.names.size(); ++i) {
            if (!chunk.names[i].empty()) placed[chunk.names[i]] = chunk.instances[i].placement;
        }
    }
    size_t stopping = 0;
    for (const MoverTrack& track : tracks) {
        ASSERT_TRUE(placed.contains(track.name)) << track.name;
        const MoverSample& first = track.samples.front();
        EXPECT_EQ(first.time, 0);
        EXPECT_EQ(placed[track.name].translation, first.position);
        EXPECT_EQ(placed[track.name].linear, glm::mat3(glm::mat3_cast(first.orientation) * first.scale));
        double longest = 0, way = 0;
        for (size_t i = 1; i < track.samples.size(); ++i) {
            const MoverSample &a = track.samples[i - 1], &b = track.samples[i];
            ASSERT_GT(b.time, a.time);
            ASSERT_NEAR(glm::length(b.orientation), 1, 1e-9);
            ASSERT_NEAR(b.position.y, land_->groundHeight(b.position.x, b.position.z), 1e-3);
            // Where it stands, the next sample is that of starting again.
            longest = std::max(longest, b.time - a.time);
            way += glm::distance(a.position, b.position);
        }
        EXPECT_DOUBLE_EQ(track.samples.back().time, 66);
        EXPECT_GT(way, 200) << track.name;
        stopping += longest > 10;
    }
    EXPECT_EQ(stopping, 8u);
}

TEST(ProceduralMeshes, AreClosedAndOfTheRightSize) {
    const std::vector<Mesh> meshes = proceduralMeshes();
    ASSERT_EQ(meshes.size(), size_t{kProceduralMeshCount});
    for (size_t m = 0; m < meshes.size(); ++m) {
        ASSERT_EQ(meshes[m].levels.size(), 1u);
        const MeshLevel& level = meshes[m].levels[0];
        EXPECT_GE(level.indices.size() / 3, 20u) << "mesh " << m;
        EXPECT_LE(level.indices.size() / 3, 600u) << "mesh " << m;
        // Each directed edge once, and its opposite once: closed, and turned one way within a part.
        std::set<std::pair<uint32_t, uint32_t>> edges;
        std::vector<uint32_t> part(level.positions.size());
        for (uint32_t v = 0; v < part.size(); ++v) part[v] = v;
        const auto root = [&](uint32_t v) {
            while (part[v] != v) v = part[v];
            return v;
        };
        std::map<uint32_t, double> volumes;
        for (size_t i = 0; i < level.indices.size(); i += 3) {
            for (size_t k = 0; k < 3; ++k) {
                ASSERT_LT(level.indices[i + k], level.positions.size());
                const auto edge = std::pair(level.indices[i + k], level.indices[i + (k + 1) % 3]);
                ASSERT_TRUE(edges.insert(edge).second) << "mesh " << m << " triangle " << i / 3;
                part[root(edge.first)] = root(edge.second);
            }
        }
        for (size_t i = 0; i < level.indices.size(); i += 3) {
            const glm::dvec3 a = level.positions[level.indices[i]], b = level.positions[level.indices[i + 1]],
                             c = level.positions[level.indices[i + 2]];
            ASSERT_GT(glm::length(glm::cross(b - a, c - a)), 1e-6) << "mesh " << m;
            volumes[root(level.indices[i])] += glm::dot(a, glm::cross(b, c)) / 6;
        }
        for (const auto& [a, b] : edges) ASSERT_TRUE(edges.contains({b, a})) << "mesh " << m << " is open";
        for (const auto& [v, volume] : volumes) {
            EXPECT_GT(volume, 1e-4) << "mesh " << m << ", part of vertex " << v << ", is inside out";
        }
        EXPECT_LT(meshes[m].bounds.min.y, 0.01) << "mesh " << m;
        EXPECT_GT(meshes[m].bounds.max.y, 0.5) << "mesh " << m;
    }
}

}  // namespace
}  // namespace world
