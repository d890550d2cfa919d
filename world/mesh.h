// world/mesh.h — geometry as it is stored, drawn and traced: levels of detail cut into clusters.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "world/box.h"

namespace world {

constexpr uint32_t kClusterTriangles = 128;  ///< most triangles in a cluster

/// A compact run of triangles: the unit of culling and drawing.
struct Cluster {
    uint32_t firstIndex = 0;  ///< into MeshLevel::indices, a multiple of 3
    uint32_t indexCount = 0;  ///< a multiple of 3, in [3, 3 * kClusterTriangles]
    glm::vec3 min{0}, max{0};  ///< bounds in the mesh's own frame [m]
};

/// One level of detail. The clusters follow each other and cover `indices` exactly once.
struct MeshLevel {
    float error = 0;  ///< largest known distance from level 0 [m]; 0 for level 0
    std::vector<glm::vec3> positions;  ///< the mesh's own frame [m], finite
    std::vector<uint32_t> indices;     ///< triangles, each < positions.size()
    std::vector<Cluster> clusters;
};

/// A shape that casters share. At least one level, finest first, errors ascending.
struct Mesh {
    std::vector<MeshLevel> levels;
    Box bounds;  ///< of all levels, own frame [m]
};

/// Where a mesh stands: pWorld = linear * pMesh + translation. Any invertible or flat linear part,
/// mirrored ones too.
struct Placement {
    glm::mat3 linear{1};
    glm::dvec3 translation{0};  ///< [m]
    friend bool operator==(const Placement&, const Placement&) = default;
};

}  // namespace world
