// tests/world/hills_world.h — the hills with a cave as a source of chunks: what tests of edited worlds bake.
#pragma once

#include <random>

#include "tests/world/random_world.h"
#include "tests/world/terrain_fields.h"
#include "world/bake.h"
#include "world/terrain.h"

namespace world::test {

/// `count` x `count` chunks of `side` voxels of `voxel` metres from the origin on, lifted by `lift` [m], and in the
/// middle of each a bumpy patch 20 m up.
inline BakeSource hillsWorld(int count, int32_t side, double voxel, double lift = 0) {
    BakeSource source;
    source.header.chunkSize = side * voxel;
    source.header.voxel = voxel;
    source.header.sun = glm::normalize(glm::dvec3(0.5, -0.9, 0.3));
    source.header.source = "hills";
    std::mt19937 rng(1);
    source.meshes.push_back({{world_tests::patch(6, 0, rng)}, {}});
    for (int x = 0; x < count; ++x)
        for (int z = 0; z < count; ++z) source.chunks.push_back({x, 0, z});
    source.make = [=](ChunkKey key) -> Result<SourceChunk> {
        SourceChunk chunk;
        const auto hills = [lift](glm::dvec3 p) { return hillsWithCave(p - glm::dvec3(0, lift, 0)); };
        auto made = makeTerrain(fieldOf(hills, -60, 60), key, side, voxel);
        if (!made) return made.error();
        chunk.terrain = std::move(made.value());
        Instance instance;
        instance.placement.translation = glm::dvec3(key.x + 0.5, 0, key.z + 0.5) * (side * voxel) + glm::dvec3(0, 20, 0);
        chunk.instances.push_back(instance);
        return chunk;
    };
    return source;
}

}  // namespace world::test
