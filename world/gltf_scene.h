// world/gltf_scene.h — what casts in one glTF file: its nodes, placed, over its meshes.
// Source: Khronos, "glTF 2.0 Specification", 2021.
#pragma once

#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "world/chunk.h"
#include "world/result.h"

namespace world {

struct GltfCaster {
    std::string name;      ///< of its node
    Instance instance;     ///< of one of the scene's meshes
    glm::dvec3 centre{0};  ///< of its world bounds [m]
};

/// The default scene of a file.
struct GltfScene {
    std::vector<Mesh> meshes;         ///< one level each, without clusters
    std::vector<GltfCaster> casters;  ///< in the order of the file's nodes
    glm::dvec3 sun{0};                ///< direction of light travel, unit; zero if the file names none
    std::vector<std::string> warnings;
};

/// Reads the OPAQUE and MASK triangles of every node whose extras do not say `shadowPass: false`.
///   wantSun  look for the first directional light of KHR_lights_punctual; else for `sun_direction` of a
///            `scene.json` beside the file
/// kNotFound, kIo, kLimit and kBadData name the file and the place.
Result<GltfScene> readGltfScene(const std::string& path, bool wantSun);

}  // namespace world
