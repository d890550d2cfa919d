// world/codec.h — what the rows of a world file say, as bytes: explicit little-endian fields.
// Every decoder takes bytes from anywhere: it answers kBadData, naming the byte, unless all of them make
// sense. What it returns is safe to index with: counts, ids and ranges agree within the row.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "world/chunk.h"
#include "world/result.h"

namespace world {

constexpr uint32_t kMaxLevels = 64;  ///< of detail, of one mesh; a guard, worlds have a handful

std::vector<std::byte> encodeHeader(const Header& header);
/// Any version: the fields of a newer one are not read, only `version` is then filled in.
Result<Header> decodeHeader(std::span<const std::byte> bytes);

std::vector<std::byte> encodeDirectory(std::span<const ChunkRecord> chunks);
/// Keys strictly ascending, mesh ids of each record strictly ascending.
Result<std::vector<ChunkRecord>> decodeDirectory(std::span<const std::byte> bytes);

std::vector<std::byte> encodeMeshTable(std::span<const MeshRecord> meshes);
/// Each with 1 to kMaxLevels levels.
Result<std::vector<MeshRecord>> decodeMeshTable(std::span<const std::byte> bytes);

std::vector<std::byte> encodeNames(std::span<const NamedInstance> names);
/// Ascending by name, then chunk, then slot; no entry twice.
Result<std::vector<NamedInstance>> decodeNames(std::span<const std::byte> bytes);

std::vector<std::byte> encodeInstances(std::span<const Instance> instances);
Result<std::vector<Instance>> decodeInstances(std::span<const std::byte> bytes);

std::vector<std::byte> encodeMeshLevel(const MeshLevel& level);
/// Indices in range, clusters within their size that follow each other and cover all indices.
Result<MeshLevel> decodeMeshLevel(std::span<const std::byte> bytes);

}  // namespace world
