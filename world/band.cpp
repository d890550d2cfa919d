// world/band.cpp — see band.h.
#include "world/band.h"

#include <algorithm>
#include <cmath>

namespace world {

float Band::probe(glm::vec3 p) const {
    const glm::vec3 q = glm::clamp((p - low) / float(step), glm::vec3(0), glm::vec3(count - 1) - 1e-3f);
    const glm::ivec3 i(q);
    const glm::vec3 f = q - glm::vec3(i);
    float sum = 0;
    for (int c = 0; c < 8; ++c) {
        const int dx = c >> 2, dy = (c >> 1) & 1, dz = c & 1;
        sum += (dx ? f.x : 1 - f.x) * (dy ? f.y : 1 - f.y) * (dz ? f.z : 1 - f.z) *
               at(i.x + dx, i.y + dy, i.z + dz);
    }
    return sum;
}

glm::vec3 Band::normal(glm::vec3 p) const {
    const auto slope = [&](glm::vec3 d) { return probe(p + d) - probe(p - d); };
    const glm::vec3 g(slope({1, 0, 0}), slope({0, 1, 0}), slope({0, 0, 1}));
    const float length = glm::length(g);
    return length > 1e-3f ? g / length : glm::vec3(0, 1, 0);  // false for NaN as well
}

Band unpack(const LevelSet& set) {
    Band band;
    const int32_t samples = bandSamples(set.side);
    int32_t low = set.leaves.front().origin.y, high = low;
    for (const LevelSetLeaf& leaf : set.leaves) {
        low = std::min(low, leaf.origin.y);
        high = std::max(high, leaf.origin.y + kLeafSide);
    }
    // A leaf of solid below and of air above, so that the box's own ends are never a surface.
    low -= kLeafSide;
    high += kLeafSide;
    band.count = {samples, high - low, samples};
    band.low = glm::vec3(-kBandMargin, low, -kBandMargin) + 0.5f;
    constexpr float kUnset = 1e30f;
    band.values.assign(static_cast<size_t>(int64_t{samples} * samples * (high - low)), kUnset);
    for (const LevelSetLeaf& leaf : set.leaves) {
        const glm::ivec3 o = leaf.origin - glm::ivec3(-kBandMargin, low, -kBandMargin);
        for (int i = 0; i < kLeafSamples; ++i) {
            const int16_t v = leaf.values[static_cast<size_t>(i)];
            band.values[band.index(o.x + (i >> 6), o.y + ((i >> 3) & 7), o.z + (i & 7))] =
                v == kVoidSample ? NAN : float(v) * (float(kBandVoxels) / float(kBandUnits));
        }
    }
    for (int x = 0; x < samples; ++x) {
        for (int z = 0; z < samples; ++z) {
            const auto at = [&](int y) -> float& { return band.values[band.index(x, y, z)]; };
            int first = 0;
            while (first < band.count.y && at(first) == kUnset) ++first;
            float fill = first < band.count.y ? at(first) : NAN;
            for (int y = 0; y < band.count.y; ++y) {
                if (at(y) != kUnset) {
                    fill = at(y);
                } else if (!std::isnan(fill)) {
                    at(y) = std::copysign(float(kBandVoxels), fill);
                } else {
                    at(y) = fill;
                }
            }
        }
    }
    return band;
}

Band halved(const Band& fine) {
    Band band;
    band.step = 2 * fine.step;
    band.count = fine.count / 2;
    band.low = fine.low + 0.5f * float(fine.step);
    band.values.resize(static_cast<size_t>(int64_t{band.count.x} * band.count.y * band.count.z));
    for (int x = 0; x < band.count.x; ++x) {
        for (int y = 0; y < band.count.y; ++y) {
            for (int z = 0; z < band.count.z; ++z) {
                float sum = 0;
                for (int c = 0; c < 8; ++c) {
                    sum += fine.at(2 * x + (c >> 2), 2 * y + ((c >> 1) & 1), 2 * z + (c & 1));
                }
                band.values[band.index(x, y, z)] = sum / 8;
            }
        }
    }
    return band;
}

}  // namespace world
