#include "gpu/depth_pass.h"

#include <algorithm>
#include <cstddef>

#include "gpu/shaders/depth.vert.h"
#include "gpu/shaders/spot.vert.h"
#include "gpu/shaders/view.vert.h"

namespace gpu {

using world::Result;

namespace {

/// What of a view the shader reads.
constexpr uint32_t kPushBytes = offsetof(DepthPass::View, slopeBias);
static_assert(kPushBytes == sizeof(glm::mat4) + 2 * sizeof(glm::vec4));

}  // namespace

Result<DepthPass> DepthPass::create(Device::Impl& device, DepthFormat format, Projection projection) {
    constexpr uint32_t kRow = sizeof(glm::vec4);
    static_assert(sizeof(glm::mat3x4) == 3 * kRow);
    const VkVertexInputBindingDescription bindings[] = {kPositionBinding,
                                                        {1, 3 * kRow, VK_VERTEX_INPUT_RATE_INSTANCE}};
    const VkVertexInputAttributeDescription attributes[] = {kPosition,
                                                            {1, 1, VK_FORMAT_R32G32B32A32_SFLOAT, 0},
                                                            {2, 1, VK_FORMAT_R32G32B32A32_SFLOAT, kRow},
                                                            {3, 1, VK_FORMAT_R32G32B32A32_SFLOAT, 2 * kRow}};
    VkPipelineVertexInputStateCreateInfo vertices{};
    vertices.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO;
    vertices.vertexBindingDescriptionCount = 2;
    vertices.pVertexBindingDescriptions = bindings;
    vertices.vertexAttributeDescriptionCount = 4;
    vertices.pVertexAttributeDescriptions = attributes;
    DepthPass pass(device);
    DepthPipelineInfo info{.vertexShader = kDepthVert, .vertices = vertices, .format = format, .name = "depth pass"};
    if (projection == Projection::kPerspective) {
        info.vertexShader = kSpotVert;
        info.outside = OutOfDepth::kCut;
        info.name = "spot depth pass";
    } else if (projection == Projection::kView) {
        info.vertexShader = kViewVert;
        info.pushBytes = kPushBytes;
        info.slopeBias = true;
        info.name = "view depth pass";
    }
    auto pipeline = createDepthPipeline(device, info);
    if (!pipeline) return pipeline.error();
    pass.pipeline_ = std::move(pipeline.value());
    return pass;
}

void DepthPass::record(VkCommandBuffer commands, const Image& map, uint32_t side, const Work& work,
                       const Buffers& buffers) {
    beginDepth(commands, map, side, VK_ATTACHMENT_LOAD_OP_LOAD);
    fillDepth(commands, work.unknowns, cache::kUnknownDepth, fillRects_);
    fillDepth(commands, work.clears, cache::kEmptyDepth, fillRects_);
    bindDepth(commands, pipeline_, side);
    const VkBuffer vertices[] = {buffers.geometry.raw(), buffers.instances.raw()};
    const VkDeviceSize starts[] = {0, 0};
    vkCmdBindVertexBuffers(commands, 0, 2, vertices, starts);
    vkCmdBindIndexBuffer(commands, buffers.geometry.raw(), 0, VK_INDEX_TYPE_UINT32);
    constexpr uint32_t kStride = sizeof(VkDrawIndexedIndirectCommand);
    for (const Draws& pass : work.draws) {
        if (empty(pass.scissor) || pass.run.count == 0) continue;
        const VkRect2D scissor = toVulkan(pass.scissor);
        vkCmdSetScissor(commands, 0, 1, &scissor);
        if (pass.view) {
            vkCmdPushConstants(commands, pipeline_.layout.raw(), VK_SHADER_STAGE_VERTEX_BIT, 0, kPushBytes, pass.view);
            vkCmdSetDepthBias(commands, 0, 0, pass.view->slopeBias);
        }
        for (uint32_t done = 0; done < pass.run.count;) {
            const uint32_t count = std::min(pass.run.count - done, device_->maxIndirectDraws);
            vkCmdDrawIndexedIndirect(commands, buffers.commands.raw(),
                                     VkDeviceSize{pass.run.first + done} * kStride, count, kStride);
            done += count;
        }
    }
    vkCmdEndRendering(commands);
}

}  // namespace gpu
