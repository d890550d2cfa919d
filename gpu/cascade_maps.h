// gpu/cascade_maps.h — the two depth maps of each cascade: made, restored, read.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "gpu/frame.h"
#include "gpu/shadow_maps.h"

namespace gpu {

struct CascadeMaps {
    DepthMap cacheMap, working;
};

/// The maps of all cascades; they hold nothing yet. kDevice when the driver refuses.
world::Result<std::vector<CascadeMaps>> createCascadeMaps(Device::Impl& device,
                                                          const ShadowMapsConfig& config,
                                                          const std::string& prefix);

/// Clears new maps to kEmptyDepth.
void recordNew(Frame& frame, VkCommandBuffer commands, std::span<CascadeMaps> maps, uint32_t side);

/// Copies rectangles of the cache map, in kCopySourceLayout, to the working map, in kCopyTargetLayout.
/// `kept` is overwritten: it saves an allocation per call.
void recordRestores(VkCommandBuffer commands, const CascadeMaps& maps,
                    std::span<const cache::StoreRect> rects, std::vector<VkImageCopy>& kept);

/// Copies a map's texels, as they are stored, to where the CPU reads them.
void recordCopy(Frame& frame, VkCommandBuffer commands, DepthMap& map, uint32_t side, const Buffer& to, uint64_t offset);

/// A map's texels where the CPU can read them.
class Readback {
public:
    static world::Result<Readback> create(Device::Impl& device, uint32_t side, DepthFormat format);
    void record(Frame& frame, VkCommandBuffer commands, DepthMap& map) const;
    /// After that submission has finished: row by row, side * side values; units / 65535 for D16.
    std::vector<float> depths() const;

private:
    Buffer buffer_;
    uint32_t side_ = 0;
    DepthFormat format_ = DepthFormat::kD32;
};

}  // namespace gpu
