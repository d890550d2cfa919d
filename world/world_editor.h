// world/world_editor.h — changes chunks of a finished world in place: an edit is in the file whole, or not at all.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "world/chunk.h"
#include "world/result.h"

namespace world {

/// A chunk whose terrain was changed. Holds views.
struct ChangedChunk {
    const ChunkRecord& record;  ///< with its new bounds and levels; the rest as it was
    const std::vector<std::byte>& set;  ///< encoded
    const Mesh& terrain;        ///< at least one level, with clusters
};

/// The one writer of a world file. Readers (WorldStore) go on beside it, in this process and others; each of its
/// commits waits for their reads under way, and they for it. Between commits the file is whole by itself; a process
/// that dies within one leaves a journal beside it, by which the next to open the world takes the edit back (one that had
/// not begun to write the world says nothing, and stays until the next edit). One thread at a time.
class WorldEditor {
public:
    /// kNotFound and kBadData as WorldStore::open; kIo where the file cannot be written, and where another editor has
    /// it. A bake of the same name is not kept out: it replaces the world, and `commit` then says so.
    static Result<WorldEditor> open(const std::string& path);
    WorldEditor(WorldEditor&&) noexcept;
    WorldEditor& operator=(WorldEditor&&) noexcept;
    ~WorldEditor();

    /// Writes level sets, terrain meshes and records of all the chunks in one transaction, and the world's bounds if
    /// they grew. When it returns they are on the disk. kIo for a full disk, for readers that do not let go, and for a
    /// world that was replaced: then the file is as it was.
    Result<Done> commit(std::span<const ChangedChunk> chunks);

private:
    struct Impl;
    explicit WorldEditor(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace world
