#include "gpu/device.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <span>

#include "gpu/device_impl.h"

namespace gpu {
namespace {

using world::Done;
using world::Error;
using world::ErrorCode;
using world::Result;

constexpr const char* kValidationLayer = "VK_LAYER_KHRONOS_validation";
constexpr const char* kInstallDriver =
    "install mesa-vulkan-drivers for the software renderer, or the driver of the GPU";

/// The list that a Vulkan enumeration call fills: asked for its length, then for its content, until
/// the length has held still.
template <class T, class Call>
VkResult enumerate(std::vector<T>& list, const Call& call) {
    VkResult result = VK_INCOMPLETE;
    while (result == VK_INCOMPLETE) {
        uint32_t count = 0;
        result = call(&count, static_cast<T*>(nullptr));
        if (result != VK_SUCCESS) return result;
        list.assign(count, T{});
        result = call(&count, list.data());
        list.resize(count);
    }
    return result;
}

bool offersExtension(const char* layer, const char* extension) {
    std::vector<VkExtensionProperties> list;
    const VkResult result = enumerate(list, [layer](uint32_t* count, VkExtensionProperties* out) {
        return vkEnumerateInstanceExtensionProperties(layer, count, out);
    });
    return result == VK_SUCCESS && std::any_of(list.begin(), list.end(), [extension](const auto& e) {
               return std::strcmp(e.extensionName, extension) == 0;
           });
}

bool offersLayer(const char* layer) {
    std::vector<VkLayerProperties> list;
    const VkResult result = enumerate(list, vkEnumerateInstanceLayerProperties);
    return result == VK_SUCCESS && std::any_of(list.begin(), list.end(), [layer](const auto& l) {
               return std::strcmp(l.layerName, layer) == 0;
           });
}

VKAPI_ATTR VkBool32 VKAPI_CALL collectMessage(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                              VkDebugUtilsMessageTypeFlagsEXT,
                                              const VkDebugUtilsMessengerCallbackDataEXT* data, void* user) {
    Device::Impl& impl = *static_cast<Device::Impl*>(user);
    const std::lock_guard lock(impl.messagesMutex);
    impl.messages.emplace_back(data->pMessage);
    return VK_FALSE;
}

Result<Done> makeInstance(Device::Impl& impl, bool validation) {
    if (validation && !offersLayer(kValidationLayer))
        return Error{ErrorCode::kNotFound, std::string("no Vulkan layer ") + kValidationLayer +
                                               ": install vulkan-validationlayers"};

    std::vector<const char*> extensions;
    const bool debugUtils = offersExtension(nullptr, VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    if (debugUtils) extensions.push_back(VK_EXT_DEBUG_UTILS_EXTENSION_NAME);
    if (validation) extensions.push_back(VK_EXT_VALIDATION_FEATURES_EXTENSION_NAME);

    VkDebugUtilsMessengerCreateInfoEXT messenger{};
    messenger.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
    messenger.messageSeverity =
        VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    // Not the general ones: with them the loader reports each installed driver that finds no hardware.
    messenger.messageType =
        VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
    messenger.pfnUserCallback = collectMessage;
    messenger.pUserData = &impl;
    const VkValidationFeatureEnableEXT enabled[] = {
        VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT};
    VkValidationFeaturesEXT features{};
    features.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT;
    features.pNext = debugUtils ? &messenger : nullptr;
    features.enabledValidationFeatureCount = 1;
    features.pEnabledValidationFeatures = enabled;

    VkApplicationInfo application{};
    application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
    application.pApplicationName = "gnomon";
    application.apiVersion = VK_API_VERSION_1_3;
    VkInstanceCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
    info.pNext = validation ? &features : nullptr;
    info.pApplicationInfo = &application;
    info.enabledLayerCount = validation ? 1 : 0;
    info.ppEnabledLayerNames = &kValidationLayer;
    info.enabledExtensionCount = static_cast<uint32_t>(extensions.size());
    info.ppEnabledExtensionNames = extensions.data();
    const VkResult result = vkCreateInstance(&info, nullptr, &impl.instance);
    if (result == VK_ERROR_INCOMPATIBLE_DRIVER)
        return Error{ErrorCode::kNotFound, std::string("no Vulkan driver on this machine: ") + kInstallDriver,
                     static_cast<int>(result)};
    if (result != VK_SUCCESS) return refused(result, "vkCreateInstance", "gnomon");
    if (!debugUtils) return Done{};

    impl.owner.setName = reinterpret_cast<PFN_vkSetDebugUtilsObjectNameEXT>(
        vkGetInstanceProcAddr(impl.instance, "vkSetDebugUtilsObjectNameEXT"));
    if (!validation) return Done{};
    const auto createMessenger = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(
        vkGetInstanceProcAddr(impl.instance, "vkCreateDebugUtilsMessengerEXT"));
    const VkResult made = createMessenger(impl.instance, &messenger, nullptr, &impl.messenger);
    if (made != VK_SUCCESS) return refused(made, "vkCreateDebugUtilsMessengerEXT", "messages");
    return Done{};
}

std::optional<uint32_t> graphicsFamily(VkPhysicalDevice physical) {
    uint32_t count = 0;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, nullptr);
    std::vector<VkQueueFamilyProperties> families(count);
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families.data());
    constexpr VkQueueFlags kNeeded = VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT;
    for (uint32_t i = 0; i < count; ++i)
        if ((families[i].queueFlags & kNeeded) == kNeeded) return i;
    return std::nullopt;
}

/// What a device lacks; empty if it fits.
std::string lackOf(VkPhysicalDevice physical) {
    VkPhysicalDeviceProperties properties;
    vkGetPhysicalDeviceProperties(physical, &properties);
    if (properties.apiVersion < VK_API_VERSION_1_3) return "Vulkan 1.3";
    if (!graphicsFamily(physical)) return "a queue for graphics and compute";

    VkPhysicalDeviceVulkan13Features has13{};
    has13.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES;
    VkPhysicalDeviceFeatures2 has{};
    has.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    has.pNext = &has13;
    vkGetPhysicalDeviceFeatures2(physical, &has);
    if (!has13.dynamicRendering) return "dynamicRendering";
    if (!has13.synchronization2) return "synchronization2";
    if (!has13.maintenance4) return "maintenance4";
    if (!has.features.multiDrawIndirect) return "multiDrawIndirect";
    if (!has.features.drawIndirectFirstInstance) return "drawIndirectFirstInstance";
    if (!has.features.depthClamp) return "depthClamp";
    if (!has.features.shaderClipDistance) return "shaderClipDistance";
    if (!has.features.fullDrawIndexUint32) return "fullDrawIndexUint32";

    for (const auto& [format, lack] :
         {std::pair(DepthFormat::kD32, "D32 depth maps"), std::pair(DepthFormat::kD16, "D16 depth maps")}) {
        VkFormatProperties maps;
        vkGetPhysicalDeviceFormatProperties(physical, toVulkan(format), &maps);
        const VkFormatFeatureFlags needed = VK_FORMAT_FEATURE_DEPTH_STENCIL_ATTACHMENT_BIT |
                                            VK_FORMAT_FEATURE_SAMPLED_IMAGE_BIT |
                                            VK_FORMAT_FEATURE_TRANSFER_SRC_BIT |
                                            VK_FORMAT_FEATURE_TRANSFER_DST_BIT;
        if ((maps.optimalTilingFeatures & needed) != needed) return lack;
    }
    return {};
}

/// Lower is better.
int rankOf(VkPhysicalDeviceType type) {
    switch (type) {
        case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU:
            return 0;
        case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU:
            return 1;
        case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU:
            return 2;
        case VK_PHYSICAL_DEVICE_TYPE_CPU:
            return 3;
        default:
            return 4;
    }
}

Result<Done> pickPhysical(Device::Impl& impl, const std::string& nameContains) {
    std::vector<VkPhysicalDevice> devices;
    const VkResult result = enumerate(devices, [&impl](uint32_t* count, VkPhysicalDevice* out) {
        return vkEnumeratePhysicalDevices(impl.instance, count, out);
    });
    if (result != VK_SUCCESS && result != VK_ERROR_INITIALIZATION_FAILED)
        return refused(result, "vkEnumeratePhysicalDevices", "gnomon");

    int bestRank = 5;
    std::string seen;  // for the error: each device and why it was passed over
    for (VkPhysicalDevice physical : devices) {
        VkPhysicalDeviceProperties properties;
        vkGetPhysicalDeviceProperties(physical, &properties);
        const std::string name = properties.deviceName;
        const bool named = name.find(nameContains) != std::string::npos;
        const std::string lack = named ? lackOf(physical) : std::string();
        seen += (seen.empty() ? "" : ", ") + name;
        if (!named) continue;
        if (!lack.empty()) {
            seen += " (lacks " + lack + ")";
            continue;
        }
        const int rank = nameContains.empty() ? rankOf(properties.deviceType) : 0;
        if (rank >= bestRank) continue;
        bestRank = rank;
        impl.physical = physical;
    }
    if (impl.physical != VK_NULL_HANDLE) return Done{};
    if (devices.empty())
        return Error{ErrorCode::kNotFound,
                     std::string("no Vulkan driver found a device on this machine: ") + kInstallDriver,
                     static_cast<int>(result)};
    if (!nameContains.empty())
        return Error{ErrorCode::kNotFound, "no fitting Vulkan device with '" + nameContains +
                                               "' in its name: there are " + seen + "; name one of them"};
    return Error{ErrorCode::kNotFound, "no fitting Vulkan device among " + seen + ": " + kInstallDriver};
}

bool importsHostMemory(VkPhysicalDevice physical) {
    std::vector<VkExtensionProperties> list;
    const VkResult result = enumerate(list, [physical](uint32_t* count, VkExtensionProperties* out) {
        return vkEnumerateDeviceExtensionProperties(physical, nullptr, count, out);
    });
    return result == VK_SUCCESS && std::any_of(list.begin(), list.end(), [](const auto& e) {
               return std::strcmp(e.extensionName, VK_EXT_EXTERNAL_MEMORY_HOST_EXTENSION_NAME) == 0;
           });
}

void readLimits(Device::Impl& impl) {
    VkPhysicalDeviceDriverProperties driver{};
    driver.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES;
    VkPhysicalDeviceVulkan13Properties properties13{};
    properties13.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_PROPERTIES;
    properties13.pNext = &driver;
    VkPhysicalDeviceMaintenance3Properties maintenance3{};
    maintenance3.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES;
    maintenance3.pNext = &properties13;
    VkPhysicalDeviceExternalMemoryHostPropertiesEXT host{};
    host.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_EXTERNAL_MEMORY_HOST_PROPERTIES_EXT;
    host.pNext = &maintenance3;
    VkPhysicalDeviceProperties2 properties{};
    properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
    properties.pNext = importsHostMemory(impl.physical) ? static_cast<void*>(&host) : &maintenance3;
    vkGetPhysicalDeviceProperties2(impl.physical, &properties);
    vkGetPhysicalDeviceMemoryProperties(impl.physical, &impl.memory);

    const VkPhysicalDeviceLimits& limits = properties.properties.limits;
    impl.name = properties.properties.deviceName;
    impl.driver = std::string(driver.driverName) + " " + driver.driverInfo;
    impl.maxAllocationBytes = std::min(maintenance3.maxMemoryAllocationSize, properties13.maxBufferSize);
    impl.maxSide =
        std::min({limits.maxImageDimension2D, limits.maxFramebufferWidth, limits.maxFramebufferHeight,
                  limits.maxViewportDimensions[0], limits.maxViewportDimensions[1]});
    impl.importAlignment = host.minImportedHostPointerAlignment;
    impl.maxIndirectDraws = limits.maxDrawIndirectCount;
    impl.maxStorageBytes = limits.maxStorageBufferRange;

    uint32_t count = 0;
    vkGetPhysicalDeviceQueueFamilyProperties(impl.physical, &count, nullptr);
    std::vector<VkQueueFamilyProperties> families(count);
    vkGetPhysicalDeviceQueueFamilyProperties(impl.physical, &count, families.data());
    const uint32_t bits = families[impl.queueFamily].timestampValidBits;
    impl.timestampMs = bits == 0 ? 0 : limits.timestampPeriod * 1e-6;
    impl.timestampMask = bits == 64 ? ~0ull : (1ull << bits) - 1;
}

Result<Done> makeDevice(Device::Impl& impl) {
    impl.queueFamily = *graphicsFamily(impl.physical);
    const float priority = 1;
    VkDeviceQueueCreateInfo queue{};
    queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
    queue.queueFamilyIndex = impl.queueFamily;
    queue.queueCount = 1;
    queue.pQueuePriorities = &priority;

    VkPhysicalDeviceVulkan13Features features13{};
    features13.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES;
    features13.dynamicRendering = VK_TRUE;
    features13.synchronization2 = VK_TRUE;
    features13.maintenance4 = VK_TRUE;  // SPIR-V 1.6 says the size of a compute group in its way
    VkPhysicalDeviceFeatures2 features{};
    features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
    features.pNext = &features13;
    features.features.multiDrawIndirect = VK_TRUE;
    features.features.drawIndirectFirstInstance = VK_TRUE;
    features.features.depthClamp = VK_TRUE;
    features.features.shaderClipDistance = VK_TRUE;
    features.features.fullDrawIndexUint32 = VK_TRUE;

    VkDeviceCreateInfo info{};
    info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
    info.pNext = &features;
    info.queueCreateInfoCount = 1;
    info.pQueueCreateInfos = &queue;
    const char* const import = VK_EXT_EXTERNAL_MEMORY_HOST_EXTENSION_NAME;
    info.enabledExtensionCount = importsHostMemory(impl.physical) ? 1 : 0;
    info.ppEnabledExtensionNames = &import;
    const VkResult result = vkCreateDevice(impl.physical, &info, nullptr, &impl.owner.device);
    if (result != VK_SUCCESS) return refused(result, "vkCreateDevice", impl.name);
    vkGetDeviceQueue(impl.owner.device, impl.queueFamily, 0, &impl.queue);
    impl.owner.name(VK_OBJECT_TYPE_QUEUE, reinterpret_cast<uint64_t>(impl.queue), "queue");
    return Done{};
}

}  // namespace

