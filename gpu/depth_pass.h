// gpu/depth_pass.h — draws triangles into a depth map: one pipeline, one viewport, a scissor per draw.
// There is no fragment shader: on a software driver an empty one makes the pass five times slower.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/draw_list.h"
#include "gpu/memory.h"

namespace gpu {

/// Depth test LESS, both faces, viewport (0, 0, side, side), depth [0, 1] mapped and clamped to
/// [kNearestDepth, 1]. Since only the scissor ever changes, what a triangle leaves in a texel does not
/// depend on the pass that drew it.
class DepthPass {
public:
    /// Draws that share a scissor.
    struct Draws {
        cache::StoreRect scissor;
        DrawRun run;
    };
    /// What happens to one map, in this order. Empty rectangles and runs do nothing.
    struct Work {
        std::span<const cache::StoreRect> unknowns, clears;  ///< set to kUnknownDepth, to kEmptyDepth
        std::span<const Draws> draws;
    };
    struct Buffers {
        const Buffer& geometry;  ///< positions and indices
        const Buffer& commands;  ///< VkDrawIndexedIndirectCommand
        VkDescriptorSet inputs;  ///< of `makeInputs`, bound
    };

    /// `inputSets` is how often `makeInputs` may be called.
    static world::Result<DepthPass> create(Device::Impl& device, uint32_t side, DepthFormat format,
                                           uint32_t inputSets);

    /// A place for the shader's inputs; it lives as long as the pass.
    world::Result<VkDescriptorSet> makeInputs(const std::string& name);
    /// Sets inputs: mat3x4 rows, and per instance the number of its rows. No submission that uses them
    /// may be under way.
    void bind(VkDescriptorSet inputs, const Buffer& transforms, const Buffer& instances) const;

    /// The map is in kAttachmentLayout. Never submits, waits or allocates.
    void record(VkCommandBuffer commands, const Image& map, const Work& work, const Buffers& buffers);
    /// Clears the whole of a map that holds nothing yet to kEmptyDepth.
    void recordNew(VkCommandBuffer commands, const Image& map) const;

private:
    DepthPass(Device::Impl& device, uint32_t side) : device_(&device), side_(side) {}
    world::Result<world::Done> makeLayout(uint32_t inputSets);
    world::Result<world::Done> makePipeline(DepthFormat format);
    void begin(VkCommandBuffer commands, const Image& map, VkAttachmentLoadOp load) const;
    void fill(VkCommandBuffer commands, std::span<const cache::StoreRect> rects, float depth);

    Device::Impl* device_;
    uint32_t side_;
    SetLayoutHandle setLayout_;
    DescriptorPoolHandle pool_;  ///< its sets are freed with it
    PipelineLayoutHandle layout_;
    PipelineHandle pipeline_;
    std::vector<VkClearRect> fillRects_;  ///< kept for its memory
};

}  // namespace gpu
