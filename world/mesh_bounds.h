// world/mesh_bounds.h — the box around a mesh, in its own frame, whatever level of it is drawn.
#pragma once

#include "world/mesh.h"

namespace world {

/// Bounds of all positions of all levels [m], since a coarse level may stick out of the finest; empty
/// without any. After `buildClusters` every position belongs to a triangle.
inline Box boundsOf(const Mesh& mesh) {
    Box box;
    for (const MeshLevel& level : mesh.levels)
        for (const glm::vec3& p : level.positions) box.add(glm::dvec3(p));
    return box;
}

}  // namespace world
