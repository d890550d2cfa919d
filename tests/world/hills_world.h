// tests/world/hills_world.h — the hills with a cave as a source of chunks: what tests of edited worlds bake.
#pragma once

#include <random>

#include "tests/world/random_world.h"
#include "tests/world/terrain_fields.h"
#include "world/bake.h"
#include "world/terrain.h"

namespace world::test {

/// `count` x `count` chunks of `side` voxels of `voxel` metres from the origin on, lifted by `lift` [m]. In the middle
/// of each are bumpy patches, one 20 m up and one 9 m under the ground.
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
        const glm::dvec3 middle = glm::dvec3(key.x + 0.5, 0, key.z + 0.5) * (side * voxel);
        double ground = 40;
        while (hills(middle + glm::dvec3(0, ground, 0)) > 0) ground -= 0.5;
        for (const double y : {20.0, ground - 9}) {
            Instance instance;
            instance.placement.translation = middle + glm::dvec3(0, y, 0);
            chunk.instances.push_back(instance);
        }
        return chunk;
    };
    return source;
}

}  // namespace world::test
