// world/gltf.h — glTF 2.0 scenes as a source to bake: their nodes are instances, their meshes are shared.
// Source: Khronos, "glTF 2.0 Specification", 2021.
#pragma once

#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <string>

#include "world/bake.h"
#include "world/result.h"

namespace world {

struct GltfOptions {
    double chunkSize = 0;                          ///< [m]; 0: chosen from the data
    std::optional<glm::dvec3> sun = std::nullopt;  ///< direction of light travel, any length above 0
};

/// Reads the default scenes of .glb and .gltf files, the tiles of one world: all in the same coordinates.
/// Casters are the OPAQUE and MASK triangles of every node whose extras do not say
/// `shadowPass: false`. An instance lives in the chunk column that holds the centre of its world
/// bounds, and carries its node's name where no other caster of the file has it; where one of another file
/// has it, it is FILE/NAME, the file's name without its ending.
/// The sun is the option; else, of the first file that has either, the first directional light of
/// KHR_lights_punctual or `sun_direction` of a `scene.json` beside the file; else zero.
/// kUsage for options out of range and a path that comes twice; kNotFound, kIo, kLimit and kBadData name the
/// file and the place. A source without casters is no error here.
Result<BakeSource> openGltf(std::span<const std::string> paths, const GltfOptions& options);
/// The same of one file.
inline Result<BakeSource> openGltf(const std::string& path, const GltfOptions& options) {
    return openGltf(std::span(&path, 1), options);
}

}  // namespace world
