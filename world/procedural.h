// world/procedural.h — the built-in world: a seed gives hills, cliffs, caves, forests and villages.
#pragma once

#include <cstdint>
#include <optional>

#include "world/bake.h"
#include "world/result.h"

namespace world {

struct ProceduralOptions {
    double size = 4096;      ///< edge of the square world around the origin [m]; rounded up to whole chunks
    double chunkSize = 128;  ///< [m], a whole number of voxels
    double voxel = 2;        ///< [m]
    uint32_t instances = 50000;  ///< placed meshes: as many, or as the villages alone have if that is more
    std::optional<glm::dvec3> sun =
        {};  ///< of light travel, not zero; by default from azimuth 120, elevation 35 degrees
};

/// The world of a seed, ready to bake. Instances named `mover/0`, `mover/1`, ... are those that
/// `proceduralMovers` moves; the others have no name. kUsage for options that make no world.
Result<BakeSource> openProcedural(uint64_t seed, const ProceduralOptions& options);

}  // namespace world
