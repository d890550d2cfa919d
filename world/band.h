// world/band.h — a level set unpacked: every sample of a chunk's box, to look up and to make meshes of.
#pragma once

#include <glm/glm.hpp>
#include <vector>

#include "world/level_set.h"

namespace world {

/// The band as a box of samples. Positions are in voxels of the chunk's frame. Sample (x, y, z) lies at
/// low + step * (x, bottom + y, z): `low` is the same for all boxes of a step, so that what is computed of a
/// place does not depend on how far a box reaches.
struct Band {
    int step = 1;               ///< voxels between samples
    glm::ivec3 count{0};
    int bottom = 0;             ///< height of the lowest sample, a whole number of leaves [steps]
    glm::vec3 low{0};
    std::vector<float> values;  ///< voxels of distance, positive in air; NaN throughout void columns

    size_t index(int x, int y, int z) const {
        return static_cast<size_t>((int64_t{x} * count.y + y) * count.z + z);
    }
    float at(int x, int y, int z) const { return values[index(x, y, z)]; }

    /// The distance between samples, trilinear, held at the box's sides; NaN next to a void.
    float probe(glm::vec3 p) const;
    /// Unit, towards the air; straight up where the band says nothing.
    glm::vec3 normal(glm::vec3 p) const;
};

/// All samples of a set that has leaves; samples of absent leaves take the sign of the next sample
/// below, or above. A leaf at the bottom and one at the top are of one sign each where the set is a terrain.
Band unpack(const LevelSet& set);

/// The same band at twice the step: means of 2^3 samples, which keeps a flat surface where it is.
Band halved(const Band& fine);

}  // namespace world
