// world/level_set.h — a chunk's terrain as a narrow band of signed distances, and its stored form.
// Source: Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", 2013 (leaves of 8^3);
// Ibarria et al., "Out-of-core Compression and Decompression of Large n-dimensional Scalar Fields",
// 2003 (the Lorenzo predictor). OpenVDB's own stream is not used: it holds random numbers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "world/result.h"

namespace world {

constexpr int kLeafSide = 8;                                          ///< samples
constexpr int kLeafSamples = kLeafSide * kLeafSide * kLeafSide;
constexpr int kBandVoxels = 3;       ///< half width of the band: farther samples are clamped
constexpr int16_t kBandUnits = 32767;  ///< stored value of a sample kBandVoxels or more away
constexpr int16_t kVoidSample = -32768;  ///< stored value where nothing is known and no surface is made

/// Samples a chunk has beyond its own column on each side, so that neighbours know the same values.
constexpr int kBandMargin = 4;

/// 8^3 samples; sample (x, y, z) of the leaf is values[(x * 8 + y) * 8 + z].
/// A value is distance / (kBandVoxels * voxel) * kBandUnits, positive in air.
struct LevelSetLeaf {
    glm::ivec3 origin{0};  ///< sample index of values[0]
    std::array<int16_t, kLeafSamples> values{};
    friend bool operator==(const LevelSetLeaf&, const LevelSetLeaf&) = default;
};

/// Sample i lies at (i + 0.5) * voxel in the chunk's frame. The chunk's lattice is the world's, as
/// the chunk's edge is a whole number of voxels. Leaf origins are 8k - kBandMargin in x and z, 8k in
/// y. A leaf that is absent holds nothing of the band: its samples have the sign of what is next to
/// them, or are void where a whole column of leaves is absent.
struct LevelSet {
    double voxel = 0;  ///< edge [m], > 0
    int32_t side = 0;  ///< chunk edge [voxels]
    std::vector<LevelSetLeaf> leaves;  ///< ascending by origin (x, then y, then z), unique
    friend bool operator==(const LevelSet&, const LevelSet&) = default;
};

/// Samples a chunk of `side` voxels has along x and z, margins included: a whole number of leaves.
constexpr int32_t bandSamples(int32_t side) {
    return (side + 2 * kBandMargin + kLeafSide - 1) / kLeafSide * kLeafSide;
}

/// Largest chunk edge [voxels] and number of samples in the box around the leaves that decoding
/// accepts: what meshing can be asked to hold (128 MiB).
constexpr int32_t kMaxBandSide = 1024;
constexpr int64_t kMaxBandSamples = int64_t{1} << 26;

/// Deterministic: the same level set gives the same bytes. Smooth bands compress to about a byte a
/// sample and less, as what is stored is the error of a prediction, low bytes apart from high ones.
std::vector<std::byte> encodeLevelSet(const LevelSet& set);

/// kBadData for bytes that `encodeLevelSet` cannot have made: the text says which part.
Result<LevelSet> decodeLevelSet(std::span<const std::byte> bytes);

}  // namespace world
