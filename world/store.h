// world/store.h — a world file: one SQLite database of rows (x, y, z, lod, kind) to checked blobs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "world/chunk.h"
#include "world/result.h"

namespace world {

constexpr uint32_t kWorldVersion = 2;

enum class BlobKind : int32_t {
    kHeader = 0,       ///< Header; key 0,0,0,0
    kDirectory = 1,    ///< ChunkRecord of every chunk; key 0,0,0,0
    kMeshTable = 2,    ///< MeshRecord of every shared mesh; key 0,0,0,0
    kNames = 3,        ///< NamedInstance, sorted by name; key 0,0,0,0
    kMesh = 4,         ///< one MeshLevel; x = mesh id, y = z = 0, lod = level
    kInstances = 5,    ///< a chunk's instances; lod 0
    kTerrainMesh = 6,  ///< one MeshLevel of a chunk's terrain; lod = level
    kLevelSet = 7,     ///< a chunk's terrain level set (world/level_set.h); lod 0
    kChunkRecord = 8,  ///< an edited chunk's ChunkRecord, in place of the directory's; `recordKey`
};
const char* toString(BlobKind kind);

struct BlobKey {
    int32_t x = 0, y = 0, z = 0, lod = 0;
    BlobKind kind = BlobKind::kHeader;
    friend auto operator<=>(const BlobKey&, const BlobKey&) = default;
};
std::string toString(const BlobKey& key);

/// x of all rows of kind kChunkRecord: they follow each other, so that few are found among many others. No chunk is
/// that far west.
constexpr int32_t kRecordX = std::numeric_limits<int32_t>::min();
/// Where an edited chunk's own record is.
constexpr BlobKey recordKey(ChunkKey chunk) { return {kRecordX, chunk.x, chunk.z, chunk.y, BlobKind::kChunkRecord}; }

/// Writes a new world beside its final name, as `path`.baking, and renames it when whole: a reader never
/// meets half a world, and a failed or destroyed writer leaves nothing behind. One thread at a time.
///
/// Work in steps can be gone on with. When a process is killed, or the disk fills up, the steps that had
/// ended stay in `path`.baking, all but those of the last few MiB, and the next writer of the same work
/// has them.
class WorldWriter {
public:
    /// What a step left for the writer that goes on after it; bytes of the caller's.
    struct Step {
        std::vector<std::byte> record, names;
    };

    /// kIo where the folder cannot be written; an older file at `path` stays until `finish`.
    ///   work  tells what is written from all else, to the last bit; 0: nothing that can be gone on with
    static Result<WorldWriter> create(const std::string& path, uint64_t work = 0);
    WorldWriter(WorldWriter&&) noexcept;
    WorldWriter& operator=(WorldWriter&&) noexcept;
    ~WorldWriter();

    /// Stores `raw` compressed (zstd) with its size and a checksum that covers the key as well.
    /// Keys may come in any order, each once. kIo when the disk is full: the writer is then dead.
    Result<Done> put(const BlobKey& key, std::span<const std::byte> raw);

    /// The steps that have ended already, in their order; once.
    std::vector<Step> takeSteps();
    /// Whether a file was left there that could not be gone on with, and was overwritten.
    bool startedOver() const;
    /// Ends a step: it and the rows put since the last one stay or go together. Errors as of `put`.
    Result<Done> endStep(const Step& step);

    /// Commits, syncs and renames. The writer is spent.
    Result<Done> finish();

private:
    struct Impl;
    explicit WorldWriter(std::unique_ptr<Impl> impl);
    Error dead(const Error& why);
    std::unique_ptr<Impl> impl_;
};

/// A row's size, for `gnomon info`.
struct BlobInfo {
    BlobKey key;
    uint64_t rawBytes = 0, storedBytes = 0;
};

/// An open world, read-only. Reads may come from any number of threads at once, also while a WorldEditor, of this
/// process or another, changes the file: each read sees the world before or after an edit. Header and records are
/// those of the moment when it was opened.
/// Every blob's checksum is tested before a byte of it is parsed, and no length in it is trusted.
class WorldStore {
public:
    /// Opens and reads header, directory and mesh table, and the records of edited chunks. Takes back what an edit
    /// left that was cut short by a crash; for that the file must be writable.
    /// kNotFound; kBadData for a foreign, truncated, corrupt or newer file: the text says which.
    static Result<WorldStore> open(const std::string& path);
    WorldStore(WorldStore&&) noexcept;
    WorldStore& operator=(WorldStore&&) noexcept;
    ~WorldStore();

    const std::string& path() const;
    const Header& header() const;
    std::span<const ChunkRecord> chunks() const;  ///< ascending by key
    const ChunkRecord* find(ChunkKey key) const;  ///< null for a chunk that the world does not have
    std::span<const MeshRecord> meshes() const;   ///< index = mesh id

    Result<std::vector<NamedInstance>> names() const;
    /// The chunk with the levels of its terrain from `firstLevel` on, or whole. With `base`, which holds coarser
    /// levels of the same chunk, only those that it lacks are read.
    Result<Chunk> readChunk(ChunkKey key, size_t firstLevel = 0, const Chunk* base = nullptr) const;
    Result<Mesh> readMesh(uint32_t id) const;
    Result<std::vector<std::byte>> readBlob(const BlobKey& key) const;
    Result<std::vector<BlobInfo>> listBlobs() const;

    /// Hash over all keys and raw contents in key order: equal for equal worlds.
    Result<uint64_t> contentHash() const;

    /// Every checksum, and every invariant of the decoded rows (indices in range, clusters that
    /// cover their level, bounds that hold, instances that name existing meshes, levels ascending
    /// in error). Returns all findings, each naming its row; empty when the world is sound.
    std::vector<Error> check() const;

private:
    struct Impl;
    explicit WorldStore(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace world
