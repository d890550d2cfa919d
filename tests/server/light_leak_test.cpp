// tests/server/light_leak_test.cpp — no light leaks into a drawn shadow map where terrain chunks of
// different levels of detail meet: the maps are judged by the formula that the terrain was made from.
#include <cmath>

#include "tests/server/worlds.h"
#include "tests/world/terrain_fields.h"
#include "world/terrain.h"

namespace {

constexpr int kVoxels = 32;  ///< voxels along a chunk
constexpr double kVoxelSize = 2;
constexpr double kChunk = kVoxels * kVoxelSize;
constexpr int kAlong = 8;  ///< along the world

bool overColumn(glm::vec3 p) { return p.x >= 0 && p.z >= 0 && p.x <= float(kChunk) && p.z <= float(kChunk); }

/// Hills with a cave, in chunks that keep one level of detail each: neighbours never the same one.
/// Cut at its border if `cut`: without the overlap and the skirts that hide cracks.
///   bound  grows to what a mesh may lie below the formula [m]
world::BakeSource mixedLevels(bool cut, double& bound) {
    world::BakeSource source;
    source.header.chunkSize = kChunk;
    source.header.voxel = kVoxelSize;
    source.header.source = "hills";
    struct Made {
        world::TerrainChunk terrain;
        world::ChunkKey key;
    };
    auto chunks = std::make_shared<std::vector<Made>>();
    for (int x = 0; x < kAlong; ++x) {
        for (int z = 0; z < kAlong; ++z) {
            const world::ChunkKey key{x, 0, z};
            auto made = world::makeTerrain(world::test::fieldOf(world::test::hillsWithCave, -60, 60), key, kVoxels, kVoxelSize);
            world::TerrainChunk terrain = std::move(*made.value());
            std::vector<world::MeshLevel>& levels = terrain.mesh.levels;
            world::MeshLevel kept = levels[size_t(x + 2 * z) % levels.size()];
            bound = std::max(bound, kept.error + kVoxelSize);
            kept.error = 0;
            if (cut) {
                std::vector<uint32_t> inside;
                for (size_t i = 0; i < kept.indices.size(); i += 3) {
                    const uint32_t* t = &kept.indices[i];
                    if (overColumn(kept.positions[t[0]]) && overColumn(kept.positions[t[1]]) &&
                        overColumn(kept.positions[t[2]]))
                        inside.insert(inside.end(), t, t + 3);
                }
                kept.indices = inside;
            }
            levels.assign(1, kept);
            source.chunks.push_back(key);
            chunks->push_back({std::move(terrain), key});
        }
    }
    source.make = [chunks](world::ChunkKey key) -> world::Result<world::SourceChunk> {
        world::SourceChunk chunk;
        chunk.terrain = (*chunks)[size_t(key.x * kAlong + key.z)].terrain;
        return chunk;
    };
    return source;
}

struct Leaks {
    uint64_t texels = 0;  ///< judged
    uint64_t leaks = 0;   ///< of these, light gets where the formula says solid
};

/// Texels whose ray gets deeper than `bound` into the formula's solid before the map stops it.
Leaks leaksOf(const world::WorldStore& store, glm::dvec3 sun, double bound) {
    server::ShadowConfig config;
    config.cascades = 2;
    config.side = 256;
    config.farDistance = 120;
    config.geometryBytes = 64 << 20;
    config.sun = sun;
    auto system = std::move(server::ShadowSystem::create(tests::validatedDevice(), store, config).value());
    // Over a corner where four chunks meet.
    const glm::dvec3 eye(4 * kChunk, 10, 4 * kChunk);
    const double eyeZ = glm::dot(eye, sun);
    EXPECT_TRUE(system->advance({0, {eye, {1, 0, 0, 0}}, {}}));
    Leaks found;
    for (int c = 0; c < system->cascades(); ++c) {
        const server::CascadeView view = system->view(c);
        const std::vector<float> map = system->readMap(c, gpu::MapKind::kCache).value();
        const glm::dmat3 worldFromLight = glm::transpose(view.lightFromWorld);
        for (int64_t y = 0; y < config.side; ++y) {
            for (int64_t x = 0; x < config.side; ++x) {
                const cache::Texel texel = view.window + cache::Texel(x, y);
                const glm::dvec2 at = (glm::dvec2(texel) + 0.5) * view.texel;
                const auto inWorld = [&](double z) { return worldFromLight * glm::dvec3(at, z); };
                // Well inside the world, from the air above it to where solid ought to begin; what lies
                // farther from the sun than the split is nobody's to serve.
                const double end = eyeZ + view.split;
                bool inside = true, air = false;
                double z = view.depthNear;
                while (z < end) {
                    const glm::dvec3 p = inWorld(z);
                    const double f = world::test::hillsWithCave(p);
                    inside = p.x > 8 && p.z > 8 && p.x < kAlong * kChunk - 8 && p.z < kAlong * kChunk - 8;
                    air = air || (inside && f > bound);
                    if (f < -bound || (air && !inside)) break;
                    z += std::max(0.1, (f + bound) / 2);  // the formula is about a distance
                }
                if (!inside || !air || z >= end) continue;
                const cache::Texel slot = ((texel % int64_t(config.side)) + int64_t(config.side)) % int64_t(config.side);
                const double depth = double(map[size_t(slot.y * config.side + slot.x)]);
                ++found.texels;
                found.leaks += view.depthNear + depth * view.depthRange > z;
            }
        }
    }
    tests::expectSilence();
    return found;
}

TEST(LightLeak, NoneInADrawnMapWhereLevelsMeet) {
    double bound = 0;
    const world::WorldStore whole = tests::baked(mixedLevels(false, bound), "whole.world");
    const world::WorldStore cut = tests::baked(mixedLevels(true, bound), "cut.world");
    for (const double elevation : {90.0, 50.0, 12.0}) {
        for (const double azimuth : {20.0, 245.0}) {
            const double e = glm::radians(elevation), a = glm::radians(azimuth);
            const glm::dvec3 sun(std::cos(e) * std::cos(a), -std::sin(e), std::cos(e) * std::sin(a));
            const Leaks sound = leaksOf(whole, sun, bound);
            EXPECT_GT(sound.texels, 40000u) << elevation;
            EXPECT_EQ(sound.leaks, 0u) << elevation << " up, from " << azimuth;
            // The same texels find the cracks of chunks that end at their borders.
            EXPECT_GT(leaksOf(cut, sun, bound).leaks, 100u) << elevation << " up, from " << azimuth;
        }
    }
}

}  // namespace
