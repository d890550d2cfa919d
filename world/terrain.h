// world/terrain.h — a chunk's level set as meshes, level by level, that fit their neighbours' without cracks.
// Source: Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", 2013 (volumeToMesh: dual
// contouring that merges flat cells); Ulrich, "Rendering Massive Terrains using Chunked Level of Detail
// Control", 2002 (skirts).
#pragma once

#include <optional>

#include "world/bake.h"
#include "world/level_set.h"
#include "world/terrain_field.h"

namespace world {

/// The terrain mesh that a level set stands for, in the chunk's frame; no levels if it has no surface.
/// Level 0 has a vertex in every voxel that the surface crosses. Coarser levels merge voxels whose
/// normals agree, the coarsest on a lattice of twice the voxel; each has at most 0.6 of the triangles
/// of the level before it, and an `error` that was measured: the largest distance from its vertices,
/// edge midpoints and centroids to level 0, and from the vertices of level 0 to it, inside the chunk's
/// column. No error reaches kBandVoxels voxels.
///
/// Cracks: every level covers its column and about two voxels more (one at least), and from its open
/// rim a skirt goes against the surface's normal into the solid, 2 * kBandVoxels voxels deep, since its own error
/// and a neighbour's stay below kBandVoxels each, or until the solid ends. The surface ends, with such a skirt, one
/// sample before a void.
///
/// Every bit of a triangle depends on the samples near it alone: those of its leaf on the level's lattice and around
/// it, and those that its skirt passes. An edit leaves the others as they were, where the level stays.
///
/// Triangles are counter-clockwise seen from the air. The same level set gives the same mesh on any
/// number of threads.
Mesh meshLevelSet(const LevelSet& set);

/// The terrain of one chunk: band and mesh, the mesh made from the band as it is stored.
/// Nothing if the chunk has no surface; errors of `sampleLevelSet`.
Result<std::optional<TerrainChunk>> makeTerrain(const TerrainField& field, ChunkKey key, int32_t side,
                                                double voxel);

}  // namespace world
