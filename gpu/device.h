// gpu/device.h — one Vulkan 1.3 device: instance, queue, memory and, on request, validation.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "world/result.h"

namespace gpu {

/// Texels of a depth map: a float, or units of 1/65535.
enum class DepthFormat { kD32, kD16 };

struct DeviceConfig {
    bool validation = false;   ///< core and synchronization validation; kNotFound without the layer
    std::string nameContains;  ///< pick the first device whose name contains this; empty: see below
    uint64_t loseAfter = 0;    ///< for tests: after so many submissions the device counts as lost; 0: never
};

/// A device with a queue for graphics and compute, dynamic rendering, synchronization2, multi-draw-indirect,
/// drawIndirectFirstInstance, depth clamp and maps of both formats. Picks a discrete GPU before an
/// integrated one before a software one unless told otherwise. Nothing Vulkan leaks into this header.
class Device {
public:
    /// kNotFound when there is no Vulkan driver or no fitting device: the text says what to install.
    static world::Result<std::unique_ptr<Device>> create(const DeviceConfig& config);
    ~Device();

    const std::string& name() const;    ///< as the driver reports it
    const std::string& driver() const;  ///< driver name and version, for reports
    /// Validation messages so far (warnings and errors). Tests expect none.
    std::vector<std::string> validationMessages() const;

    struct Impl;
    Impl& impl() { return *impl_; }

private:
    explicit Device(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace gpu
