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

/// What the streamer must know of a chunk without reading it.
struct ChunkRecord {
    ChunkKey key;
    Box bounds;                   ///< of all that the chunk casts, world frame [m]
    uint32_t instances = 0;
    bool terrain = false;         ///< the chunk has a terrain mesh of its own
    std::vector<uint32_t> meshes; ///< ids that its instances use, ascending, unique
};

/// What a mesh costs without reading it.
struct MeshRecord {
    std::vector<uint32_t> levelTriangles;  ///< finest first
    std::vector<float> levelErrors;        ///< [m], same order
    std::vector<uint32_t> levelVertices;
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

/// A chunk read whole. Terrain is a mesh in the chunk's frame: its origin is
/// (key.x * chunkSize, 0, key.z * chunkSize).
struct Chunk {
    ChunkKey key;
    std::vector<Instance> instances;
    Mesh terrain;  ///< no levels if the chunk has none
};

}  // namespace world
