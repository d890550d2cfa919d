// server/terrain_edits.h — terrain edits on their way: made by a thread of their own, taken up between frames.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "world/edited_terrain.h"

namespace server {

/// Edits are made one after the other, in the order in which they were given. All calls from one thread.
class TerrainEdits {
public:
    /// `store` must outlive it, and so must `editor`, to which edits are committed; null: they stay in memory.
    ///   mostBytes  that edited chunks may take in memory; an edit that asks for more fails
    TerrainEdits(const world::WorldStore& store, world::WorldEditor* editor, uint64_t mostBytes);
    /// Edits that were given and not begun are dropped.
    ~TerrainEdits();
    TerrainEdits(const TerrainEdits&) = delete;
    TerrainEdits& operator=(const TerrainEdits&) = delete;

    /// Errors of `EditedTerrain::require`: then it is not taken.
    world::Result<world::Done> give(const world::TerrainEdit& edit);

    struct Finished {
        std::vector<std::shared_ptr<const world::EditedChunk>> chunks;  ///< in the order in which they changed
        std::vector<world::Error> errors;  ///< of edits that failed later, and changed nothing
        uint64_t edits = 0;                ///< that did not fail
    };
    /// What was finished since the last call. `wait`: all that were given are.
    Finished take(bool wait);

private:
    void work();

    world::EditedTerrain terrain_;
    std::mutex mutex_;  ///< guards what follows
    std::condition_variable changed_;
    std::deque<world::TerrainEdit> given_;  ///< the first is being made
    Finished finished_;
    bool stop_ = false;
    std::thread worker_;  ///< begun by the first edit
};

}  // namespace server
