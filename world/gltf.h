// world/gltf.h — a glTF 2.0 scene as a source to bake: its nodes are instances, its meshes are shared.
// Source: Khronos, "glTF 2.0 Specification", 2021.
#pragma once

#include <glm/glm.hpp>
#include <optional>
#include <string>

#include "world/bake.h"
#include "world/result.h"

namespace world {

struct GltfOptions {
    double chunkSize = 0;                          ///< [m]; 0: chosen from the data
    std::optional<glm::dvec3> sun = std::nullopt;  ///< direction of light travel, any length above 0
};

/// Reads the default scene of a .glb or .gltf file.
/// Casters are the OPAQUE and MASK triangles of every node whose extras do not say
/// `shadowPass: false`. An instance lives in the chunk column that holds the centre of its world
/// bounds, and carries its node's name where no other caster has it.
/// The sun is the option; else the first directional light of KHR_lights_punctual; else
/// `sun_direction` of a `scene.json` beside the file; else zero.
/// kUsage for options out of range; kNotFound, kIo, kLimit and kBadData name the file and the place.
/// A source without casters is no error here.
Result<BakeSource> openGltf(const std::string& path, const GltfOptions& options);

}  // namespace world
