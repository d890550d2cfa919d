// world/contour.h — triangles where a band's distance is zero.
// Source: Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", 2013 (volumeToMesh: dual
// contouring that merges cells whose normals agree).
#pragma once

#include <vector>

#include "world/band.h"
#include "world/mesh.h"

namespace world {

/// Columns of samples whose faces a level shows (`shown`), and those where cells must not be merged,
/// as merging would pull the rim inwards (`rim`). A face joins the centres of the cells around a
/// sample's edge, so it needs the samples beside it: shown columns keep off voids by one.
struct Columns {
    std::vector<char> shown, rim;  ///< index x * count.z + z
};

/// What a chunk of `side` voxels shows: its own column and about two voxels more on each side.
Columns columnsOf(const Band& band, int32_t side);

/// The surface in the shown columns, open at their rim; positions [m] in the chunk's frame, triangles
/// counter-clockwise seen from the air, no clusters.
///   adaptivity  cells merge while 1 - cos(angle between their normals) is at most this; 0 merges none
///   voxel       edge of a voxel [m]
/// The same arguments give the same triangles in the same order on any number of threads.
MeshLevel contour(const Band& band, const Columns& columns, float adaptivity, double voxel);

}  // namespace world
