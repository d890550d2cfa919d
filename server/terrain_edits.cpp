#include "server/terrain_edits.h"

#include <malloc.h>

#include <utility>

namespace server {

TerrainEdits::TerrainEdits(const world::WorldStore& store, world::WorldEditor* editor, uint64_t mostBytes)
    : terrain_(store, editor, mostBytes) {}

TerrainEdits::~TerrainEdits() {
    {
        const std::lock_guard lock(mutex_);
        stop_ = true;
    }
    changed_.notify_all();
    if (worker_.joinable()) worker_.join();
}

world::Result<world::Done> TerrainEdits::give(const world::TerrainEdit& edit) {
    if (const auto good = terrain_.require(edit); !good) return good.error();
    {
        const std::lock_guard lock(mutex_);
        given_.push_back(edit);
    }
    changed_.notify_all();
    if (!worker_.joinable()) worker_ = std::thread([this] { work(); });
    return world::Done{};
}

TerrainEdits::Finished TerrainEdits::take(bool wait) {
    std::unique_lock lock(mutex_);
    if (wait) changed_.wait(lock, [this] { return given_.empty(); });
    return std::exchange(finished_, {});
}

void TerrainEdits::work() {
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] { return stop_ || !given_.empty(); });
        if (stop_) return;
        const world::TerrainEdit edit = given_.front();
        lock.unlock();
        auto made = terrain_.apply(edit);
        // Making a mesh takes many times what it comes to, and the heap keeps what small blocks leave free.
        malloc_trim(0);
        lock.lock();
        given_.pop_front();
        if (made) {
            ++finished_.edits;
            finished_.chunks.insert(finished_.chunks.end(), made.value().begin(), made.value().end());
        } else {
            finished_.errors.push_back(made.error());
        }
        changed_.notify_all();
    }
}

}  // namespace server
