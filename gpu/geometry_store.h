// gpu/geometry_store.h — mesh levels in one arena of GPU memory. What lies where, and what still fits, follows from the calls
// alone, and not from how far the GPU is.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/arena.h"
#include "gpu/draw_list.h"
#include "gpu/memory.h"
#include "world/mesh.h"

namespace gpu {

/// One thread at a time.
class GeometryStore {
public:
    /// Waits for all submissions up to a ticket.
    using Await = std::function<world::Result<world::Done>(uint64_t reader)>;

    /// kLimit names the budget when the device cannot give that much in one piece.
    static world::Result<GeometryStore> create(Device::Impl& device, uint64_t bytes);

    /// Copies positions and indices into the arena; awaits whoever reads what lay there. kLimit names the budget when it is
    /// full; after that, and after an error of `await`, nothing has changed.
    world::Result<cache::GeometryId> upload(const world::MeshLevel& level, const Await& await);
    /// The id and its space are free at once; submissions up to `lastReader` may still read it.
    void release(cache::GeometryId id, uint64_t lastReader);
    /// All submissions up to this ticket have finished.
    void forgetReaders(uint64_t finished);

    bool live(cache::GeometryId id) const { return id < slots_.size() && slots_[id].live; }
    std::span<const ArenaRange> ranges() const { return ranges_; }  ///< by GeometryId
    const Buffer& buffer() const { return buffer_; }
    uint64_t bytesUsed() const;
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
    std::vector<Retired> retired_;    ///< what lay there may still be read; may overlap what lies there now
    std::vector<cache::GeometryId> freeIds_;
    uint64_t uploaded_ = 0;
};

}  // namespace gpu
