#include "gpu/memory.h"

#include <algorithm>
#include <span>

namespace gpu {
namespace {

using world::Result;

constexpr VkMemoryPropertyFlags kMapped =
    VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;

/// Memory for `needs`, of the first kind among `wishes` that exists and is not exhausted.
Result<MemoryHandle> allocate(Device::Impl& device, const VkMemoryRequirements& needs,
                              std::span<const VkMemoryPropertyFlags> wishes, const std::string& name) {
    VkResult lastRefusal = VK_ERROR_FEATURE_NOT_PRESENT;
    for (const VkMemoryPropertyFlags wish : wishes) {
        for (uint32_t type = 0; type < device.memory.memoryTypeCount; ++type) {
            if ((needs.memoryTypeBits >> type & 1) == 0) continue;
            if ((device.memory.memoryTypes[type].propertyFlags & wish) != wish) continue;
            VkMemoryAllocateInfo info{};
            info.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
            info.allocationSize = needs.size;
            info.memoryTypeIndex = type;
            auto memory = MemoryHandle::create(device.owner, info, name + " memory");
            if (memory) return memory;
            lastRefusal = static_cast<VkResult>(memory.error().native);
        }
    }
    return refused(lastRefusal, "vkAllocateMemory", name + ", " + std::to_string(needs.size) + " bytes");
}

/// What tells depth images apart.
struct DepthImage {
    VkExtent2D layer;
    uint32_t layers;
    VkImageUsageFlags usage;
    VkImageViewType viewType;
};

Result<Image> createImage(Device::Impl& device, const DepthImage& wanted, DepthFormat format, const std::string& name) {
    VkImageCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO;
    info.imageType = VK_IMAGE_TYPE_2D;
    info.format = toVulkan(format);
    info.extent = {wanted.layer.width, wanted.layer.height, 1};
    info.mipLevels = 1;
    info.arrayLayers = wanted.layers;
    info.samples = VK_SAMPLE_COUNT_1_BIT;
    info.tiling = VK_IMAGE_TILING_OPTIMAL;
    info.usage = wanted.usage;
    info.sharingMode = VK_SHARING_MODE_EXCLUSIVE;
    info.initialLayout = VK_IMAGE_LAYOUT_UNDEFINED;
    auto handle = ImageHandle::create(device.owner, info, name);
    if (!handle) return handle.error();
    VkMemoryRequirements needs;
    vkGetImageMemoryRequirements(device.owner.device, handle.value().raw(), &needs);

    // The second wish lets a full GPU go on, slowly, from host memory.
    const VkMemoryPropertyFlags wishes[] = {VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, 0};
    auto memory = allocate(device, needs, wishes, name);
    if (!memory) return memory.error();
    const VkResult bound =
        vkBindImageMemory(device.owner.device, handle.value().raw(), memory.value().raw(), 0);
    if (bound != VK_SUCCESS) return refused(bound, "vkBindImageMemory", name);

    VkImageViewCreateInfo view{};
    view.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO;
    view.image = handle.value().raw();
    view.viewType = wanted.viewType;
    view.format = toVulkan(format);
    view.subresourceRange = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 1, 0, wanted.layers};
    auto viewHandle = ImageViewHandle::create(device.owner, view, name + " view");
    if (!viewHandle) return viewHandle.error();
    return Image{std::move(memory.value()), std::move(handle.value()), std::move(viewHandle.value())};
}

}  // namespace

Result<Buffer> createBuffer(Device::Impl& device, uint64_t bytes, VkBufferUsageFlags usage, Home home,
                            const std::string& name) {
    VkBufferCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
    info.size = bytes;
    info.usage = usage;
    info.sharingMode = VK_SHARING_MODE_EXCLUSIVE;
    auto handle = BufferHandle::create(device.owner, info, name);
    if (!handle) return handle.error();
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device.owner.device, handle.value().raw(), &needs);

    // Reading device memory over the bus, uncached, would take longer than the frame.
    const VkMemoryPropertyFlags best =
        home == Home::kReadback ? VK_MEMORY_PROPERTY_HOST_CACHED_BIT : VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT;
    const VkMemoryPropertyFlags least = home == Home::kDevice ? 0 : kMapped;
    const VkMemoryPropertyFlags wishes[] = {best | least, least};
    auto memory = allocate(device, needs, wishes, name);
    if (!memory) return memory.error();
    const VkResult bound =
        vkBindBufferMemory(device.owner.device, handle.value().raw(), memory.value().raw(), 0);
    if (bound != VK_SUCCESS) return refused(bound, "vkBindBufferMemory", name);
    void* mapped = nullptr;
    if (home != Home::kDevice) {
        const VkResult result =
            vkMapMemory(device.owner.device, memory.value().raw(), 0, VK_WHOLE_SIZE, 0, &mapped);
        if (result != VK_SUCCESS) return refused(result, "vkMapMemory", name);
    }
    return Buffer{std::move(memory.value()), std::move(handle.value()), static_cast<std::byte*>(mapped),
                  bytes};
}

