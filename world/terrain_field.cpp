// world/terrain_field.cpp — see terrain_field.h.
#include "world/terrain_field.h"

#include <algorithm>
#include <cmath>

namespace world {
namespace {

int16_t quantised(float distance, float unitsPerMetre) {
    if (std::isnan(distance)) return kVoidSample;
    const float units = std::clamp(distance * unitsPerMetre, -float{kBandUnits}, float{kBandUnits});
    return static_cast<int16_t>(std::lround(units));
}

/// The block's samples, quantised, in a box of whole leaves.
struct Samples {
    int64_t firstY = 0;            ///< a multiple of kLeafSide
    int32_t side = 0, height = 0;  ///< along x and z, along y
    std::vector<int16_t> values;   ///< columns, as in FieldBlock

    int16_t at(int32_t x, int32_t y, int32_t z) const {
        return values[static_cast<size_t>((int64_t{x} * side + z) * height + y)];
    }

    /// True if the leaf at (x, y, z) or a sample next to it is in the band or sees a sign change:
    /// every cell that the surface crosses then has all its corners in leaves.
    bool holdsSurface(int32_t x, int32_t y, int32_t z) const {
        bool air = false, solid = false;
        for (int32_t i = std::max(x - 1, 0); i < std::min(x + kLeafSide + 1, side); ++i) {
            for (int32_t k = std::max(z - 1, 0); k < std::min(z + kLeafSide + 1, side); ++k) {
                for (int32_t j = std::max(y - 1, 0); j < std::min(y + kLeafSide + 1, height); ++j) {
                    const int16_t v = at(i, j, k);
                    if (v == kVoidSample) break;  // the whole column is void
                    air |= v > 0;
                    solid |= v <= 0;
                    if ((air && solid) || std::abs(v) < kBandUnits) return true;
                }
            }
        }
        return false;
    }
};

Samples quantise(const FieldBlock& block, int32_t side, double voxel) {
    Samples out;
    // A spare leaf below and above: the lowest solid and the highest air sample are always inside.
    const auto floor8 = [](int64_t v) { return (v >= 0 ? v : v - (kLeafSide - 1)) / kLeafSide * kLeafSide; };
    out.firstY = floor8(block.firstY) - kLeafSide;
    const int64_t endY = floor8(block.firstY + block.countY - 1) + 2 * kLeafSide;
    out.side = side;
    out.height = static_cast<int32_t>(endY - out.firstY);
    out.values.resize(static_cast<size_t>(int64_t{side} * side * out.height));
    const auto units = static_cast<float>(kBandUnits / (kBandVoxels * voxel));
    const auto before = static_cast<size_t>(block.firstY - out.firstY);
    const auto countY = static_cast<size_t>(block.countY);
    for (size_t column = 0; column < static_cast<size_t>(side) * static_cast<size_t>(side); ++column) {
        const float* from = block.distance.data() + column * countY;
        int16_t* to = out.values.data() + column * static_cast<size_t>(out.height);
        const bool isVoid = std::isnan(from[0]);
        std::fill_n(to, before, isVoid ? kVoidSample : static_cast<int16_t>(-kBandUnits));
        for (size_t j = 0; j < countY; ++j) to[before + j] = quantised(from[j], units);
        std::fill(to + before + countY, to + out.height, isVoid ? kVoidSample : kBandUnits);
    }
    return out;
}

}  // namespace

Result<LevelSet> sampleLevelSet(const TerrainField& field, ChunkKey key, int32_t side, double voxel) {
    CHECK(side >= 1 && side <= kMaxBandSide && voxel > 0);
    const int32_t samples = bandSamples(side);
    const LatticeRect rect{.firstX = int64_t{key.x} * side - kBandMargin,
                           .firstZ = int64_t{key.z} * side - kBandMargin,
                           .countX = samples,
                           .countZ = samples,
                           .voxel = voxel};
    const FieldBlock block = field(rect);
    LevelSet set{.voxel = voxel, .side = side, .leaves = {}};
    if (block.countY == 0) return set;
    if (int64_t{samples} * samples * (int64_t{block.countY} + 4 * kLeafSide) > kMaxBandSamples) {
        return Error{ErrorCode::kLimit, "chunk " + toString(key) + ": its terrain spans " +
                                            std::to_string(block.countY) +
                                            " voxels of height; bake with a larger voxel or a smaller chunk"};
    }

    CHECK(block.distance.size() == static_cast<size_t>(int64_t{samples} * samples * block.countY));
    const Samples dense = quantise(block, samples, voxel);
    for (int32_t x = 0; x < samples; x += kLeafSide) {
        for (int32_t y = 0; y < dense.height; y += kLeafSide) {
            for (int32_t z = 0; z < samples; z += kLeafSide) {
                if (!dense.holdsSurface(x, y, z)) continue;
                LevelSetLeaf& leaf = set.leaves.emplace_back();
                leaf.origin = {x - kBandMargin, static_cast<int32_t>(dense.firstY) + y, z - kBandMargin};
                for (int i = 0; i < kLeafSamples; ++i) {
                    leaf.values[static_cast<size_t>(i)] =
                        dense.at(x + (i >> 6), y + ((i >> 3) & 7), z + (i & 7));
                }
            }
        }
    }
    return set;
}

}  // namespace world
