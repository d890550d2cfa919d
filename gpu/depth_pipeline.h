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

/// Triangles beyond depth 0 and 1.
enum class OutOfDepth { kClamped, kCut };

/// Triangle lists; depth test LESS, both faces, viewport (0, 0, side, side), depth [0, 1] mapped to
/// [kNearestDepth, 1]. Since only the scissor ever changes on a map, what a triangle leaves in a texel does not
/// depend on the pass that drew it. The shader's only inputs are vertex attributes. One serves maps of every
/// size: on a software driver each takes 0.3 MB for as long as it is there.
struct DepthPipeline {
    PipelineLayoutHandle layout;
    PipelineHandle handle;
};
struct DepthPipelineInfo {
    std::span<const uint32_t> vertexShader;
    const VkPipelineVertexInputStateCreateInfo& vertices;
    DepthFormat format = DepthFormat::kD32;
    OutOfDepth outside = OutOfDepth::kClamped;
    uint32_t pushBytes = 0;  ///< of constants for the vertex shader
    bool slopeBias = false;  ///< set by vkCmdSetDepthBias
    std::string name{};
};
world::Result<DepthPipeline> createDepthPipeline(Device::Impl& device, const DepthPipelineInfo& info);
/// Binds it for a map of `side` texels a side.
void bindDepth(VkCommandBuffer commands, const DepthPipeline& pipeline, uint32_t side);

/// Positions: three floats a vertex, binding 0, location 0.
constexpr VkVertexInputBindingDescription kPositionBinding{0, 3 * sizeof(float), VK_VERTEX_INPUT_RATE_VERTEX};
constexpr VkVertexInputAttributeDescription kPosition{0, 0, VK_FORMAT_R32G32B32_SFLOAT, 0};

/// Begins rendering to a map in kAttachmentLayout; clears it to kEmptyDepth if `load` says so.
void beginDepth(VkCommandBuffer commands, const Image& map, uint32_t side, VkAttachmentLoadOp load);
/// Sets rectangles of the map that is rendered to. `kept` is overwritten: it saves an allocation.
void fillDepth(VkCommandBuffer commands, std::span<const cache::StoreRect> rects, float depth,
               std::vector<VkClearRect>& kept);

bool empty(const cache::StoreRect& rect);
VkRect2D toVulkan(const cache::StoreRect& rect);

}  // namespace gpu
