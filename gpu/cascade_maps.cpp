#include "gpu/cascade_maps.h"

#include <algorithm>
#include <cstring>

#include "gpu/depth_pipeline.h"

namespace gpu {

using world::Result;

Result<std::vector<CascadeMaps>> createCascadeMaps(Device::Impl& device, const ShadowMapsConfig& config,
                                                   const std::string& prefix) {
    std::vector<CascadeMaps> made(static_cast<size_t>(config.cascades));
    for (size_t c = 0; c < made.size(); ++c) {
        const std::string number = std::to_string(c);
        for (auto [map, kind] :
             {std::pair(&made[c].cacheMap, "cache map "), std::pair(&made[c].working, "working map ")}) {
            auto image = createDepthImage(device, static_cast<uint32_t>(config.side), config.format,
                                          prefix + kind + number);
            if (!image) return image.error();
            map->image = std::move(image.value());
        }
    }
    return made;
}

void recordNew(Frame& frame, VkCommandBuffer commands, std::span<CascadeMaps> maps, uint32_t side) {
    for (CascadeMaps& pair : maps) {
        frame.need(pair.cacheMap, Use::kAttachment);
        frame.need(pair.working, Use::kAttachment);
    }
    frame.barrier();
    for (const CascadeMaps& pair : maps)
        for (const DepthMap* map : {&pair.cacheMap, &pair.working}) {
            beginDepth(commands, map->image, side, VK_ATTACHMENT_LOAD_OP_CLEAR);
            vkCmdEndRendering(commands);
        }
}

void recordRestores(VkCommandBuffer commands, const CascadeMaps& maps,
                    std::span<const cache::StoreRect> rects, std::vector<VkImageCopy>& kept) {
    kept.clear();
    for (const cache::StoreRect& rect : rects) {
        const glm::ivec2 size = rect.max - rect.min;
        if (size.x <= 0 || size.y <= 0) continue;
        VkImageCopy copy{};
        copy.srcSubresource = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 0, 1};
        copy.srcOffset = {rect.min.x, rect.min.y, 0};
        copy.dstSubresource = copy.srcSubresource;
        copy.dstOffset = copy.srcOffset;
        copy.extent = {static_cast<uint32_t>(size.x), static_cast<uint32_t>(size.y), 1};
        kept.push_back(copy);
    }
    if (kept.empty()) return;
    vkCmdCopyImage(commands, maps.cacheMap.image.handle.raw(), kCopySourceLayout,
                   maps.working.image.handle.raw(), kCopyTargetLayout, static_cast<uint32_t>(kept.size()),
                   kept.data());
}

Result<Readback> Readback::create(Device::Impl& device, uint32_t side, DepthFormat format) {
    Readback made;
    made.side_ = side;
    made.format_ = format;
    auto buffer = createBuffer(device, uint64_t{side} * side * texelBytes(format),
                               VK_BUFFER_USAGE_TRANSFER_DST_BIT, Home::kReadback, "readback");
    if (!buffer) return buffer.error();
    made.buffer_ = std::move(buffer.value());
    return made;
}

void recordCopy(Frame& frame, VkCommandBuffer commands, DepthMap& map, uint32_t side, const Buffer& to, uint64_t offset) {
    frame.need(map, Use::kCopySource);
    frame.barrier();
    VkBufferImageCopy copy{};
    copy.bufferOffset = offset;
    copy.imageSubresource = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 0, 1};
    copy.imageExtent = {side, side, 1};
    vkCmdCopyImageToBuffer(commands, map.image.handle.raw(), kCopySourceLayout, to.raw(), 1, &copy);
}

void Readback::record(Frame& frame, VkCommandBuffer commands, DepthMap& map) const {
    recordCopy(frame, commands, map, side_, buffer_, 0);
    frame.toHost(buffer_);
}

std::vector<float> Readback::depths() const {
    std::vector<float> depths(size_t{side_} * side_);
    if (format_ == DepthFormat::kD32) {
        std::memcpy(depths.data(), buffer_.mapped, depths.size() * sizeof(float));
    } else {
        const auto* const units = reinterpret_cast<const uint16_t*>(buffer_.mapped);
        std::transform(units, units + depths.size(), depths.begin(),
                       [](uint16_t unit) { return static_cast<float>(unit) / 65535.0f; });
    }
    return depths;
}

}  // namespace gpu
