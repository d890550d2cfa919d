#include "gpu/draw_list.h"

#include <algorithm>

#include "world/check.h"

namespace gpu {

void DrawList::begin(std::span<VkDrawIndexedIndirectCommand> commands, std::span<glm::mat3x4> instances) {
    commands_ = commands;
    instances_ = instances;
    commandCount_ = 0;
    instanceCount_ = 0;
}

DrawRun DrawList::add(std::span<const cache::DrawItem> items, std::span<const ArenaRange> geometries,
                      std::span<const glm::mat3x4> transforms) {
    keys_.clear();
    for (uint32_t i = 0; i < items.size(); ++i) {
        const cache::DrawItem& item = items[i];
        CHECK(item.geometry < geometries.size() && item.transform < transforms.size());
        const uint32_t available = geometries[item.geometry].indexCount;
        CHECK(item.firstIndex <= available && item.indexCount <= available - item.firstIndex);
        if (item.indexCount == 0) continue;
        keys_.push_back(
            {uint64_t{item.geometry} << 32 | item.firstIndex, uint64_t{item.indexCount} << 32 | i});
    }
    std::sort(keys_.begin(), keys_.end());
    CHECK(keys_.size() <= instances_.size() - instanceCount_ &&
          keys_.size() <= commands_.size() - commandCount_);

    const uint32_t first = commandCount_;
    // Each draw is written once, when it is complete: the memory may be slow to read back.
    for (size_t begin = 0, end = 0; begin < keys_.size(); begin = end) {
        const uint64_t range = keys_[begin].geometryAndFirst;
        const uint32_t count = static_cast<uint32_t>(keys_[begin].countAndItem >> 32);
        const uint32_t firstInstance = instanceCount_;
        for (end = begin; end < keys_.size() && keys_[end].geometryAndFirst == range &&
                          keys_[end].countAndItem >> 32 == count;
             ++end)
            instances_[instanceCount_++] =
                transforms[items[static_cast<uint32_t>(keys_[end].countAndItem)].transform];
        const ArenaRange& geometry = geometries[range >> 32];
        commands_[commandCount_++] = {.indexCount = count,
                                      .instanceCount = instanceCount_ - firstInstance,
                                      .firstIndex = geometry.firstIndex + static_cast<uint32_t>(range),
                                      .vertexOffset = geometry.baseVertex,
                                      .firstInstance = firstInstance};
    }
    return {first, commandCount_ - first};
}

}  // namespace gpu
