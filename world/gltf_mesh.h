// world/gltf_mesh.h — the shape that a glTF mesh casts: its opaque primitives as one triangle list.
// Source: Khronos, "glTF 2.0 Specification", 2021, sections 3.6 and 3.7.
#pragma once

#include <cstddef>

#include "world/mesh.h"
#include "world/result.h"

namespace tinygltf {
class Model;
}

namespace world {

struct GltfMesh {
    Mesh mesh;           ///< one level without clusters, no vertex twice; no level if nothing casts
    size_t flat = 0;     ///< triangles without area, left out
    size_t blended = 0;  ///< primitives left out because their material is BLEND
    size_t casting = 0;  ///< primitives that cast
};

/// Reads mesh `index` of `model`: triangles, strips and fans of OPAQUE and MASK materials; points and
/// lines are no casters. Every range is checked: kBadData names mesh, primitive and accessor; kLimit,
/// before anything is stored, above `mostTriangles`. `index` must be in range. Safe from any thread.
Result<GltfMesh> readGltfMesh(const tinygltf::Model& model, size_t index, size_t mostTriangles);

}  // namespace world
