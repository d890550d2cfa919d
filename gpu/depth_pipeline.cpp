#include "gpu/depth_pipeline.h"

#include "gpu/frame.h"

namespace gpu {

using world::Result;

VkRect2D toVulkan(const cache::StoreRect& rect) {
    return {{rect.min.x, rect.min.y},
            {static_cast<uint32_t>(rect.max.x - rect.min.x), static_cast<uint32_t>(rect.max.y - rect.min.y)}};
}

bool empty(const cache::StoreRect& rect) { return rect.max.x <= rect.min.x || rect.max.y <= rect.min.y; }

Result<DepthPipeline> createDepthPipeline(Device::Impl& device, const DepthPipelineInfo& wanted) {
    VkPipelineLayoutCreateInfo layoutInfo{};
    layoutInfo.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
    const VkPushConstantRange constants{VK_SHADER_STAGE_VERTEX_BIT, 0, wanted.pushBytes};
    layoutInfo.pushConstantRangeCount = wanted.pushBytes > 0 ? 1 : 0;
    layoutInfo.pPushConstantRanges = &constants;
    auto layout = PipelineLayoutHandle::create(device.owner, layoutInfo, wanted.name + " layout");
    if (!layout) return layout.error();

    VkShaderModuleCreateInfo module{};
    module.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    module.codeSize = wanted.vertexShader.size_bytes();
    module.pCode = wanted.vertexShader.data();
    const auto shader = ShaderHandle::create(device.owner, module, wanted.name + " vertex shader");
    if (!shader) return shader.error();
    VkPipelineShaderStageCreateInfo stage{};
    stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    stage.stage = VK_SHADER_STAGE_VERTEX_BIT;
    stage.module = shader.value().raw();
    stage.pName = "main";

    VkPipelineInputAssemblyStateCreateInfo assembly{};
    assembly.sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO;
    assembly.topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST;

    VkPipelineViewportStateCreateInfo viewport{};
    viewport.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO;
    viewport.viewportCount = 1;
    viewport.scissorCount = 1;
    VkPipelineRasterizationStateCreateInfo raster{};
    raster.sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO;
    raster.depthClampEnable = wanted.outside == OutOfDepth::kClamped ? VK_TRUE : VK_FALSE;
    raster.polygonMode = VK_POLYGON_MODE_FILL;
    raster.cullMode = VK_CULL_MODE_NONE;
    raster.frontFace = VK_FRONT_FACE_COUNTER_CLOCKWISE;
    raster.lineWidth = 1;
    raster.depthBiasEnable = wanted.slopeBias ? VK_TRUE : VK_FALSE;
    VkPipelineMultisampleStateCreateInfo samples{};
    samples.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO;
    samples.rasterizationSamples = VK_SAMPLE_COUNT_1_BIT;
    VkPipelineDepthStencilStateCreateInfo depth{};
    depth.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO;
    depth.depthTestEnable = VK_TRUE;
    depth.depthWriteEnable = VK_TRUE;
    depth.depthCompareOp = VK_COMPARE_OP_LESS;
    const VkDynamicState states[] = {VK_DYNAMIC_STATE_VIEWPORT, VK_DYNAMIC_STATE_SCISSOR, VK_DYNAMIC_STATE_DEPTH_BIAS};
    VkPipelineDynamicStateCreateInfo dynamic{};
    dynamic.sType = VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO;
    dynamic.dynamicStateCount = wanted.slopeBias ? 3 : 2;
    dynamic.pDynamicStates = states;
    VkPipelineRenderingCreateInfo rendering{};
    rendering.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO;
    rendering.depthAttachmentFormat = toVulkan(wanted.format);

    VkGraphicsPipelineCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO;
    info.pNext = &rendering;
    info.stageCount = 1;
    info.pStages = &stage;
    info.pVertexInputState = &wanted.vertices;
    info.pInputAssemblyState = &assembly;
    info.pViewportState = &viewport;
    info.pRasterizationState = &raster;
    info.pMultisampleState = &samples;
    info.pDepthStencilState = &depth;
    info.pDynamicState = &dynamic;
    info.layout = layout.value().raw();
    auto handle = PipelineHandle::create(device.owner, info, wanted.name);
    if (!handle) return handle.error();
    return DepthPipeline{std::move(layout.value()), std::move(handle.value())};
}

void bindDepth(VkCommandBuffer commands, const DepthPipeline& pipeline, uint32_t side) {
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline.handle.raw());
    const auto edge = static_cast<float>(side);
    const VkViewport wholeMap{0, 0, edge, edge, cache::kNearestDepth, 1};
    vkCmdSetViewport(commands, 0, 1, &wholeMap);
}

void beginDepth(VkCommandBuffer commands, const Image& map, uint32_t side, VkAttachmentLoadOp load) {
    VkRenderingAttachmentInfo attachment{};
    attachment.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO;
    attachment.imageView = map.view.raw();
    attachment.imageLayout = kAttachmentLayout;
    attachment.loadOp = load;
    attachment.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
    attachment.clearValue.depthStencil = {cache::kEmptyDepth, 0};
    VkRenderingInfo info{};
    info.sType = VK_STRUCTURE_TYPE_RENDERING_INFO;
    info.renderArea = {{0, 0}, {side, side}};
    info.layerCount = 1;
    info.pDepthAttachment = &attachment;
    vkCmdBeginRendering(commands, &info);
}

void fillDepth(VkCommandBuffer commands, std::span<const cache::StoreRect> rects, float depth,
               std::vector<VkClearRect>& kept) {
    kept.clear();
    for (const cache::StoreRect& rect : rects)
        if (!empty(rect)) kept.push_back({toVulkan(rect), 0, 1});
    if (kept.empty()) return;
    VkClearAttachment clear{};
    clear.aspectMask = VK_IMAGE_ASPECT_DEPTH_BIT;
    clear.clearValue.depthStencil = {depth, 0};
    vkCmdClearAttachments(commands, 1, &clear, static_cast<uint32_t>(kept.size()), kept.data());
}

}  // namespace gpu
