#include "gpu/map_moves.h"

#include <algorithm>

#include "gpu/depth_pipeline.h"
#include "gpu/shaders/move.comp.h"
#include "world/check.h"

namespace gpu {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

/// As the shader has them.
struct Push {
    uint32_t wordCount = 0, halves = 0;
    int32_t units = 0;
    float offset = 0, nearest = cache::kNearestDepth;
};
static_assert(sizeof(Push) == 20);

constexpr uint32_t kGroup = 64, kMostGroups = 4096;

}  // namespace

Result<MapMoves> MapMoves::create(Device::Impl& device, uint32_t side, DepthFormat format) {
    MapMoves made;
    made.side_ = side;
    made.format_ = format;
    const uint64_t bytes = (uint64_t{side} * side * texelBytes(format) + 3) / 4 * 4;  // whole words
    if (bytes > device.maxStorageBytes)
        return Error{ErrorCode::kLimit, "moving maps of " + std::to_string(side) + " texels a side: shaders of '" +
                                            device.name + "' see at most " + std::to_string(device.maxStorageBytes) +
                                            " bytes at once; lower the resolution"};
    auto depths = createBuffer(
        device, bytes,
        VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
        Home::kDevice, "moving depths");
    if (!depths) return depths.error();
    made.depths_ = std::move(depths.value());

    VkDescriptorSetLayoutBinding binding{};
    binding.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    binding.descriptorCount = 1;
    binding.stageFlags = VK_SHADER_STAGE_COMPUTE_BIT;
    VkDescriptorSetLayoutCreateInfo setInfo{};
    setInfo.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
    setInfo.bindingCount = 1;
    setInfo.pBindings = &binding;
    auto setLayout = SetLayoutHandle::create(device.owner, setInfo, "map moves set layout");
    if (!setLayout) return setLayout.error();
    made.setLayout_ = std::move(setLayout.value());

    const VkDescriptorSetLayout setLayouts[] = {made.setLayout_.raw()};
    const VkPushConstantRange constants{VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof(Push)};
    VkPipelineLayoutCreateInfo layoutInfo{};
    layoutInfo.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
    layoutInfo.setLayoutCount = 1;
    layoutInfo.pSetLayouts = setLayouts;
    layoutInfo.pushConstantRangeCount = 1;
    layoutInfo.pPushConstantRanges = &constants;
    auto layout = PipelineLayoutHandle::create(device.owner, layoutInfo, "map moves layout");
    if (!layout) return layout.error();
    made.layout_ = std::move(layout.value());

    VkShaderModuleCreateInfo module{};
    module.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    module.codeSize = sizeof kMoveComp;
    module.pCode = kMoveComp;
    const auto shader = ShaderHandle::create(device.owner, module, "map moves shader");
    if (!shader) return shader.error();
    VkComputePipelineCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
    info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
    info.stage.module = shader.value().raw();
    info.stage.pName = "main";
    info.layout = made.layout_.raw();
    auto pipeline = ComputePipelineHandle::create(device.owner, info, "map moves");
    if (!pipeline) return pipeline.error();
    made.pipeline_ = std::move(pipeline.value());

    const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1};
    VkDescriptorPoolCreateInfo poolInfo{};
    poolInfo.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
    poolInfo.maxSets = 1;
    poolInfo.poolSizeCount = 1;
    poolInfo.pPoolSizes = &size;
    auto pool = DescriptorPoolHandle::create(device.owner, poolInfo, "map moves descriptors");
    if (!pool) return pool.error();
    made.pool_ = std::move(pool.value());
    VkDescriptorSetAllocateInfo wanted{};
    wanted.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
    wanted.descriptorPool = made.pool_.raw();
    wanted.descriptorSetCount = 1;
    wanted.pSetLayouts = setLayouts;
    const VkResult allocated = vkAllocateDescriptorSets(device.owner.device, &wanted, &made.set_);
    if (allocated != VK_SUCCESS) return refused(allocated, "vkAllocateDescriptorSets", "map moves");
    device.owner.name(VK_OBJECT_TYPE_DESCRIPTOR_SET, reinterpret_cast<uint64_t>(made.set_), "map moves set");
    const VkDescriptorBufferInfo whole{made.depths_.raw(), 0, VK_WHOLE_SIZE};
    VkWriteDescriptorSet write{};
    write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    write.dstSet = made.set_;
    write.descriptorCount = 1;
    write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    write.pBufferInfo = &whole;
    vkUpdateDescriptorSets(device.owner.device, 1, &write, 0, nullptr);
    return made;
}

void MapMoves::record(Frame& frame, VkCommandBuffer commands, std::span<DepthMap> maps, const MapMove& move) const {
    CHECK(size_t(move.from) < maps.size() && size_t(move.to) < maps.size());
    DepthMap &from = maps[size_t(move.from)], &to = maps[size_t(move.to)];
    // Clamped, so that nothing overflows however far it goes.
    const auto side = int32_t(side_);
    const glm::ivec2 by = glm::clamp(move.by, glm::ivec2(-side), glm::ivec2(side));
    const glm::ivec2 low = glm::max(-by, glm::ivec2(0)), size = side - glm::abs(by);
    const bool some = size.x > 0 && size.y > 0;

    VkBufferImageCopy copy{};
    copy.imageSubresource = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 0, 1};
    copy.imageOffset = {low.x, low.y, 0};
    copy.imageExtent = {uint32_t(size.x), uint32_t(size.y), 1};
    if (some) {
        frame.need(from, Use::kCopySource);
        frame.barrier();
        frame.order(depths_);
        vkCmdCopyImageToBuffer(commands, from.image.handle.raw(), kCopySourceLayout, depths_.raw(), 1, &copy);
    }
    if (by != glm::ivec2(0)) {
        frame.need(to, Use::kAttachment);
        frame.barrier();
        beginDepth(commands, to.image, side_, VK_ATTACHMENT_LOAD_OP_CLEAR);
        vkCmdEndRendering(commands);
    }
    if (!some) return;
    if (move.units != 0) {
        frame.order(depths_);
        add(commands, copy.imageExtent.width * copy.imageExtent.height, move.units);
    }
    frame.need(to, Use::kCopyTarget);
    frame.barrier();
    frame.order(depths_);
    copy.imageOffset = {low.x + by.x, low.y + by.y, 0};
    vkCmdCopyBufferToImage(commands, depths_.raw(), to.image.handle.raw(), kCopyTargetLayout, 1, &copy);
}

void MapMoves::add(VkCommandBuffer commands, uint32_t texels, int units) const {
    const bool halves = format_ == DepthFormat::kD16;
    Push push{.wordCount = halves ? (texels + 1) / 2 : texels, .halves = halves};
    push.units = std::clamp(units, -65535, 65535);
    push.offset = float(push.units / 65535.0);
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline_.raw());
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, layout_.raw(), 0, 1, &set_, 0, nullptr);
    vkCmdPushConstants(commands, layout_.raw(), VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof push, &push);
    vkCmdDispatch(commands, std::clamp((push.wordCount + kGroup - 1) / kGroup, 1u, kMostGroups), 1, 1);
}

}  // namespace gpu
