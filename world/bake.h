// world/bake.h — turns a source into a world file, chunk by chunk, on all cores, deterministically.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "world/chunk.h"
#include "world/result.h"

namespace world {

/// A chunk's terrain as a source made it.
struct TerrainChunk {
    Mesh mesh;                        ///< chunk frame; levels without clusters: baking cuts them
    std::vector<std::byte> levelSet;  ///< encoded, world/level_set.h
};

/// What a source says of one chunk.
struct SourceChunk {
    std::vector<Instance> instances;
    std::vector<std::string> names;  ///< one per instance ("" for none), or empty
    std::optional<TerrainChunk> terrain;
};

/// A source, ready to be asked for its chunks in any order from any thread.
struct BakeSource {
    Header header;             ///< bounds and version are filled in by baking
    std::vector<Mesh> meshes;  ///< shared meshes; levels without clusters
    std::vector<ChunkKey> chunks;  ///< ascending, unique
    std::function<Result<SourceChunk>(ChunkKey)> make;  ///< same key, same answer
    uint64_t contents = 0;  ///< hash of all that `make` answers from: other contents, other hash
    std::vector<std::string> warnings;  ///< for the user, one line each: "12 garbage cells ..."
};

/// Called now and then from one thread at a time: chunks done, chunks in all.
using Progress = std::function<void(size_t done, size_t total)>;

/// Told, before the first chunk, what has become of an unfinished bake that lay there.
using Notice = std::function<void(const std::string& line)>;

struct BakeStats {
    size_t chunks = 0, instances = 0, terrainTriangles = 0;
};

/// Bakes `source` into `path`. The result does not depend on the number of threads, nor on how often the
/// bake was killed: it goes on where it was if source and program are the same, and begins anew if not.
/// kBadData for a source without casters; errors of `make` and of the writer pass through, and then
/// `path` is as it was.
Result<BakeStats> bake(const BakeSource& source, const std::string& path, const Progress& progress,
                       const Notice& notice = {});

}  // namespace world
