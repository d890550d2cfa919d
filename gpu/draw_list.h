// gpu/draw_list.h — a pass's items as few indirect draws: equal ranges of one mesh become instances.
#pragma once

#include <vulkan/vulkan.h>

#include <cstdint>
#include <span>
#include <vector>

#include "cache/frame_plan.h"

namespace gpu {

/// Where a mesh level lies in the geometry arena.
struct ArenaRange {
    int32_t baseVertex = 0;   ///< its first position, counted in positions from the arena's start
    uint32_t firstIndex = 0;  ///< its first index, counted in indices from the arena's start
    uint32_t indexCount = 0;
};

/// Indirect draws, a stretch of the frame's list.
struct DrawRun {
    uint32_t first = 0, count = 0;
};

/// Writes a frame's draws and their instances' transforms, pass by pass, straight into mapped memory. The
/// order of the draws follows from the items alone.
class DrawList {
public:
    /// Starts a frame. The spans must hold as many elements as the frame's passes have items.
    void begin(std::span<VkDrawIndexedIndirectCommand> commands, std::span<glm::mat3x4> instances);
    /// Adds one pass. `geometries` is indexed by GeometryId. Items without indices vanish. CHECKs that
    /// each item's range lies in its mesh level, and its transform among those given.
    DrawRun add(std::span<const cache::DrawItem> items, std::span<const ArenaRange> geometries,
                std::span<const glm::mat3x4> transforms);

    uint32_t commandCount() const { return commandCount_; }
    uint32_t instanceCount() const { return instanceCount_; }

private:
    /// Compared as two wide numbers; the item's place comes last and makes the order total.
    struct Key {
        uint64_t geometryAndFirst = 0, countAndItem = 0;
        friend bool operator<(const Key& a, const Key& b) {
            return a.geometryAndFirst != b.geometryAndFirst ? a.geometryAndFirst < b.geometryAndFirst
                                                            : a.countAndItem < b.countAndItem;
        }
    };
    std::vector<Key> keys_;  ///< of one pass; kept for its memory
    std::span<VkDrawIndexedIndirectCommand> commands_;
    std::span<glm::mat3x4> instances_;
    uint32_t commandCount_ = 0, instanceCount_ = 0;
};

}  // namespace gpu
