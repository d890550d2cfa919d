// gpu/depth_pipeline.h — the state in which every triangle is drawn to a map, and the commands around it.
// There is no fragment shader: on a software driver an empty one makes a pass five times slower.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/memory.h"

namespace gpu {

/// Triangle lists of three floats a vertex; depth test LESS, both faces, viewport (0, 0, side, side),
/// depth [0, 1] mapped and clamped to [kNearestDepth, 1]. Since only the scissor ever changes, what a
/// triangle leaves in a texel does not depend on the pass that drew it.
world::Result<PipelineHandle> createDepthPipeline(Device::Impl& device, VkPipelineLayout layout,
                                                  std::span<const uint32_t> vertexShader, uint32_t side,
                                                  DepthFormat format, const std::string& name);

/// Begins rendering to a map in kAttachmentLayout; clears it to kEmptyDepth if `load` says so.
void beginDepth(VkCommandBuffer commands, const Image& map, uint32_t side, VkAttachmentLoadOp load);
/// Sets rectangles of the map that is rendered to. `kept` is overwritten: it saves an allocation.
void fillDepth(VkCommandBuffer commands, std::span<const cache::StoreRect> rects, float depth,
               std::vector<VkClearRect>& kept);

bool empty(const cache::StoreRect& rect);
VkRect2D toVulkan(const cache::StoreRect& rect);

}  // namespace gpu
