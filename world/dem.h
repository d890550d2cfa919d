// world/dem.h — a raster of heights, read through GDAL, as a world of terrain.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "world/bake.h"
#include "world/result.h"

namespace world {

struct DemOptions {
    /// xmin, ymin, xmax, ymax in the raster's own coordinates (easting, northing) [m]; clipped to the
    /// raster. All of it if absent.
    std::optional<std::array<double, 4>> bounds = {};
    /// [m], a whole number of voxels; 0: 64 voxels, which makes about 8,000 triangles a chunk.
    double chunkSize = 0;
    /// [m]; 0: the spacing of the raster's posts (the smaller one), or what is nearest to it and
    /// divides `chunkSize`. Other voxels sample between the posts (bilinear).
    double voxel = 0;
    std::optional<glm::dvec3> sun = {};  ///< of light travel, not zero; else from scene.json
};

/// The raster's first band as terrain: X = easting, Y = height, Z = -northing, nothing recentred.
/// Samples lie at voxel centres, so a raster whose cell edges are multiples of its spacing
/// (gdalwarp -tap) is met post by post.
///
/// Voids (no-data, NaN) have no terrain: the surface ends one post before them. Without a declared
/// no-data value -9999 is one. A cell above 12 km or below -12 km, or more than 1 km and a slope of
/// 10 away from the median of its neighbours, is garbage: it takes that median (a void without
/// neighbours), and a warning counts such cells.
///
/// The sun is `sun_direction` of a scene.json beside the file, else zero.
///
/// The window is read once, here; `make` touches no file. kNotFound; kUsage for bounds off the raster
/// and for a chunk or voxel that cannot be; kBadData with the remedy for a file that is no raster, is
/// truncated, has no place on the map, is rotated, or is not in metres.
Result<BakeSource> openDem(const std::string& path, const DemOptions& options);

}  // namespace world
