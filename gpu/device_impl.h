// gpu/device_impl.h — what the other files of this folder see of a Device.
#pragma once

#include <mutex>
#include <string>
#include <vector>

#include "gpu/device.h"
#include "gpu/vk.h"

namespace gpu {

constexpr VkFormat toVulkan(DepthFormat format) {
    return format == DepthFormat::kD16 ? VK_FORMAT_D16_UNORM : VK_FORMAT_D32_SFLOAT;
}
constexpr uint64_t texelBytes(DepthFormat format) { return format == DepthFormat::kD16 ? 2 : 4; }

struct Device::Impl {
    Impl() = default;
    Impl(const Impl&) = delete;  // the messenger points here
    Impl& operator=(const Impl&) = delete;
    ~Impl();

    VkInstance instance = VK_NULL_HANDLE;
    VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
    VkPhysicalDevice physical = VK_NULL_HANDLE;
    uint32_t queueFamily = 0;
    VkQueue queue = VK_NULL_HANDLE;
    std::mutex queueMutex;  ///< held around each vkQueueSubmit2: several maps may share the device
    uint64_t submissions = 0, loseAfter = 0;  ///< under that lock; DeviceConfig::loseAfter
    Owner owner;
    std::string name, driver;

    VkPhysicalDeviceMemoryProperties memory{};
    uint64_t importAlignment = 0;  ///< of memory that is the process's own [bytes]; 0: it cannot be imported
    uint64_t maxAllocationBytes = 0;
    uint32_t maxSide = 0;           ///< of an image and a viewport [texels]
    uint32_t maxIndirectDraws = 0;  ///< per call
    uint64_t maxStorageBytes = 0;   ///< of a buffer, as a shader sees it
    double timestampMs = 0;         ///< one tick of a timestamp [ms]; 0 if there are none
    uint64_t timestampMask = 0;     ///< of the bits that count

    mutable std::mutex messagesMutex;  ///< the driver may report from any thread that calls it
    std::vector<std::string> messages;
};

}  // namespace gpu
