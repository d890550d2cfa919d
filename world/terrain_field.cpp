// world/terrain_field.cpp — see terrain_field.h.
#include "world/terrain_field.h"

#include <algorithm>
#include <cmath>

#include "world/band_samples.h"

namespace world {
namespace {

int16_t quantised(float distance, float unitsPerMetre) {
    if (std::isnan(distance)) return kVoidSample;
    const float units = std::clamp(distance * unitsPerMetre, -float{kBandUnits}, float{kBandUnits});
    return static_cast<int16_t>(std::lround(units));
}

BandSamples quantise(const FieldBlock& block, int32_t side, double voxel) {
    BandSamples out = samplesBetween(side, block.firstY, block.firstY + block.countY);
    const auto units = static_cast<float>(kBandUnits / (kBandVoxels * voxel));
    const auto before = static_cast<size_t>(block.firstY - out.firstY);
    const auto countY = static_cast<size_t>(block.countY);
    const auto height = static_cast<size_t>(out.height);
    for (size_t from = 0, to = 0; to < out.values.size(); from += countY, to += height) {
        const float* distances = block.distance.data() + from;
        int16_t* values = out.values.data() + to;
        const bool isVoid = std::isnan(distances[0]);
        std::fill_n(values, before, isVoid ? kVoidSample : static_cast<int16_t>(-kBandUnits));
        for (size_t j = 0; j < countY; ++j) values[before + j] = quantised(distances[j], units);
        std::fill(values + before + countY, values + height, isVoid ? kVoidSample : kBandUnits);
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
    set.leaves = leavesOf(quantise(block, side, voxel));
    return set;
}

}  // namespace world
