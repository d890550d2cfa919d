#include "gpu/vk.h"

namespace gpu {
namespace {

std::string nameOf(VkResult result) {
    switch (result) {
        case VK_NOT_READY:
            return "VK_NOT_READY";
        case VK_TIMEOUT:
            return "VK_TIMEOUT";
        case VK_INCOMPLETE:
            return "VK_INCOMPLETE";
        case VK_ERROR_OUT_OF_HOST_MEMORY:
            return "VK_ERROR_OUT_OF_HOST_MEMORY";
        case VK_ERROR_OUT_OF_DEVICE_MEMORY:
            return "VK_ERROR_OUT_OF_DEVICE_MEMORY";
        case VK_ERROR_INITIALIZATION_FAILED:
            return "VK_ERROR_INITIALIZATION_FAILED";
        case VK_ERROR_DEVICE_LOST:
            return "VK_ERROR_DEVICE_LOST";
        case VK_ERROR_MEMORY_MAP_FAILED:
            return "VK_ERROR_MEMORY_MAP_FAILED";
        case VK_ERROR_LAYER_NOT_PRESENT:
            return "VK_ERROR_LAYER_NOT_PRESENT";
        case VK_ERROR_EXTENSION_NOT_PRESENT:
            return "VK_ERROR_EXTENSION_NOT_PRESENT";
        case VK_ERROR_FEATURE_NOT_PRESENT:
            return "VK_ERROR_FEATURE_NOT_PRESENT";
        case VK_ERROR_INCOMPATIBLE_DRIVER:
            return "VK_ERROR_INCOMPATIBLE_DRIVER";
        case VK_ERROR_TOO_MANY_OBJECTS:
            return "VK_ERROR_TOO_MANY_OBJECTS";
        case VK_ERROR_FORMAT_NOT_SUPPORTED:
            return "VK_ERROR_FORMAT_NOT_SUPPORTED";
        default:
            return "VkResult " + std::to_string(static_cast<int>(result));
    }
}

const char* remedyFor(VkResult result) {
    switch (result) {
        case VK_TIMEOUT:
            return "the GPU did not answer: restart, and lower the work per frame if it repeats";
        case VK_ERROR_OUT_OF_DEVICE_MEMORY:
        case VK_ERROR_TOO_MANY_OBJECTS:
            return "lower --gpu-budget, or use fewer or smaller maps";
        case VK_ERROR_OUT_OF_HOST_MEMORY:
        case VK_ERROR_MEMORY_MAP_FAILED:
            return "free memory on this machine or lower --gpu-budget";
        case VK_ERROR_DEVICE_LOST:
            return "restart; if it repeats, update the driver";
        default:
            return "update the driver, or choose another device (vulkaninfo lists them)";
    }
}

}  // namespace

world::Error refused(VkResult result, const char* call, const std::string& object) {
    return {world::ErrorCode::kDevice,
            std::string(call) + " for '" + object + "': " + nameOf(result) + "; " + remedyFor(result),
            static_cast<int>(result)};
}

void Owner::name(VkObjectType type, uint64_t object, const std::string& text) const {
    if (setName == nullptr) return;
    const VkDebugUtilsObjectNameInfoEXT info{.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT,
                                             .pNext = nullptr,
                                             .objectType = type,
                                             .objectHandle = object,
                                             .pObjectName = text.c_str()};
    setName(device, &info);  // a name is a help to people: losing one harms nothing
}

}  // namespace gpu
