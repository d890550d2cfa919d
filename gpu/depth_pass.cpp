#include "gpu/depth_pass.h"

#include <algorithm>

#include "gpu/frame.h"
#include "gpu/shaders/depth.vert.h"
#include "world/check.h"

namespace gpu {
namespace {

using world::Done;
using world::Result;

VkRect2D toVulkan(const cache::StoreRect& rect) {
    return {{rect.min.x, rect.min.y},
            {static_cast<uint32_t>(rect.max.x - rect.min.x), static_cast<uint32_t>(rect.max.y - rect.min.y)}};
}

bool empty(const cache::StoreRect& rect) { return rect.max.x <= rect.min.x || rect.max.y <= rect.min.y; }

}  // namespace

Result<DepthPass> DepthPass::create(Device::Impl& device, uint32_t side, DepthFormat format,
                                    uint32_t inputSets) {
    DepthPass pass(device, side);
    if (const auto made = pass.makeLayout(inputSets); !made) return made.error();
    if (const auto made = pass.makePipeline(format); !made) return made.error();
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

Result<Done> DepthPass::makePipeline(DepthFormat format) {
    VkShaderModuleCreateInfo module{};
    module.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    module.codeSize = sizeof(kDepthVert);
    module.pCode = kDepthVert;
    const auto shader = ShaderHandle::create(device_->owner, module, "depth.vert");
    if (!shader) return shader.error();
    VkPipelineShaderStageCreateInfo stage{};
    stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    stage.stage = VK_SHADER_STAGE_VERTEX_BIT;
    stage.module = shader.value().raw();
    stage.pName = "main";

    const VkVertexInputBindingDescription binding{0, 3 * sizeof(float), VK_VERTEX_INPUT_RATE_VERTEX};
    const VkVertexInputAttributeDescription position{0, 0, VK_FORMAT_R32G32B32_SFLOAT, 0};
    VkPipelineVertexInputStateCreateInfo vertices{};
    vertices.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO;
    vertices.vertexBindingDescriptionCount = 1;
    vertices.pVertexBindingDescriptions = &binding;
    vertices.vertexAttributeDescriptionCount = 1;
    vertices.pVertexAttributeDescriptions = &position;
    VkPipelineInputAssemblyStateCreateInfo assembly{};
    assembly.sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO;
    assembly.topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST;

    const VkViewport wholeMap{
        0, 0, static_cast<float>(side_), static_cast<float>(side_), cache::kNearestDepth, 1};
    VkPipelineViewportStateCreateInfo viewport{};
    viewport.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO;
    viewport.viewportCount = 1;
    viewport.pViewports = &wholeMap;
    viewport.scissorCount = 1;
    VkPipelineRasterizationStateCreateInfo raster{};
    raster.sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO;
    raster.depthClampEnable = VK_TRUE;
    raster.polygonMode = VK_POLYGON_MODE_FILL;
    raster.cullMode = VK_CULL_MODE_NONE;
    raster.frontFace = VK_FRONT_FACE_COUNTER_CLOCKWISE;
    raster.lineWidth = 1;
    VkPipelineMultisampleStateCreateInfo samples{};
    samples.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO;
    samples.rasterizationSamples = VK_SAMPLE_COUNT_1_BIT;
    VkPipelineDepthStencilStateCreateInfo depth{};
    depth.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO;
    depth.depthTestEnable = VK_TRUE;
    depth.depthWriteEnable = VK_TRUE;
    depth.depthCompareOp = VK_COMPARE_OP_LESS;
    const VkDynamicState scissor = VK_DYNAMIC_STATE_SCISSOR;
    VkPipelineDynamicStateCreateInfo dynamic{};
    dynamic.sType = VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO;
    dynamic.dynamicStateCount = 1;
    dynamic.pDynamicStates = &scissor;
    VkPipelineRenderingCreateInfo rendering{};
    rendering.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO;
    rendering.depthAttachmentFormat = toVulkan(format);

    VkGraphicsPipelineCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO;
    info.pNext = &rendering;
    info.stageCount = 1;
    info.pStages = &stage;
    info.pVertexInputState = &vertices;
    info.pInputAssemblyState = &assembly;
    info.pViewportState = &viewport;
    info.pRasterizationState = &raster;
    info.pMultisampleState = &samples;
    info.pDepthStencilState = &depth;
    info.pDynamicState = &dynamic;
    info.layout = layout_.raw();
    auto pipeline = PipelineHandle::create(device_->owner, info, "depth pass");
    if (!pipeline) return pipeline.error();
    pipeline_ = std::move(pipeline.value());
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

void DepthPass::begin(VkCommandBuffer commands, const Image& map, VkAttachmentLoadOp load) const {
    VkRenderingAttachmentInfo attachment{};
    attachment.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO;
    attachment.imageView = map.view.raw();
    attachment.imageLayout = kAttachmentLayout;
    attachment.loadOp = load;
    attachment.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
    attachment.clearValue.depthStencil = {cache::kEmptyDepth, 0};
    VkRenderingInfo info{};
    info.sType = VK_STRUCTURE_TYPE_RENDERING_INFO;
    info.renderArea = {{0, 0}, {side_, side_}};
    info.layerCount = 1;
    info.pDepthAttachment = &attachment;
    vkCmdBeginRendering(commands, &info);
}

void DepthPass::recordNew(VkCommandBuffer commands, const Image& map) const {
    begin(commands, map, VK_ATTACHMENT_LOAD_OP_CLEAR);
    vkCmdEndRendering(commands);
}

void DepthPass::fill(VkCommandBuffer commands, std::span<const cache::StoreRect> rects, float depth) {
    fillRects_.clear();
    for (const cache::StoreRect& rect : rects)
        if (!empty(rect)) fillRects_.push_back({toVulkan(rect), 0, 1});
    if (fillRects_.empty()) return;
    VkClearAttachment clear{};
    clear.aspectMask = VK_IMAGE_ASPECT_DEPTH_BIT;
    clear.clearValue.depthStencil = {depth, 0};
    vkCmdClearAttachments(commands, 1, &clear, static_cast<uint32_t>(fillRects_.size()), fillRects_.data());
}

void DepthPass::record(VkCommandBuffer commands, const Image& map, const Work& work, const Buffers& buffers) {
    begin(commands, map, VK_ATTACHMENT_LOAD_OP_LOAD);
    fill(commands, work.unknowns, cache::kUnknownDepth);
    fill(commands, work.clears, cache::kEmptyDepth);
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
