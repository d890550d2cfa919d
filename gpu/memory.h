// gpu/memory.h — buffers and depth images, each with memory of its own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "gpu/device_impl.h"

namespace gpu {

/// Who touches a buffer's memory. What the CPU touches is coherent and mapped for as long as the buffer lives.
enum class Home {
    kUpload,    ///< written by the CPU in order, read by the GPU: in device memory where that can be mapped
    kReadback,  ///< written by the GPU, read by the CPU
    kDevice,    ///< the GPU's alone
};

struct Buffer {
    MemoryHandle memory;
    BufferHandle handle;
    std::byte* mapped = nullptr;
    uint64_t bytes = 0;

    VkBuffer raw() const { return handle.raw(); }
};

/// `bytes` > 0. kDevice when the driver refuses; falls back to a lesser kind of memory first.
world::Result<Buffer> createBuffer(Device::Impl& device, uint64_t bytes, VkBufferUsageFlags usage, Home home,
                                   const std::string& name);

/// Memory that the process has already, as a buffer: whole multiples of the device's importAlignment, which outlive it.
/// kDevice where the driver refuses.
world::Result<Buffer> importBuffer(Device::Impl& device, std::span<std::byte> pages, VkBufferUsageFlags usage,
                                   const std::string& name);

struct Image {
    MemoryHandle memory;
    ImageHandle handle;
    ImageViewHandle view;
};

/// side x side texels, one level: drawn to and copied from and to. kDevice when the driver refuses.
world::Result<Image> createDepthImage(Device::Impl& device, uint32_t side, DepthFormat format,
                                      const std::string& name);
/// Layers of width x height texels, one level: copied to and read by shaders, as an array. kDevice likewise.
world::Result<Image> createDepthArray(Device::Impl& device, VkExtent2D layer, uint32_t layers, DepthFormat format,
                                      const std::string& name);

/// A buffer that only grows, so that a steady state allocates nothing. What it held is lost when it
/// grows: it is written anew every frame.
class GrowingBuffer {
public:
    static world::Result<GrowingBuffer> create(Device::Impl& device, uint64_t bytes, VkBufferUsageFlags usage,
                                               const std::string& name);
    /// Room for `bytes`, at least doubling when there is too little. The GPU must not be using it. After
    /// an error it is as it was.
    world::Result<world::Done> reserve(Device::Impl& device, uint64_t bytes);
    const Buffer& buffer() const { return buffer_; }

private:
    Buffer buffer_;
    VkBufferUsageFlags usage_ = 0;
    std::string name_;
};

}  // namespace gpu
