// world/clusters.h — cuts triangles into compact clusters: the unit of culling and drawing.
#pragma once

#include "world/mesh.h"

namespace world {

/// True if the triangle a, b, c has an area; one that has none casts nothing. Computed in double:
/// true for anything thicker than about 2^-50 of its length.
bool hasArea(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c);

/// Reorders the level's triangles into clusters of at most kClusterTriangles, each compact in space,
/// and fills `clusters`. Triangles that repeat an index or have no area are dropped, and so are
/// vertices that nothing uses. Deterministic: the same level gives the same clusters.
void buildClusters(MeshLevel& level);

}  // namespace world
