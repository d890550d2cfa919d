// gpu/compute.h — a compute shader with all that it is bound to: one set of descriptors, constants, its pipeline.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "gpu/memory.h"

namespace gpu {

struct ComputeInfo {
    std::span<const uint32_t> shader;              ///< groups of kComputeGroup threads; each takes every so many items
    std::span<const VkDescriptorType> bindings{};  ///< of set 0, from binding 0 on
    std::span<const uint32_t> constants{};         ///< specialization constants, 32 bits each, from id 0 on
    uint32_t pushBytes = 0;
    std::string name{};
};

constexpr uint32_t kComputeGroup = 64;

/// One thread at a time. The device must outlive it, and so must all that is bound.
class Compute {
public:
    /// kDevice when the driver refuses.
    static world::Result<Compute> create(Device::Impl& device, const ComputeInfo& info);

    /// What a binding refers to from now on: once for each, before the first `record`.
    void bind(uint32_t binding, const Buffer& buffer) const;
    void bind(uint32_t binding, const Image& image, VkImageLayout layout) const;
    /// `items` for the shader to do; `push` has as many bytes as was said. Records no barrier.
    void record(VkCommandBuffer commands, uint32_t items, const void* push = nullptr) const;

private:
    void write(uint32_t binding, const VkDescriptorBufferInfo* buffer, const VkDescriptorImageInfo* image) const;

    VkDevice device_ = VK_NULL_HANDLE;
    std::vector<VkDescriptorType> bindings_;
    uint32_t pushBytes_ = 0;
    SetLayoutHandle setLayout_;
    PipelineLayoutHandle layout_;
    ComputePipelineHandle pipeline_;
    DescriptorPoolHandle pool_;
    VkDescriptorSet set_ = VK_NULL_HANDLE;  ///< freed with its pool
};

}  // namespace gpu
