// world/edited_terrain.h — a world's terrain while it is edited: what edits changed, over what the file holds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <vector>

#include "world/store.h"
#include "world/terrain_edit.h"
#include "world/world_editor.h"

namespace world {

/// A chunk's terrain after an edit.
struct EditedChunk {
    ChunkRecord record;       ///< with its new bounds and levels
    Box instanceBounds;       ///< of what stands in the chunk, world frame [m]
    std::vector<std::byte> set;  ///< encoded: a level set takes several times as much
    Mesh terrain;
    /// By level: where the edit changed the terrain; empty for nowhere. In the chunk's frame [m]. All of it, in both
    /// states, for a level that only one of them has.
    std::vector<Box> changes;
};

/// What it takes in memory, but for a few hundred bytes.
uint64_t memoryBytes(const EditedChunk& chunk);

/// Holds all chunks that were edited, 0.5 to 1 MB each, whatever becomes of the file. One thread at a time, except for
/// `require`; `apply` runs on all of TBB's threads and gives the same chunks for any number of them.
class EditedTerrain {
public:
    /// `store` must outlive it, and so must `editor`, to which each edit is committed; null: edits stay in memory.
    /// Nobody else may edit the world meanwhile.
    ///   mostBytes  that edited chunks may take together, by `memoryBytes`
    explicit EditedTerrain(const WorldStore& store, WorldEditor* editor = nullptr,
                           uint64_t mostBytes = std::numeric_limits<uint64_t>::max())
        : store_(store), editor_(editor), mostBytes_(mostBytes) {}

    /// Whether the edit makes sense here: errors of `requireEdit`, and kNotFound where no chunk that it reaches has
    /// terrain. From any thread.
    Result<Done> require(const TerrainEdit& edit) const;

    /// The chunks that the edit changed, ascending by key. Of the chunks that it reaches those without terrain are left
    /// out: nothing is known there, and no ground is made. Errors of `require` and `edited`; kBadData for a chunk that
    /// does not hold what it should; kLimit where too many chunks would be edited; those of the editor. After an error nothing has changed.
    Result<std::vector<std::shared_ptr<const EditedChunk>>> apply(const TerrainEdit& edit);

private:
    std::vector<ChunkKey> terrainWithin(const TerrainEdit& edit) const;
    Result<std::shared_ptr<const EditedChunk>> current(ChunkKey key) const;

    const WorldStore& store_;
    WorldEditor* editor_;
    uint64_t mostBytes_, bytes_ = 0;
    std::map<ChunkKey, std::shared_ptr<const EditedChunk>> chunks_;
};

}  // namespace world
