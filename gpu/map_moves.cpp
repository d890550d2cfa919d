#include "gpu/map_moves.h"

#include <algorithm>

#include "gpu/depth_pipeline.h"
#include "gpu/shaders/move.comp.h"
#include "world/check.h"

namespace gpu {
namespace {

using world::Error;
using world::ErrorCode;
using world::Result;

/// As the shader has them.
struct Push {
    uint32_t wordCount = 0, halves = 0;
    int32_t units = 0;
    float offset = 0, nearest = cache::kNearestDepth;
};
static_assert(sizeof(Push) == 20);

}  // namespace

Result<MapMoves> MapMoves::create(Device::Impl& device, uint32_t side, DepthFormat format) {
    MapMoves made;
    made.side_ = side;
    made.format_ = format;
    const uint64_t bytes = (uint64_t{side} * side * texelBytes(format) + 3) / 4 * 4;  // whole words
    if (bytes > device.maxStorageBytes)
        return Error{ErrorCode::kLimit, "moving maps of " + std::to_string(side) + " texels a side: shaders of '" +
                                            device.name + "' see at most " + std::to_string(device.maxStorageBytes) +
                                            " bytes at once; lower the resolution"};
    auto depths = createBuffer(
        device, bytes,
        VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
        Home::kDevice, "moving depths");
    if (!depths) return depths.error();
    made.depths_ = std::move(depths.value());

    const VkDescriptorType bindings[] = {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER};
    auto adding = Compute::create(
        device, {.shader = kMoveComp, .bindings = bindings, .pushBytes = sizeof(Push), .name = "map moves"});
    if (!adding) return adding.error();
    made.adding_ = std::move(adding.value());
    made.adding_.bind(0, made.depths_);
    return made;
}

void MapMoves::record(Frame& frame, VkCommandBuffer commands, std::span<DepthMap> maps, const MapMove& move) const {
    CHECK(size_t(move.from) < maps.size() && size_t(move.to) < maps.size());
    DepthMap &from = maps[size_t(move.from)], &to = maps[size_t(move.to)];
    // Clamped, so that nothing overflows however far it goes.
    const auto side = int32_t(side_);
    const glm::ivec2 by = glm::clamp(move.by, glm::ivec2(-side), glm::ivec2(side));
    const glm::ivec2 low = glm::max(-by, glm::ivec2(0)), size = side - glm::abs(by);
    const bool some = size.x > 0 && size.y > 0;

    VkBufferImageCopy copy{};
    copy.imageSubresource = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 0, 1};
    copy.imageOffset = {low.x, low.y, 0};
    copy.imageExtent = {uint32_t(size.x), uint32_t(size.y), 1};
    if (some) {
        frame.need(from, Use::kCopySource);
        frame.barrier();
        frame.order(depths_);
        vkCmdCopyImageToBuffer(commands, from.image.handle.raw(), kCopySourceLayout, depths_.raw(), 1, &copy);
    }
    if (by != glm::ivec2(0)) {
        frame.need(to, Use::kAttachment);
        frame.barrier();
        beginDepth(commands, to.image, side_, VK_ATTACHMENT_LOAD_OP_CLEAR);
        vkCmdEndRendering(commands);
    }
    if (!some) return;
    if (move.units != 0) {
        frame.order(depths_);
        add(commands, copy.imageExtent.width * copy.imageExtent.height, move.units);
    }
    frame.need(to, Use::kCopyTarget);
    frame.barrier();
    frame.order(depths_);
    copy.imageOffset = {low.x + by.x, low.y + by.y, 0};
    vkCmdCopyBufferToImage(commands, depths_.raw(), to.image.handle.raw(), kCopyTargetLayout, 1, &copy);
}

void MapMoves::add(VkCommandBuffer commands, uint32_t texels, int units) const {
    const bool halves = format_ == DepthFormat::kD16;
    Push push{.wordCount = halves ? (texels + 1) / 2 : texels, .halves = halves};
    push.units = std::clamp(units, -65535, 65535);
    push.offset = float(push.units / 65535.0);
    adding_.record(commands, push.wordCount, &push);
}

}  // namespace gpu
