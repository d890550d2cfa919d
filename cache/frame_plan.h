// cache/frame_plan.h — everything the GPU is to do in one frame, decided; the GPU only obeys.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <glm/mat3x4.hpp>
#include <vector>

namespace cache {

/// Rectangle of a stored map [texels], min inclusive, max exclusive, inside [0, side].
struct StoreRect {
    glm::ivec2 min{0}, max{0};
    friend bool operator==(const StoreRect&, const StoreRect&) = default;
};

/// Depths as maps store them. Casters leave kNearestDepth + (1 - kNearestDepth) * d, where d in [0, 1]
/// is the clamped depth row of their transform: kNearestDepth is the least of them, and exactly one
/// unit of a 16-bit map. The depth test is LESS, so nothing drawn over an unknown texel changes it.
constexpr float kUnknownDepth = 0;  ///< nothing was drawn here yet
constexpr float kNearestDepth = 1.0f / 65535;
constexpr float kEmptyDepth = 1;  ///< known to hold no caster

/// Geometry as `gpu` knows it: the number that `ShadowMaps::upload` gave out for one mesh level.
using GeometryId = uint32_t;

/// A run of whole clusters of one caster.
struct DrawItem {
    GeometryId geometry = 0;
    uint32_t firstIndex = 0, indexCount = 0;  ///< within that mesh level's indices
    uint32_t transform = 0;                   ///< into FramePlan::transforms
    friend bool operator==(const DrawItem&, const DrawItem&) = default;
};

/// Items drawn to one map under one scissor. The scissor never crosses the map's wrap, so all items
/// of a pass share one quadrant offset, which is in their transforms already.
struct DrawPass {
    StoreRect scissor;
    uint32_t firstItem = 0, itemCount = 0;  ///< into FramePlan::items
    friend bool operator==(const DrawPass&, const DrawPass&) = default;
};

/// What happens to one cascade's two maps, in this order: set rectangles of the cache map to
/// kUnknownDepth; clear rectangles of it to kEmptyDepth; draw static passes into the cache map; copy
/// rectangles of the cache map over the working map; draw active passes into the working map. All
/// lists empty: nothing is submitted for the cascade.
struct CascadePlan {
    int cascade = 0;  ///< whose maps they are in this frame; for accounts, not for drawing
    std::vector<StoreRect> unknowns;
    std::vector<StoreRect> clears;
    std::vector<DrawPass> staticPasses;
    std::vector<StoreRect> restores;
    std::vector<DrawPass> activePasses;

    bool idle() const {
        return unknowns.empty() && clears.empty() && staticPasses.empty() && restores.empty() &&
               activePasses.empty();
    }
};

/// One frame. Depth test is LESS, both faces are drawn, and every draw uses the viewport
/// (0, 0, side, side) with depths clamped to [kNearestDepth, 1], whatever its scissor: only so is a
/// strip drawn today equal in every bit to the same strip of a whole redraw.
struct FramePlan {
    /// Rows x, y, depth of the affine map from a mesh's own frame to clip space (w = 1):
    /// clip = vec3(dot(m[0], v1), dot(m[1], v1), dot(m[2], v1)) with v1 = (v, 1).
    std::vector<glm::mat3x4> transforms;
    std::vector<uint32_t> casters;  ///< per transform: whose it is; for accounts, not for drawing
    std::vector<DrawItem> items;
    std::vector<CascadePlan> cascades;

    /// Nothing to do for `maps` pairs of maps; keeps its memory.
    void reset(size_t maps);
    bool idle() const;
    /// Hash over all of the above, for "same input, same plan".
    uint64_t hash() const;
};

}  // namespace cache
