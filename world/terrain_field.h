// world/terrain_field.h — terrain as a function over the world's voxel lattice, cut into chunks.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "world/chunk.h"
#include "world/level_set.h"
#include "world/result.h"

namespace world {

/// A rectangle of lattice columns. Sample (i, j, k) of the world lies at
/// ((i + 0.5) * voxel, (j + 0.5) * voxel, (k + 0.5) * voxel) in the world's frame: integers counted
/// from the world's origin, so that chunks which share a sample compute it from the same numbers.
struct LatticeRect {
    int64_t firstX = 0, firstZ = 0;
    int32_t countX = 0, countZ = 0;
    double voxel = 0;  ///< [m], > 0

    double x(int32_t i) const { return (static_cast<double>(firstX + i) + 0.5) * voxel; }
    double z(int32_t k) const { return (static_cast<double>(firstZ + k) + 0.5) * voxel; }
};

/// A field over such a rectangle: columns one after the other, distance[(i * countZ + k) * countY + j].
struct FieldBlock {
    int64_t firstY = 0;  ///< lattice index of the lowest sample
    int32_t countY = 0;
    /// About the distance to the surface [m], positive in air; NaN throughout a void column. Values of
    /// kBandVoxels voxels and more may be anything of the right sign that large. Everything below the
    /// block is solid and everything above it air.
    std::vector<float> distance;
};

/// Called from any thread; a sample's value depends on its lattice index and `voxel` alone.
using TerrainField = std::function<FieldBlock(const LatticeRect&)>;

/// The narrow band of one chunk of `side` voxels; no leaves if it has no surface.
/// kLimit if the surface spans more height than kMaxBandSamples allows.
Result<LevelSet> sampleLevelSet(const TerrainField& field, ChunkKey key, int32_t side, double voxel);

}  // namespace world