Device::Impl::~Impl() {
    if (owner.device != VK_NULL_HANDLE) vkDestroyDevice(owner.device, nullptr);
    if (messenger != VK_NULL_HANDLE) {
        const auto destroyMessenger = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(
            vkGetInstanceProcAddr(instance, "vkDestroyDebugUtilsMessengerEXT"));
        destroyMessenger(instance, messenger, nullptr);
    }
    if (instance != VK_NULL_HANDLE) vkDestroyInstance(instance, nullptr);
}

Result<std::unique_ptr<Device>> Device::create(const DeviceConfig& config) {
    auto impl = std::make_unique<Impl>();
    if (const auto made = makeInstance(*impl, config.validation); !made) return made.error();
    if (const auto picked = pickPhysical(*impl, config.nameContains); !picked) return picked.error();
    impl->loseAfter = config.loseAfter;
    if (const auto made = makeDevice(*impl); !made) return made.error();
    readLimits(*impl);
    return std::unique_ptr<Device>(new Device(std::move(impl)));
}

Device::Device(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Device::~Device() = default;

const std::string& Device::name() const { return impl_->name; }
const std::string& Device::driver() const { return impl_->driver; }

std::vector<std::string> Device::validationMessages() const {
    const std::lock_guard lock(impl_->messagesMutex);
    return impl_->messages;
}

}  // namespace gpu
