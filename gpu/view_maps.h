// gpu/view_maps.h — depth maps of any kind of view, drawn whole, or moved and drawn in part: what methods other than
// the cache do. A ViewPlan says what is drawn; the GPU only obeys.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <glm/mat3x4.hpp>
#include <memory>
#include <optional>
#include <vector>

#include "cache/frame_plan.h"
#include "gpu/device.h"
#include "world/mesh.h"
#include "world/result.h"

namespace gpu {

/// Items drawn to one map through one view. Several passes may draw to a map: facets do.
struct ViewPass {
    int map = 0;
    /// The view's frame, to which transforms lead, to clip space: x and y in [-w, w], y down, depth in [0, w]. Depths
    /// out of range are clamped.
    glm::mat4 clipFromView{1};
    /// Half planes (a, b, c) of clip space, a x + b y + c w >= 0, outside of which nothing is drawn; zeros: none.
    std::array<glm::vec3, 2> wedge{};
    float slopeBias = 0;  ///< times the slope of a triangle's depth over a texel, added to it
    uint32_t firstItem = 0, itemCount = 0;  ///< into ViewPlan::items
    std::optional<cache::StoreRect> scissor{};  ///< none: the whole map
};

/// A map's depths go to another map, or to other texels of the same.
/// Source: Day, "CSM Scrolling", 2012, section 4.
struct MapMove {
    int from = 0, to = 0;
    glm::ivec2 by{0};  ///< texel t comes to t + by; texels of `to` that nothing comes to are emptied
    /// Of 1 / 65535, added to each depth. An empty texel, exactly 1, stays empty whatever they are; what would be
    /// nearer than a caster can leave becomes kNearestDepth, and what reaches 1 is empty from then on.
    int units = 0;
};

/// First the moves, one after the other, then the clears, then the passes, in their order.
struct ViewPlan {
    std::vector<MapMove> moves;
    /// Rows x, y, z of the affine map from a mesh's own frame to a view's.
    std::vector<glm::mat3x4> transforms;
    std::vector<cache::DrawItem> items;
    std::vector<int> clears;  ///< maps that are emptied
    std::vector<ViewPass> passes;
};

struct ViewMapsConfig {
    int maps = 4;
    int side = 1024;  ///< texels a side
    DepthFormat format = DepthFormat::kD32;
    uint64_t geometryBytes = 512ull << 20;  ///< size of the arena for vertices and indices
};

/// Time that a plan took. Noisy on software drivers.
struct ViewTimes {
    double recordMs = 0;  ///< CPU time to fill buffers and record commands
    double wallMs = 0;    ///< from vkQueueSubmit to its fence
};

/// Maps hold depths as cache/frame_plan.h has them; new ones are empty. One thread at a time. Every error is
/// kDevice or kLimit.
class ViewMaps {
public:
    /// `device` must outlive it.
    static world::Result<std::unique_ptr<ViewMaps>> create(Device& device, const ViewMapsConfig& config);
    ~ViewMaps();

    /// Copies positions and indices into the arena. kLimit names the budget when it is full.
    world::Result<cache::GeometryId> upload(const world::MeshLevel& level);

    /// Executes the plan in one submission and waits. CHECKs that what it names is there.
    world::Result<ViewTimes> draw(const ViewPlan& plan);

    /// Depths of a map, row by row, side * side values; units / 65535 for D16.
    world::Result<std::vector<float>> read(int map);

private:
    struct Impl;
    explicit ViewMaps(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
};

}  // namespace gpu
