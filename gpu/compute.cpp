#include "gpu/compute.h"

#include <algorithm>

namespace gpu {
namespace {

using world::Result;

/// Beyond so many groups a thread takes several items.
constexpr uint32_t kMostGroups = 4096;

Result<SetLayoutHandle> setLayoutOf(Device::Impl& device, const ComputeInfo& info) {
    std::vector<VkDescriptorSetLayoutBinding> bindings(info.bindings.size());
    for (uint32_t b = 0; b < bindings.size(); ++b) {
        bindings[b].binding = b;
        bindings[b].descriptorType = info.bindings[b];
        bindings[b].descriptorCount = 1;
        bindings[b].stageFlags = VK_SHADER_STAGE_COMPUTE_BIT;
    }
    VkDescriptorSetLayoutCreateInfo layout{};
    layout.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
    layout.bindingCount = static_cast<uint32_t>(bindings.size());
    layout.pBindings = bindings.data();
    return SetLayoutHandle::create(device.owner, layout, info.name + " set layout");
}

Result<PipelineLayoutHandle> layoutOf(Device::Impl& device, const ComputeInfo& info, VkDescriptorSetLayout set) {
    const VkPushConstantRange push{VK_SHADER_STAGE_COMPUTE_BIT, 0, info.pushBytes};
    VkPipelineLayoutCreateInfo layout{};
    layout.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
    layout.setLayoutCount = 1;
    layout.pSetLayouts = &set;
    layout.pushConstantRangeCount = info.pushBytes > 0 ? 1 : 0;
    layout.pPushConstantRanges = &push;
    return PipelineLayoutHandle::create(device.owner, layout, info.name + " layout");
}

Result<ComputePipelineHandle> pipelineOf(Device::Impl& device, const ComputeInfo& info, VkPipelineLayout layout) {
    VkShaderModuleCreateInfo module{};
    module.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
    module.codeSize = info.shader.size_bytes();
    module.pCode = info.shader.data();
    const auto shader = ShaderHandle::create(device.owner, module, info.name + " shader");
    if (!shader) return shader.error();
    std::vector<VkSpecializationMapEntry> entries;
    for (uint32_t id = 0; id < info.constants.size(); ++id) entries.push_back({id, id * 4, 4});
    const VkSpecializationInfo constants{static_cast<uint32_t>(entries.size()), entries.data(),
                                         info.constants.size_bytes(), info.constants.data()};
    VkComputePipelineCreateInfo pipeline{};
    pipeline.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
    pipeline.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    pipeline.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
    pipeline.stage.module = shader.value().raw();
    pipeline.stage.pName = "main";
    pipeline.stage.pSpecializationInfo = &constants;
    pipeline.layout = layout;
    return ComputePipelineHandle::create(device.owner, pipeline, info.name);
}

Result<DescriptorPoolHandle> poolOf(Device::Impl& device, const ComputeInfo& info) {
    std::vector<VkDescriptorPoolSize> sizes;
    for (const VkDescriptorType type : info.bindings) sizes.push_back({type, 1});
    VkDescriptorPoolCreateInfo pool{};
    pool.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
    pool.maxSets = 1;
    pool.poolSizeCount = static_cast<uint32_t>(sizes.size());
    pool.pPoolSizes = sizes.data();
    return DescriptorPoolHandle::create(device.owner, pool, info.name + " descriptors");
}

}  // namespace

Result<Compute> Compute::create(Device::Impl& device, const ComputeInfo& info) {
    Compute made;
    made.device_ = device.owner.device;
    made.bindings_.assign(info.bindings.begin(), info.bindings.end());
    made.pushBytes_ = info.pushBytes;
    auto setLayout = setLayoutOf(device, info);
    if (!setLayout) return setLayout.error();
    made.setLayout_ = std::move(setLayout.value());
    const VkDescriptorSetLayout set = made.setLayout_.raw();
    auto layout = layoutOf(device, info, set);
    if (!layout) return layout.error();
    made.layout_ = std::move(layout.value());
    auto pipeline = pipelineOf(device, info, made.layout_.raw());
    if (!pipeline) return pipeline.error();
    made.pipeline_ = std::move(pipeline.value());
    auto pool = poolOf(device, info);
    if (!pool) return pool.error();
    made.pool_ = std::move(pool.value());
    VkDescriptorSetAllocateInfo wanted{};
    wanted.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
    wanted.descriptorPool = made.pool_.raw();
    wanted.descriptorSetCount = 1;
    wanted.pSetLayouts = &set;
    const VkResult allocated = vkAllocateDescriptorSets(made.device_, &wanted, &made.set_);
    if (allocated != VK_SUCCESS) return refused(allocated, "vkAllocateDescriptorSets", info.name);
    device.owner.name(VK_OBJECT_TYPE_DESCRIPTOR_SET, reinterpret_cast<uint64_t>(made.set_), info.name + " set");
    return made;
}

void Compute::bind(uint32_t binding, const Buffer& buffer) const {
    const VkDescriptorBufferInfo whole{buffer.raw(), 0, VK_WHOLE_SIZE};
    write(binding, &whole, nullptr);
}

void Compute::bind(uint32_t binding, const Image& image, VkImageLayout layout) const {
    const VkDescriptorImageInfo info{VK_NULL_HANDLE, image.view.raw(), layout};
    write(binding, nullptr, &info);
}

void Compute::write(uint32_t binding, const VkDescriptorBufferInfo* buffer, const VkDescriptorImageInfo* image) const {
    VkWriteDescriptorSet write{};
    write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    write.dstSet = set_;
    write.dstBinding = binding;
    write.descriptorCount = 1;
    write.descriptorType = bindings_.at(binding);
    write.pBufferInfo = buffer;
    write.pImageInfo = image;
    vkUpdateDescriptorSets(device_, 1, &write, 0, nullptr);
}

void Compute::record(VkCommandBuffer commands, uint32_t items, const void* push) const {
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline_.raw());
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, layout_.raw(), 0, 1, &set_, 0, nullptr);
    if (pushBytes_ > 0)
        vkCmdPushConstants(commands, layout_.raw(), VK_SHADER_STAGE_COMPUTE_BIT, 0, pushBytes_, push);
    vkCmdDispatch(commands, std::clamp((items + kComputeGroup - 1) / kComputeGroup, 1u, kMostGroups), 1, 1);
}

}  // namespace gpu
