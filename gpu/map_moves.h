// gpu/map_moves.h — moves depths from map to map: copies to and from a buffer, in which a shader adds to them.
// The copies put depths where a sampler's offset would: a pass over all texels costs a software driver far more.
#pragma once

#include <span>

#include "gpu/compute.h"
#include "gpu/frame.h"
#include "gpu/view_maps.h"

namespace gpu {

/// Of maps of one size and format. One thread at a time.
class MapMoves {
public:
    /// `device` must outlive it. kDevice, or kLimit for a map larger than a shader can see.
    static world::Result<MapMoves> create(Device::Impl& device, uint32_t side, DepthFormat format);
    /// Never submits, waits or allocates. CHECKs that the maps are there.
    void record(Frame& frame, VkCommandBuffer commands, std::span<DepthMap> maps, const MapMove& move) const;

private:
    void add(VkCommandBuffer commands, uint32_t texels, int units) const;

    uint32_t side_ = 0;
    DepthFormat format_ = DepthFormat::kD32;
    Buffer depths_;
    Compute adding_;
};

}  // namespace gpu
