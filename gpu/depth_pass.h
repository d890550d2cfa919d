// gpu/depth_pass.h — draws meshes into a depth map: clears and indirect draws, a scissor per pass.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/depth_pipeline.h"
#include "gpu/draw_list.h"
#include "gpu/memory.h"

namespace gpu {

/// What an instance's transform leads to.
enum class Projection {
    kParallel,     ///< clip space; depths out of range are clamped
    kPerspective,  ///< a spot light's frame, as cache/spot_cache.h has it; what is nearer than near is cut off
    kView,         ///< the frame of each draw's own view; depths out of range are clamped
};

/// One pipeline, created once for maps of every size; see gpu/depth_pipeline.h for its state.
class DepthPass {
public:
    /// See ViewPass.
    struct View {
        glm::mat4 clipFromView{1};
        std::array<glm::vec4, 2> wedge{};  ///< dot(xyz, clip.xyw) + w >= 0
        float slopeBias = 0;
    };
    /// Draws that share a scissor, and a view: given where the projection is kView.
    struct Draws {
        cache::StoreRect scissor;
        DrawRun run;
        const View* view = nullptr;
    };
    /// What happens to one map, in this order. Empty rectangles and runs do nothing.
    struct Work {
        std::span<const cache::StoreRect> unknowns, clears;  ///< set to kUnknownDepth, to kEmptyDepth
        std::span<const Draws> draws;
    };
    struct Buffers {
        const Buffer& geometry;   ///< positions and indices
        const Buffer& instances;  ///< glm::mat3x4, each instance's transform
        const Buffer& commands;   ///< VkDrawIndexedIndirectCommand
    };

    static world::Result<DepthPass> create(Device::Impl& device, DepthFormat format,
                                           Projection projection = Projection::kParallel);

    /// The map, `side` texels a side, is in kAttachmentLayout. Never submits, waits or allocates.
    void record(VkCommandBuffer commands, const Image& map, uint32_t side, const Work& work, const Buffers& buffers);

private:
    explicit DepthPass(Device::Impl& device) : device_(&device) {}

    Device::Impl* device_;
    DepthPipeline pipeline_;
    std::vector<VkClearRect> fillRects_;  ///< kept for its memory
};

}  // namespace gpu
