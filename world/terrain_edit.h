// world/terrain_edit.h — digging into terrain and filling it up, on the level sets of its chunks.
// Source: Museth, Breen, Whitaker and Barr, "Level Set Surface Editing Operators", 2002 (CSG as minimum and
// maximum of signed distances).
#pragma once

#include <span>
#include <variant>
#include <vector>

#include "world/box.h"
#include "world/chunk.h"
#include "world/level_set.h"
#include "world/mesh.h"
#include "world/result.h"

namespace world {

/// World frame [m].
struct Sphere {
    glm::dvec3 centre{0};
    double radius = 0;
};

/// All that is within `radius` of the line from `from` to `to`; world frame [m].
struct Capsule {
    glm::dvec3 from{0}, to{0};
    double radius = 0;
};

enum class EditKind : uint8_t {
    kDig,   ///< the shape becomes air
    kFill,  ///< the shape becomes solid
};

/// One change of the ground. A box is axis-aligned, in the world frame [m].
struct TerrainEdit {
    EditKind kind = EditKind::kDig;
    std::variant<Sphere, Box, Capsule> shape;
};

/// Whether a world can be asked for the edit, before any of its chunks is looked at.
///   kUsage  a number that is not finite, a shape without extent, or a world without terrain
///   kLimit  a shape that is wider than a chunk along an axis, or reaches farther than 1e8 m from the origin
Result<Done> requireEdit(const TerrainEdit& edit, const Header& header);

/// Bounds of the shape [m].
Box boundsOf(const TerrainEdit& edit);

/// The chunks, whether they exist or not, that hold a sample which the edit may change: neighbours share samples
/// near their borders. Ascending. For edits that `requireEdit` accepts.
std::vector<ChunkKey> chunksWithin(const TerrainEdit& edit, const Header& header);

/// The level set after the edit, equal to `set` where the edit is far off. A sample that several chunks hold gets
/// the same value in all of them. Samples near the shape are exact to the band's units; void columns stay void.
/// kLimit where the chunk's surface would span more height than kMaxBandSamples allows: the text names the chunk.
Result<LevelSet> edited(const LevelSet& set, ChunkKey key, const TerrainEdit& edit);

/// The mesh of a level set, cut into clusters: what baking makes of it.
Mesh terrainMesh(const LevelSet& set);

}  // namespace world
