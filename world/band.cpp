// world/band.cpp — see band.h.
#include "world/band.h"

#include <algorithm>
#include <cmath>

#include "world/band_samples.h"

namespace world {

float Band::probe(glm::vec3 p) const {
    const glm::vec3 q = (p - low) / float(step);
    const glm::ivec3 first(0, bottom, 0);
    const glm::ivec3 i = glm::clamp(glm::ivec3(glm::floor(q)), first, first + count - 2);
    const glm::vec3 f = glm::clamp(q - glm::vec3(i), 0.0f, 1.0f);
    float sum = 0;
    for (int c = 0; c < 8; ++c) {
        const int dx = c >> 2, dy = (c >> 1) & 1, dz = c & 1;
        sum += (dx ? f.x : 1 - f.x) * (dy ? f.y : 1 - f.y) * (dz ? f.z : 1 - f.z) *
               at(i.x + dx, i.y - bottom + dy, i.z + dz);
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
    // Whole leaves of the coarse lattice too: where the surface is cut into leaves never depends on how far it reaches.
    constexpr int64_t kTwoLeaves = 2 * kLeafSide;
    BandSamples samples = samplesOf(set, set.leaves.front().origin.y, set.leaves.front().origin.y + 1);
    const int64_t spare = ((samples.firstY % kTwoLeaves) + kTwoLeaves) % kTwoLeaves;
    Band band;
    band.count = {samples.side, samples.height + spare, samples.side};
    band.bottom = static_cast<int>(samples.firstY - spare);
    band.low = glm::vec3(0.5f - kBandMargin, 0.5f, 0.5f - kBandMargin);
    band.values.resize(static_cast<size_t>(int64_t{band.count.x} * band.count.y * band.count.z));
    for (int x = 0; x < band.count.x; ++x) {
        for (int z = 0; z < band.count.z; ++z) {
            for (int y = 0; y < band.count.y; ++y) {
                const auto from = std::max(y - static_cast<int>(spare), 0);
                const int16_t v = samples.values[samples.index(x, from, z)];
                band.values[band.index(x, y, z)] =
                    v == kVoidSample ? NAN : float(v) * (float(kBandVoxels) / float(kBandUnits));
            }
        }
    }
    return band;
}

Band halved(const Band& fine) {
    Band band;
    band.step = 2 * fine.step;
    band.count = fine.count / 2;
    band.bottom = fine.bottom / 2;
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
