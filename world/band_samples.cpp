// world/band_samples.cpp — see band_samples.h.
#include "world/band_samples.h"

#include <algorithm>
#include <cstdlib>

namespace world {
namespace {

int64_t leafBelow(int64_t v) { return (v >= 0 ? v : v - (kLeafSide - 1)) / kLeafSide * kLeafSide; }

bool holdsSurface(const BandSamples& box, int32_t x, int32_t y, int32_t z) {
    bool air = false, solid = false;
    for (int32_t i = std::max(x - 1, 0); i < std::min(x + kLeafSide + 1, box.side); ++i) {
        for (int32_t k = std::max(z - 1, 0); k < std::min(z + kLeafSide + 1, box.side); ++k) {
            for (int32_t j = std::max(y - 1, 0); j < std::min(y + kLeafSide + 1, box.height); ++j) {
                const int16_t v = box.values[box.index(i, j, k)];
                if (v == kVoidSample) break;  // the whole column is void
                air |= v > 0;
                solid |= v <= 0;
                if ((air && solid) || std::abs(v) < kBandUnits) return true;
            }
        }
    }
    return false;
}

}  // namespace

BandSamples samplesBetween(int32_t side, int64_t lowY, int64_t highY) {
    BandSamples box;
    box.firstY = static_cast<int32_t>(leafBelow(lowY) - kLeafSide);
    box.side = bandSamples(side);
    box.height = static_cast<int32_t>(leafBelow(highY - 1) + 2 * kLeafSide - box.firstY);
    box.values.resize(static_cast<size_t>(int64_t{box.side} * box.side * box.height));
    return box;
}

BandSamples samplesOf(const LevelSet& set, int64_t lowY, int64_t highY) {
    for (const LevelSetLeaf& leaf : set.leaves) {
        lowY = std::min<int64_t>(lowY, leaf.origin.y);
        highY = std::max<int64_t>(highY, leaf.origin.y + kLeafSide);
    }
    BandSamples box = samplesBetween(set.side, lowY, highY);
    std::vector<char> known(box.values.size(), 0);
    for (const LevelSetLeaf& leaf : set.leaves) {
        const glm::ivec3 o = leaf.origin - glm::ivec3(-kBandMargin, box.firstY, -kBandMargin);
        for (int i = 0; i < kLeafSamples; ++i) {
            const size_t at = box.index(o.x + (i >> 6), o.y + ((i >> 3) & 7), o.z + (i & 7));
            box.values[at] = leaf.values[static_cast<size_t>(i)];
            known[at] = 1;
        }
    }
    const auto height = static_cast<size_t>(box.height);
    for (size_t column = 0; column < box.values.size(); column += height) {
        int16_t* const values = box.values.data() + column;
        const char* const isKnown = known.data() + column;
        const auto first = static_cast<size_t>(std::find(isKnown, isKnown + height, 1) - isKnown);
        int16_t last = first < height ? values[first] : kVoidSample;
        for (size_t y = 0; y < height; ++y) {
            if (isKnown[y]) last = values[y];
            else if (last == kVoidSample) values[y] = kVoidSample;
            else values[y] = last > 0 ? kBandUnits : static_cast<int16_t>(-kBandUnits);
        }
    }
    return box;
}

std::vector<LevelSetLeaf> leavesOf(const BandSamples& box) {
    std::vector<LevelSetLeaf> leaves;
    for (int32_t x = 0; x < box.side; x += kLeafSide) {
        for (int32_t y = 0; y < box.height; y += kLeafSide) {
            for (int32_t z = 0; z < box.side; z += kLeafSide) {
                if (!holdsSurface(box, x, y, z)) continue;
                LevelSetLeaf& leaf = leaves.emplace_back();
                leaf.origin = {x - kBandMargin, box.firstY + y, z - kBandMargin};
                for (int i = 0; i < kLeafSamples; ++i) {
                    leaf.values[static_cast<size_t>(i)] =
                        box.values[box.index(x + (i >> 6), y + ((i >> 3) & 7), z + (i & 7))];
                }
            }
        }
    }
    return leaves;
}

}  // namespace world
