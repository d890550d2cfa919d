// world/gltf_file.h — reads a glTF file and the buffers it names, trusting neither.
// Source: Khronos, "glTF 2.0 Specification", 2021; the JSON and the GLB frame are tinygltf's.
#pragma once

#include <memory>
#include <string>

#include "world/result.h"

namespace tinygltf {
class Model;
}

namespace world {

/// Reads a .glb or .gltf file (told apart by content) with its buffers; images are never read.
/// A buffer's URI is a `data:` URI or a relative path that stays inside the file's own folder, links
/// included. kNotFound for a missing file or buffer; kLimit above 4 GiB; kBadData for everything
/// malformed or refused, and for a required extension that changes geometry. What the model says of
/// accessors, nodes and indices is not checked yet: world/gltf_mesh.h and world/gltf.cpp do.
Result<std::shared_ptr<const tinygltf::Model>> readGltfFile(const std::string& path);

/// False for extensions that leave positions, indices and nodes as they are (materials, textures,
/// lights): a file may require those, and using them loses nothing.
bool changesGeometry(const std::string& extension);

/// `error` with the file's name before it, on one line: texts that quote a file's names or URIs may run
/// over lines, or over megabytes.
Error inFile(const std::string& path, Error error);

}  // namespace world
