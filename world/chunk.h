// world/chunk.h — what a world file holds, decoded: chunks of placed casters over shared meshes.
#pragma once

#include <compare>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "world/box.h"
#include "world/mesh.h"

namespace world {

/// Chunks are columns of `Header::chunkSize` metres in x and z; y is 0 in every world baked today
/// and kept in the key for worlds cut vertically as well.
struct ChunkKey {
    int32_t x = 0, y = 0, z = 0;
    friend auto operator<=>(const ChunkKey&, const ChunkKey&) = default;
};

/// "(12,0,-4)", as errors and reports name a chunk.
std::string toString(ChunkKey key);

/// A placed mesh that casts.
struct Instance {
    uint32_t mesh = 0;  ///< row of kind kMesh
    Placement placement;
};

/// What a level of detail costs, and what it is off by, without reading it.
struct LevelRecord {
    uint32_t triangles = 0, vertices = 0, clusters = 0;
    float error = 0;  ///< [m]
    friend bool operator==(const LevelRecord&, const LevelRecord&) = default;
};

inline LevelRecord recordOf(const MeshLevel& level) {
    return {static_cast<uint32_t>(level.indices.size() / 3), static_cast<uint32_t>(level.positions.size()),
            static_cast<uint32_t>(level.clusters.size()), level.error};
}

/// What the streamer must know of a chunk without reading it.
struct ChunkRecord {
    ChunkKey key;
    Box bounds;                   ///< of all that the chunk casts, world frame [m]
    uint32_t instances = 0;
    std::vector<LevelRecord> terrain;  ///< of its own terrain, finest first; empty if it has none
    std::vector<uint32_t> meshes; ///< ids that its instances use, ascending, unique
};

/// What a mesh costs without reading it.
struct MeshRecord {
    std::vector<LevelRecord> levels;  ///< finest first
    Box bounds;  ///< own frame [m]
};

/// The first row of a world.
struct Header {
    uint32_t version = 1;
    double chunkSize = 0;  ///< [m], > 0
    Box bounds;            ///< of all casters [m]
    glm::dvec3 sun{0};     ///< default direction of light travel, unit; zero if the source names none
    double voxel = 0;      ///< terrain voxel edge [m]; 0 without terrain
    std::string source;    ///< what was baked, for people: "procedural:7", "world.glb"
};

/// A name that a source gave to an instance (a glTF node): lets a log of movers find it.
struct NamedInstance {
    std::string name;
    ChunkKey chunk;
    uint32_t slot = 0;  ///< index among the chunk's instances
    friend bool operator==(const NamedInstance&, const NamedInstance&) = default;
};

/// A chunk as it was read. Terrain is a mesh in the chunk's frame: its origin is
/// (key.x * chunkSize, 0, key.z * chunkSize).
struct Chunk {
    ChunkKey key;
    std::vector<Instance> instances;
    Mesh terrain;  ///< the coarser of its levels, or all; no levels if the chunk has none
    size_t firstLevel = 0;  ///< what the directory calls the first of them
};

}  // namespace world
