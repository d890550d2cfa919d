// gpu/geometry_store.h — mesh levels in one arena of GPU memory; the space of what is released goes back once no
// submission can read it.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/arena.h"
#include "gpu/draw_list.h"
#include "gpu/memory.h"
#include "world/mesh.h"

namespace gpu {

/// Never waits for the GPU: whoever submits says which submissions have finished. One thread at a time.
class GeometryStore {
public:
    /// kLimit names the budget when the device cannot give that much in one piece.
    static world::Result<GeometryStore> create(Device::Impl& device, uint64_t bytes);

    /// Copies positions and indices into the arena. kLimit names the budget when it is full.
    world::Result<cache::GeometryId> upload(const world::MeshLevel& level);
    /// The id is dead and free at once: what a plan calls its meshes must not depend on how far the GPU is. Its space goes
    /// back with `reclaim` of `lastReader` or later.
    void release(cache::GeometryId id, uint64_t lastReader);
    /// All submissions up to this ticket have finished.
    void reclaim(uint64_t finished);

    bool live(cache::GeometryId id) const { return id < slots_.size() && slots_[id].live; }
    bool anyRetired() const { return !retired_.empty(); }
    std::span<const ArenaRange> ranges() const { return ranges_; }  ///< by GeometryId
    const Buffer& buffer() const { return buffer_; }
    uint64_t bytesUsed() const;                           ///< with what is released and not reclaimed
    uint64_t uploadedBytes() const { return uploaded_; }  ///< since creation

private:
    /// What the arena holds for one id.
    struct Slot {
        uint32_t offset = 0, units = 0;  ///< units 0: an empty mesh level, nothing in the arena
        bool live = false;
    };
    struct Retired {
        uint64_t lastReader = 0;
        uint32_t offset = 0, units = 0;  ///< units > 0
    };
    explicit GeometryStore(uint32_t units) : arena_(units) {}

    Arena arena_;
    Buffer buffer_;
    std::vector<Slot> slots_;         ///< by GeometryId
    std::vector<ArenaRange> ranges_;  ///< likewise
    std::vector<Retired> retired_;    ///< readers ascend
    std::vector<cache::GeometryId> freeIds_;
    uint64_t uploaded_ = 0;
};

}  // namespace gpu
