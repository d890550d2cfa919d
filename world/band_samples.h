// world/band_samples.h — the stored values of a level set in one box: what edits change and leaves are cut from.
#pragma once

#include <cstdint>
#include <vector>

#include "world/level_set.h"

namespace world {

/// A chunk's samples, margins included, in a box of whole leaves, with a spare leaf below and above all that
/// matters: solid under the surface and air over it are always inside. In a void column all are kVoidSample.
struct BandSamples {
    int32_t firstY = 0;            ///< sample index of the lowest, a multiple of kLeafSide
    int32_t side = 0, height = 0;  ///< samples along x and z, along y
    std::vector<int16_t> values;   ///< columns: (x * side + z) * height + y

    size_t index(int32_t x, int32_t y, int32_t z) const {
        return static_cast<size_t>((int64_t{x} * side + z) * height + y);
    }
};

/// Such a box around the sample heights [lowY, highY), values unset.
///   side  edge of the chunk [voxels]
BandSamples samplesBetween(int32_t side, int64_t lowY, int64_t highY);

/// All samples of a set that has leaves, around the heights of its leaves and [lowY, highY). Those of absent leaves
/// take the sign of the next sample below, or above.
BandSamples samplesOf(const LevelSet& set, int64_t lowY, int64_t highY);

/// The leaves of the box that a level set keeps: those with a sample in or next to them that is in the band or sees
/// a sign change, so that every cell that the surface crosses has all its corners in leaves.
std::vector<LevelSetLeaf> leavesOf(const BandSamples& samples);

}  // namespace world