Result<Buffer> importBuffer(Device::Impl& device, std::span<std::byte> pages, VkBufferUsageFlags usage,
                            const std::string& name) {
    constexpr auto kType = VK_EXTERNAL_MEMORY_HANDLE_TYPE_HOST_ALLOCATION_BIT_EXT;
    VkExternalMemoryBufferCreateInfo external{};
    external.sType = VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO;
    external.handleTypes = kType;
    VkBufferCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
    info.pNext = &external;
    info.size = pages.size();
    info.usage = usage;
    info.sharingMode = VK_SHARING_MODE_EXCLUSIVE;
    auto handle = BufferHandle::create(device.owner, info, name);
    if (!handle) return handle.error();
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device.owner.device, handle.value().raw(), &needs);
    const auto typesOf = reinterpret_cast<PFN_vkGetMemoryHostPointerPropertiesEXT>(
        vkGetDeviceProcAddr(device.owner.device, "vkGetMemoryHostPointerPropertiesEXT"));
    VkMemoryHostPointerPropertiesEXT types{};
    types.sType = VK_STRUCTURE_TYPE_MEMORY_HOST_POINTER_PROPERTIES_EXT;
    const VkResult known = typesOf(device.owner.device, kType, pages.data(), &types);
    if (known != VK_SUCCESS) return refused(known, "vkGetMemoryHostPointerPropertiesEXT", name);
    VkImportMemoryHostPointerInfoEXT import{};
    import.sType = VK_STRUCTURE_TYPE_IMPORT_MEMORY_HOST_POINTER_INFO_EXT;
    import.handleType = kType;
    import.pHostPointer = pages.data();
    VkMemoryAllocateInfo allocation{};
    allocation.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
    allocation.pNext = &import;
    allocation.allocationSize = pages.size();
    const uint32_t fitting = needs.memoryTypeBits & types.memoryTypeBits;
    while (allocation.memoryTypeIndex < device.memory.memoryTypeCount &&
           ((fitting >> allocation.memoryTypeIndex & 1) == 0 ||
            (device.memory.memoryTypes[allocation.memoryTypeIndex].propertyFlags & kMapped) != kMapped))
        ++allocation.memoryTypeIndex;
    if (allocation.memoryTypeIndex == device.memory.memoryTypeCount || needs.size > pages.size())
        return refused(VK_ERROR_INVALID_EXTERNAL_HANDLE, "vkAllocateMemory", name);
    auto memory = MemoryHandle::create(device.owner, allocation, name + " memory");
    if (!memory) return memory.error();
    const VkResult bound = vkBindBufferMemory(device.owner.device, handle.value().raw(), memory.value().raw(), 0);
    if (bound != VK_SUCCESS) return refused(bound, "vkBindBufferMemory", name);
    return Buffer{std::move(memory.value()), std::move(handle.value()), pages.data(), pages.size()};
}

Result<Image> createDepthImage(Device::Impl& device, uint32_t side, DepthFormat format,
                               const std::string& name) {
    constexpr VkImageUsageFlags kUsage = VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT |
                                         VK_IMAGE_USAGE_TRANSFER_SRC_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
    return createImage(device, {{side, side}, 1, kUsage, VK_IMAGE_VIEW_TYPE_2D}, format, name);
}

Result<Image> createDepthArray(Device::Impl& device, VkExtent2D layer, uint32_t layers, DepthFormat format,
                               const std::string& name) {
    constexpr VkImageUsageFlags kUsage = VK_IMAGE_USAGE_SAMPLED_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
    return createImage(device, {layer, layers, kUsage, VK_IMAGE_VIEW_TYPE_2D_ARRAY}, format, name);
}

Result<GrowingBuffer> GrowingBuffer::create(Device::Impl& device, uint64_t bytes, VkBufferUsageFlags usage,
                                            const std::string& name) {
    GrowingBuffer made;
    made.usage_ = usage;
    made.name_ = name;
    if (const auto reserved = made.reserve(device, bytes); !reserved) return reserved.error();
    return made;
}

Result<world::Done> GrowingBuffer::reserve(Device::Impl& device, uint64_t bytes) {
    if (bytes <= buffer_.bytes) return world::Done{};
    auto larger = createBuffer(device, std::max(bytes, 2 * buffer_.bytes), usage_, Home::kUpload, name_);
    if (!larger) return larger.error();
    buffer_ = std::move(larger.value());
    return world::Done{};
}

}  // namespace gpu
