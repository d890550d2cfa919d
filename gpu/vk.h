// gpu/vk.h — Vulkan handles that free themselves, and the one way in which a refused call becomes an
// Error. Nothing is created without a name.
#pragma once

#include <vulkan/vulkan.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "world/result.h"

namespace gpu {

/// kDevice with `result` as its native code: the call, the object it was for, and the remedy.
world::Error refused(VkResult result, const char* call, const std::string& object);

/// What an object needs to be made and freed.
struct Owner {
    VkDevice device = VK_NULL_HANDLE;
    PFN_vkSetDebugUtilsObjectNameEXT setName = nullptr;  ///< null without VK_EXT_debug_utils
    mutable std::atomic<uint64_t> created = 0;           ///< objects so far: a steady state adds none

    void name(VkObjectType type, uint64_t object, const std::string& text) const;
};

/// A function's name as a template argument.
template <size_t N>
struct CallName {
    char text[N];
    consteval CallName(const char (&s)[N]) { std::copy_n(s, N, text); }
};

/// Owns one Vulkan object; empty after a move. Freed without a wait: whoever submits work keeps what
/// that work uses until its fence has signalled.
template <class Raw, class Info, auto kCreate, auto kDestroy, VkObjectType kType, CallName kCall>
class Handle {
public:
    static world::Result<Handle> create(const Owner& owner, const Info& info, const std::string& name) {
        Handle made;
        made.device_ = owner.device;
        const VkResult result = kCreate(owner.device, &info, nullptr, &made.raw_);
        if (result != VK_SUCCESS) return refused(result, kCall.text, name);
        owner.name(kType, reinterpret_cast<uint64_t>(made.raw_), name);
        ++owner.created;
        return made;
    }
    Handle() = default;
    Handle(Handle&& o) noexcept : device_(o.device_), raw_(std::exchange(o.raw_, VK_NULL_HANDLE)) {}
    Handle& operator=(Handle&& o) noexcept {
        std::swap(device_, o.device_);
        std::swap(raw_, o.raw_);
        return *this;
    }
    ~Handle() {
        if (raw_ != VK_NULL_HANDLE) kDestroy(device_, raw_, nullptr);
    }
    Raw raw() const { return raw_; }

private:
    VkDevice device_ = VK_NULL_HANDLE;
    Raw raw_ = VK_NULL_HANDLE;
};

/// vkCreateGraphicsPipelines for one pipeline, in the shape of the other calls.
inline VkResult createPipeline(VkDevice device, const VkGraphicsPipelineCreateInfo* info,
                               const VkAllocationCallbacks* callbacks, VkPipeline* pipeline) {
    return vkCreateGraphicsPipelines(device, VK_NULL_HANDLE, 1, info, callbacks, pipeline);
}

/// Likewise for one compute pipeline.
inline VkResult createComputePipeline(VkDevice device, const VkComputePipelineCreateInfo* info,
                                      const VkAllocationCallbacks* callbacks, VkPipeline* pipeline) {
    return vkCreateComputePipelines(device, VK_NULL_HANDLE, 1, info, callbacks, pipeline);
}

using MemoryHandle = Handle<VkDeviceMemory, VkMemoryAllocateInfo, vkAllocateMemory, vkFreeMemory,
                            VK_OBJECT_TYPE_DEVICE_MEMORY, "vkAllocateMemory">;
using BufferHandle = Handle<VkBuffer, VkBufferCreateInfo, vkCreateBuffer, vkDestroyBuffer,
                            VK_OBJECT_TYPE_BUFFER, "vkCreateBuffer">;
using ImageHandle =
    Handle<VkImage, VkImageCreateInfo, vkCreateImage, vkDestroyImage, VK_OBJECT_TYPE_IMAGE, "vkCreateImage">;
using ImageViewHandle = Handle<VkImageView, VkImageViewCreateInfo, vkCreateImageView, vkDestroyImageView,
                               VK_OBJECT_TYPE_IMAGE_VIEW, "vkCreateImageView">;
using ShaderHandle = Handle<VkShaderModule, VkShaderModuleCreateInfo, vkCreateShaderModule,
                            vkDestroyShaderModule, VK_OBJECT_TYPE_SHADER_MODULE, "vkCreateShaderModule">;
using PipelineLayoutHandle =
    Handle<VkPipelineLayout, VkPipelineLayoutCreateInfo, vkCreatePipelineLayout, vkDestroyPipelineLayout,
           VK_OBJECT_TYPE_PIPELINE_LAYOUT, "vkCreatePipelineLayout">;
using PipelineHandle = Handle<VkPipeline, VkGraphicsPipelineCreateInfo, createPipeline, vkDestroyPipeline,
                              VK_OBJECT_TYPE_PIPELINE, "vkCreateGraphicsPipelines">;
using ComputePipelineHandle =
    Handle<VkPipeline, VkComputePipelineCreateInfo, createComputePipeline, vkDestroyPipeline,
           VK_OBJECT_TYPE_PIPELINE, "vkCreateComputePipelines">;
using SetLayoutHandle = Handle<VkDescriptorSetLayout, VkDescriptorSetLayoutCreateInfo, vkCreateDescriptorSetLayout,
                               vkDestroyDescriptorSetLayout, VK_OBJECT_TYPE_DESCRIPTOR_SET_LAYOUT,
                               "vkCreateDescriptorSetLayout">;
using DescriptorPoolHandle =
    Handle<VkDescriptorPool, VkDescriptorPoolCreateInfo, vkCreateDescriptorPool, vkDestroyDescriptorPool,
           VK_OBJECT_TYPE_DESCRIPTOR_POOL, "vkCreateDescriptorPool">;
using CommandPoolHandle = Handle<VkCommandPool, VkCommandPoolCreateInfo, vkCreateCommandPool,
                                 vkDestroyCommandPool, VK_OBJECT_TYPE_COMMAND_POOL, "vkCreateCommandPool">;
using FenceHandle =
    Handle<VkFence, VkFenceCreateInfo, vkCreateFence, vkDestroyFence, VK_OBJECT_TYPE_FENCE, "vkCreateFence">;
using QueryPoolHandle = Handle<VkQueryPool, VkQueryPoolCreateInfo, vkCreateQueryPool, vkDestroyQueryPool,
                               VK_OBJECT_TYPE_QUERY_POOL, "vkCreateQueryPool">;

}  // namespace gpu
