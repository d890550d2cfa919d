#include "gpu/depth_pass.h"

#include <algorithm>

#include "gpu/depth_pipeline.h"
#include "gpu/shaders/depth.vert.h"
#include "world/check.h"

namespace gpu {
namespace {

using world::Done;
using world::Result;

}  // namespace

Result<DepthPass> DepthPass::create(Device::Impl& device, uint32_t side, DepthFormat format,
                                    uint32_t inputSets) {
    DepthPass pass(device, side);
    if (const auto made = pass.makeLayout(inputSets); !made) return made.error();
    auto pipeline = createDepthPipeline(device, pass.layout_.raw(), kDepthVert, side, format, "depth pass");
    if (!pipeline) return pipeline.error();
    pass.pipeline_ = std::move(pipeline.value());
    return pass;
}

Result<Done> DepthPass::makeLayout(uint32_t inputSets) {
    VkDescriptorSetLayoutBinding bindings[2]{};
    for (uint32_t i = 0; i < 2; ++i)
        bindings[i] = {i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_VERTEX_BIT, nullptr};
    VkDescriptorSetLayoutCreateInfo setLayout{};
    setLayout.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
    setLayout.bindingCount = 2;
    setLayout.pBindings = bindings;
    auto setLayoutHandle = SetLayoutHandle::create(device_->owner, setLayout, "depth pass inputs");
    if (!setLayoutHandle) return setLayoutHandle.error();
    setLayout_ = std::move(setLayoutHandle.value());

    const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 2 * inputSets};
    VkDescriptorPoolCreateInfo pool{};
    pool.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
    pool.maxSets = inputSets;
    pool.poolSizeCount = 1;
    pool.pPoolSizes = &size;
    auto poolHandle = DescriptorPoolHandle::create(device_->owner, pool, "depth pass descriptors");
    if (!poolHandle) return poolHandle.error();
    pool_ = std::move(poolHandle.value());

    const VkDescriptorSetLayout rawSetLayout = setLayout_.raw();
    VkPipelineLayoutCreateInfo layout{};
    layout.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
    layout.setLayoutCount = 1;
    layout.pSetLayouts = &rawSetLayout;
    auto layoutHandle = PipelineLayoutHandle::create(device_->owner, layout, "depth pass layout");
    if (!layoutHandle) return layoutHandle.error();
    layout_ = std::move(layoutHandle.value());
    return Done{};
}

Result<VkDescriptorSet> DepthPass::makeInputs(const std::string& name) {
    const VkDescriptorSetLayout setLayout = setLayout_.raw();
    VkDescriptorSetAllocateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
    info.descriptorPool = pool_.raw();
    info.descriptorSetCount = 1;
    info.pSetLayouts = &setLayout;
    VkDescriptorSet set = VK_NULL_HANDLE;
    const VkResult allocated = vkAllocateDescriptorSets(device_->owner.device, &info, &set);
    if (allocated != VK_SUCCESS) return refused(allocated, "vkAllocateDescriptorSets", name);
    device_->owner.name(VK_OBJECT_TYPE_DESCRIPTOR_SET, reinterpret_cast<uint64_t>(set), name);
    return set;
}

void DepthPass::bind(VkDescriptorSet inputs, const Buffer& transforms, const Buffer& instances) const {
    const VkDescriptorBufferInfo buffers[] = {{transforms.raw(), 0, VK_WHOLE_SIZE},
                                              {instances.raw(), 0, VK_WHOLE_SIZE}};
    VkWriteDescriptorSet write{};
    write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    write.dstSet = inputs;
    write.descriptorCount = 2;  // runs on into the second binding
    write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    write.pBufferInfo = buffers;
    vkUpdateDescriptorSets(device_->owner.device, 1, &write, 0, nullptr);
}

void DepthPass::record(VkCommandBuffer commands, const Image& map, const Work& work, const Buffers& buffers) {
    beginDepth(commands, map, side_, VK_ATTACHMENT_LOAD_OP_LOAD);
    fillDepth(commands, work.unknowns, cache::kUnknownDepth, fillRects_);
    fillDepth(commands, work.clears, cache::kEmptyDepth, fillRects_);
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline_.raw());
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, layout_.raw(), 0, 1, &buffers.inputs,
                            0, nullptr);
    const VkBuffer geometry = buffers.geometry.raw();
    const VkDeviceSize start = 0;
    vkCmdBindVertexBuffers(commands, 0, 1, &geometry, &start);
    vkCmdBindIndexBuffer(commands, geometry, 0, VK_INDEX_TYPE_UINT32);
    constexpr uint32_t kStride = sizeof(VkDrawIndexedIndirectCommand);
    for (const Draws& pass : work.draws) {
        if (empty(pass.scissor) || pass.run.count == 0) continue;
        const VkRect2D scissor = toVulkan(pass.scissor);
        vkCmdSetScissor(commands, 0, 1, &scissor);
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
